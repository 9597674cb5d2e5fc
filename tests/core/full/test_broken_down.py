"""Arithmetic that breaks down somewhere in a solve: a result with a reason, as of any other failure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.errors import Refused
from calib_core.final_messages import with_cause
from calib_core.full.joint import solve
from calib_core.full.joint.estimation import Estimation, JointData, Solved
from calib_core.full.joint.schedule import Schedule
from calib_core.result import Message
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.solver.arrow import NotPositiveDefinite
from calib_core.types import Recording


@pytest.mark.parametrize(
    "broken",
    [lambda: np.linalg.cholesky(np.array([[-1.0]])), lambda: _raise(NotPositiveDefinite("block 3")), lambda: 1 // 0],
)
def test_it_is_refused_with_a_reason(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, broken: Callable[[], object]
) -> None:
    """Mutations: one of the two kinds let through; no reason told."""
    monkeypatch.setattr("calib_core.calibrate.calibrate_full", lambda *_, **__: broken())
    done = calibrate(noisy[0], CalibrateSettings())
    assert done.trajectory is None
    assert done.result.status == "refused"
    last = done.result.messages[-1]
    assert (last.level, last.code) == ("error", "solve.broke_down")
    assert "arithmetic broke down (" in last.text


def test_what_breaks_down_with_sensors_let_go_is_answered_with_them_held(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As any refusal of the solve is gone on from. Seen in a train that speeds up: "eigenvalues did not converge", and no answer.

    Mutation: what breaks down in the joint stage leaves it as it is.
    """
    here = solve.at_rest

    def at_rest(data: JointData, state: Estimation, schedule: Schedule) -> Solved:
        if data.run.settings.intrinsics == "auto":
            raise np.linalg.LinAlgError("Eigenvalues did not converge")
        return here(data, state, schedule)

    monkeypatch.setattr(solve, "at_rest", at_rest)
    result = calibrate(noisy[0], CalibrateSettings(crispness=False)).result
    assert result.status != "refused"
    assert "sensor.astray" in [message.code for message in result.messages]
    assert {each.state for each in result.intrinsics} == {"considered"}


def test_what_was_warned_of_comes_first_where_a_refusal_names_but_what_came_of_it() -> None:
    """Seen of a clipped gyroscope: "some planes are not flat". Mutations: any warning; of a refusal that has its own reason; the
    last cause warned of in the place of the plainest; what helps is not told.
    """
    clipped = Message(
        code="imu.clipped", level="warning", text="the gyroscope is clipped in 12 %: it says less; move gently"
    )
    stuck = Message(code="imu.stuck", level="warning", text="The gyroscope's x axis is stuck.")
    other = Message(code="imu.gaps", level="warning", text="there are gaps")
    unsettled = Refused("solve.unsettled", "the solve did not converge")
    assert with_cause(unsettled, [other]) == "the solve did not converge"
    assert with_cause(unsettled, [other, clipped]) == (
        "the gyroscope is clipped in 12 %: it says less (move more gently, or widen its range); that may be why the solve did "
        "not converge"
    )
    for both in ([clipped, stuck], [stuck, clipped]):
        assert with_cause(unsettled, both).startswith("the gyroscope's x axis is stuck; that may be why")
    assert with_cause(Refused("points.unit", "in millimetres"), [clipped]) == "in millimetres"


def test_a_turning_about_one_axis_is_named_where_a_solve_broke() -> None:
    """Seen of a spinner in a silo, "some planes are not flat" alone. Mutations: not named; before what breaks any model; of a
    refusal that has its own reason; without what helps.
    """
    one = Message(
        code="start.open_turn", level="info", text="all turning is about one axis: it starts where planes are plumb"
    )
    stuck = Message(code="imu.stuck", level="warning", text="The gyroscope's x axis is stuck.")
    unsettled = Refused("solve.unsettled", "the solve did not converge; leave out what can move or bend")
    assert with_cause(unsettled, [one]) == (
        "as far as the lidar could be followed, all rotation is about one axis; that may be why the solve did not converge; "
        "leave out what can move or bend, and turn the rig about the other axes too"
    )
    assert with_cause(unsettled, [one, stuck]).startswith("the gyroscope's x axis is stuck; that may be why")
    assert with_cause(Refused("points.unit", "in millimetres"), [one]) == "in millimetres"


def _raise(error: Exception) -> None:
    raise error
