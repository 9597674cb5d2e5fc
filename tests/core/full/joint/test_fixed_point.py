"""How often descents with all points are made, by what each has found. Whole solves: test_alternation.py."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from calib_core.full.joint import alternation as room
from calib_core.full.joint.alternation import stands_still, to_fixed_point
from calib_core.full.joint.policies import Sampling, Settling
from calib_core.settings import CalibrateSettings
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


@pytest.mark.parametrize(
    ("firsts", "taken", "arrives"),
    [
        ([2e5, 1e6, 2e6, 5e6, 3e6, 2e6], 4, False),  # seen: a lift's start and end, taken for the rig's own motion
        ([1e4, 6.0, 1e-4], 3, True),  # seen: a hand in a room
        ([2e3, 9e3, 400.0, 3e3, 1e-4], 5, True),  # one that the first has thrown off comes back
        ([0.9, 0.8, 0.7, 0.6, 0.6, 1e-4], 6, True),  # less than a sigma: next to the end
    ],
)
def test_descents_that_predict_as_much_again_and_again_are_lost(
    monkeypatch: pytest.MonkeyPatch, firsts: list[float], taken: int, arrives: bool
) -> None:
    """36 of them took 90 s, of a recording of 11. Mutations: all are made; one that predicts more is lost; however little."""
    left = iter(firsts)

    def descend(_: object, state: Any, **__: object) -> tuple[Any, None]:
        first, nothing = next(left), cast("Any", None)
        minimum = Minimum(nothing, 0.0, SimpleNamespace(predicted_decrease=0.5 * first), Outcome.CONVERGED, 1, first)  # type: ignore[arg-type]
        return SimpleNamespace(rounds=state.rounds + 1, minimum=minimum), None

    monkeypatch.setattr(room, "descend", descend)
    unused: Any = None
    start: Any = SimpleNamespace(rounds=0)
    after, _, arrived = to_fixed_point(unused, start, Settling(), most=20, shared=SharedEquations())
    assert (after.rounds, arrived) == (taken, arrives)


@pytest.mark.parametrize(("arrivals", "taken"), [([False, False, True], 2), ([False, True, True, True], 4)])
def test_points_are_given_anew_to_lost_descents_once(
    monkeypatch: pytest.MonkeyPatch, arrivals: list[bool], taken: int
) -> None:
    """And what moves is refused then. Mutations: again until the rounds are used up; not once; those that arrive count too."""
    told: list[int] = []
    state: Any = SimpleNamespace(rounds=0, estimate=None)
    state.without_points = lambda: state

    def descended(*_: object, **__: object) -> tuple[Any, None, bool]:
        state.rounds += 1
        return state, None, arrivals[state.rounds - 1]

    same: Any = lambda _, state, *__, **___: state  # noqa: E731
    moved = lambda *_: 1.0 if state.rounds < 4 else 0.0  # noqa: E731
    for name, step in {"associate": same, "to_fixed_point": descended, "moved_in_gate": moved}.items():
        monkeypatch.setattr(room, name, step)
    monkeypatch.setattr(room, "gate_of", lambda *_: None)
    monkeypatch.setattr(room, "require_rest", lambda *_: told.append(state.rounds))
    data: Any = SimpleNamespace(run=SimpleNamespace(settings=CalibrateSettings()), portion=lambda *_: data)
    room.alternate(data, state, Settling(), Sampling())
    assert state.rounds == taken
    assert told == [taken] * (taken == 2)


def test_the_calibration_stands_still_where_none_of_the_seven_has_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    """By its own standard deviations, either way. Mutations: one of the seven enough; moves that are less than zero."""
    std = np.linspace(1.0, 7.0, 7)
    unused: Any = None
    for moved, still in ((0.04 * std, True), (-0.06 * std, False), (np.eye(7)[3] * 0.06 * std, False)):
        monkeypatch.setattr(room, "last_move", lambda *_, moved=moved: (moved, std))
        assert stands_still(unused, unused, 0.05) is still
