"""A room with bent walls, solved whole: the shape of its walls comes to rest as quickly as they would if they were flat."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

from calib_core import api
from calib_core.events import LogEvent
from calib_core.full.joint import alternation
from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.state import Estimate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate, parse_faults

#: What a point says of a height may be a little off where its gate lies about the last round's surface.
LEFT = 0.2


def test_rounds_in_a_bent_room_leave_little_of_what_they_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: Newton's method. Seen: a step that took patches for flat left three quarters each time, and what a range falls
    short by at a slant stopped four sigmas from where it belongs.

    Mutations: every share that of the nearest height alone in the solve's columns, while points are laid out by all four;
    heights never admitted.
    """
    moves: list[float] = []
    measured = alternation.moved_in_gate

    def watched(problem: JointProblem, before: Estimate, after: Estimate) -> float:
        moves.append(measured(problem, before, after))
        return moves[-1]

    patches: list[int] = []
    bent: list[list[float]] = []
    near_rest = alternation.near_rest

    def counted(data: JointData, state: Estimation, *rest: Any, **more: Any) -> alternation.Near:
        begin = len(moves)
        found = near_rest(data, state, *rest, **more)
        if state.nuisance.patches:
            patches.append(state.nuisance.patches)
            bent.append(moves[begin:])
        return found

    monkeypatch.setattr(alternation, "moved_in_gate", watched)
    monkeypatch.setattr("calib_core.full.joint.solve.near_rest", counted)
    recording, _ = generate(SCENARIOS["handheld"], seed=3, duration_s=10.0, faults=parse_faults("bent-walls=5mm"))
    said: list[str] = []
    result = api.calibrate(
        recording,
        CalibrateSettings(crispness=False),
        on_event=lambda event: said.append(event.code) if isinstance(event, LogEvent) else None,
    ).result
    assert "planes.uneven" in said
    assert patches[0] > 100
    for one in bent:
        assert len(one) >= 3
        # Of hardly more than counts as still, a cell more or less decides.
        assert all(after < LEFT * before for before, after in pairwise(one) if before > 2.0 * FULL.settling.still)
        assert sum(before > FULL.settling.still for before in one) >= 2
    grazing = next(each for each in result.intrinsics if each.block == "grazing")
    assert abs(grazing.value) < 3.0 * grazing.std < 3.0 * 0.5 * grazing.prior_std
