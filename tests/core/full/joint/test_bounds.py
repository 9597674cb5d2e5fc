"""Answers that have run away, and solves that never come to rest: refused, with the quantity that moved."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full.joint.bounds import last_move, require_bounds, require_points, require_rest, require_sensors
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import Nuisance, NuisanceBlock
from calib_core.solver.information import covariance
from tests.core.full.joint.conftest import Half


def moved(state: Estimation, *, offset_s: float = 0.0, arm_m: float = 0.0) -> Estimation:
    e = state.estimate
    arm = e.p_imu_lidar + arm_m * np.array([0.0, -1.0, 0.0])
    return replace(state, estimate=replace(e, time_offset_s=e.time_offset_s + offset_s, p_imu_lidar=arm))


def test_an_offset_more_than_a_sweep_away_from_both_sensors_turning_is_refused(half: Half) -> None:
    """Sweeps are 0.1 s. Mutations: leave the check out; measure from the last round instead of from the start."""
    require_bounds(half.data, half.state, moved(half.state, offset_s=0.08))
    for far_s in (-0.12, 8.8):
        away = moved(half.state, offset_s=far_s)
        said = f"no motion of the rig explains what the lidar saw of the planes: the solve's best time offset is {abs(far_s)}"
        with pytest.raises(Refused, match=re.escape(said)) as refused:
            require_bounds(half.data, away, away)
        assert refused.value.code == "solve.offset_ran_away"


def test_a_lever_arm_of_metres_known_to_millimetres_is_refused(half: Half) -> None:
    """Mutations: leave the check out; refuse a long lever arm that says of itself that it is not known."""
    with pytest.raises(Refused, match=r"the lidar 1\d\.\d m away from the IMU, to within") as refused:
        require_bounds(half.data, half.state, moved(half.state, arm_m=15.0))
    assert refused.value.code == "solve.lever_arm_ran_away"
    require_bounds(half.data, half.state, moved(half.state, arm_m=5.0))
    require_bounds(half.data, half.state, replace(moved(half.state, arm_m=15.0), minimum=None))


def test_what_still_moves_beyond_its_own_sigma_has_not_settled(half: Half) -> None:
    """Oracle: the sigma from the information's inverse. Mutations: compare with a fixed size; name the first quantity."""
    assert half.state.information is not None
    std_s = float(np.sqrt(covariance(half.state.information).matrix[6, 6]))
    little, much = moved(half.state, offset_s=0.8 * std_s), moved(half.state, offset_s=2.5 * std_s)
    require_rest(half.state, little, 1.0)
    assert last_move(half.state, much)[0][6] == pytest.approx(2.5 * std_s)
    with pytest.raises(Refused, match=r"the time offset still moved by .* ms, 2\.5 times its standard deviation"):
        require_rest(half.state, much, 1.0)


def test_a_doubtful_plane_that_was_chosen_is_why_a_solve_does_not_rest(half: Half) -> None:
    """And nothing else is tried then, which begins with "solve." Mutations: the cure for any plane; every plane named."""
    assert half.state.information is not None
    std_s = float(np.sqrt(covariance(half.state.information).matrix[6, 6]))
    much = moved(half.state, offset_s=2.5 * std_s)
    first, second, *rest = much.planes
    marked = replace(much, planes=(first, replace(second, fault="bent"), *rest))
    with pytest.raises(Refused, match=f"with the chosen planes: {second.name} is not flat; leave out") as refused:
        require_rest(half.state, marked, 1.0)
    assert refused.value.code == "planes.unsettled"
    require_rest(half.state, replace(half.state, planes=marked.planes), 1.0)


def test_a_motion_on_which_no_point_lies_is_told_as_that() -> None:
    """Seen: a ship that rolls ended in an IndexError. Mutation: the number of scans asked for."""
    require_points(1, [])
    with pytest.raises(Refused, match="motion that the solve found, no point lies on floor or wall 1"):
        require_points(0, ["floor", "wall 1"])


def test_a_sensor_that_no_one_builds_is_told_as_that(half: Half) -> None:
    """Twelve times its prior, whichever way, of any block. Mutations: leave the check out; look at the first block only; take
    the signed value."""
    blocks = (
        NuisanceBlock("gyroscope_scale", ("x", "y", "z"), np.full(3, 0.01)),
        NuisanceBlock("accelerometer_scale", ("x", "y", "z"), np.full(3, 0.01)),
    )
    for value, astray in ((0.1, False), (-0.13, True)):
        values = np.array([0.0, 0.02, 0.0, 0.0, 0.0, value])
        sensors = SensorState(Nuisance(blocks), values)
        there = replace(half.state, estimate=replace(half.state.estimate, sensors=sensors))
        if not astray:
            require_sensors(there, half.data.limits.sensor_sigmas)
            continue
        with pytest.raises(Refused, match="accelerometer scale 13 times as large as") as refused:
            require_sensors(there, half.data.limits.sensor_sigmas)
        assert refused.value.code == "solve.sensors_astray"
