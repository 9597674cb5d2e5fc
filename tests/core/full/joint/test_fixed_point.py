"""How often descents with all points are made, by what each has found. Whole solves: test_alternation.py."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.joint import alternation as room
from calib_core.full.joint.alternation import stands_still, to_fixed_point
from calib_core.full.joint.policies import Settling
from calib_core.solver.levenberg import Minimum, Outcome, SharedEquations


@pytest.mark.parametrize(
    ("descents", "taken", "last_steps"),
    [
        # What each descent's steps would find. One that finds nothing is the last.
        ([[4e3, 7e-4, 1e-9], [1e-4, 0.0], [0.0]], 2, [1e-6, 1e-2]),
        # A part of what the one before did; a part as small of that is nothing, and not looked for.
        ([[4e3, 7e-4, 1e-9], [2.7e-3], [0.0]], 2, [1e-6, 1e-2]),
        # Half of it each time is not at its end.
        ([[4.0, 1e-7], [2.0, 1e-7], [1.0, 1e-7], [5e-4]], 4, [1e-6, 1e-2, 1e-2, 1e-2]),
        # Steps that find a third of one another each go on to the end.
        ([[9.0, 3.0, 1.0], [1e-2, 3e-3], [0.0]], 3, [1e-6, 9e-6, 3.3e-6]),
        # A descent that broke off, or one of a single step, has told nothing of steps.
        ([[9.0, None], [1e-2, 1e-8], [0.0]], 3, [1e-6, 1e-6, 1e-2]),
        ([[9.0], [1e-2, 1e-8], [0.0]], 3, [1e-6, 1e-6, 1e-2]),
        # One that has used up its steps while the calibration stood still is the last; a usual one is not, nor one that moved it.
        ([[9.0, None], [5.0, None, "still"], [0.0]], 2, [1e-6, 1e-6]),
        ([[9.0, 3.0, 1.0, "still"], [1e-2, 3e-3], [0.0]], 3, [1e-6, 9e-6, 3.3e-6]),
    ],
)
@pytest.mark.parametrize("broken_off", [Outcome.EXHAUSTED, Outcome.CREEPING])
def test_descents_end_where_the_next_would_find_nothing(
    monkeypatch: pytest.MonkeyPatch,
    descents: list[list[Any]],
    taken: int,
    last_steps: list[float],
    broken_off: Outcome,
) -> None:
    """By what each has left of the one before. Mutations: looked at once more; a slow one taken for a fast one; steps of a
    descent that broke off believed; a step of any size the last; one that stood still gone on with, of either kind; a moving one
    not; the equations of the one before not handed on.
    """
    asked: list[float] = []
    stood: list[bool] = []
    shared = SharedEquations()

    def descend(_: object, state: Any, *, tolerance: float, along_valleys: bool, **by: object) -> tuple[Any, None]:
        assert along_valleys
        assert by["shared"] is shared
        found = [each for each in descents[len(asked)] if each != "still"]
        stood.append("still" in descents[len(asked)])
        asked.append(tolerance)
        solution: Any = SimpleNamespace(predicted_decrease=found[-1])
        outcome = Outcome.CONVERGED if found[-1] is not None else broken_off
        estimate: Any = None
        first = found[0]
        assert first is not None
        minimum = Minimum(estimate, 0.0, solution, outcome, len(found), first)
        return SimpleNamespace(rounds=state.rounds + 1, minimum=minimum), None

    monkeypatch.setattr(room, "descend", descend)
    monkeypatch.setattr(room, "stands_still", lambda *_: stood[-1])
    unused: Any = None
    start: Any = SimpleNamespace(rounds=0)
    to_fixed_point(unused, start, Settling(), most=20, shared=shared)
    assert len(asked) == taken
    assert asked == pytest.approx(last_steps[:taken], rel=0.02)


def test_the_calibration_stands_still_where_none_of_the_seven_has_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    """By its own standard deviations, either way. Mutations: one of the seven enough; moves that are less than zero."""
    std = np.linspace(1.0, 7.0, 7)
    unused: Any = None
    for moved, still in ((0.04 * std, True), (-0.06 * std, False), (np.eye(7)[3] * 0.06 * std, False)):
        monkeypatch.setattr(room, "last_move", lambda *_, moved=moved: (moved, std))
        assert stands_still(unused, unused, 0.05) is still
