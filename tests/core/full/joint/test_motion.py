"""The motion between knots against the simulator's exact kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.factors.imu import KnotStates
from calib_core.full.joint.motion import Motion
from calib_core.geometry import exp, log
from calib_core.imu.preintegration import UpsampledImu, gauss_nodes
from calib_core.simulate import SCENARIOS, Truth
from calib_core.types import FloatArray

TRUTH = Truth(SCENARIOS["paper-fast"], 0, 0, 0, np.zeros(3), np.zeros(3))
GRAVITY = TRUTH.gravity_world_m_s2
GYRO_BIAS, ACCEL_BIAS = np.array([0.01, -0.02, 0.03]), np.array([0.1, 0.2, -0.3])


def _motion(h_s: float, *, linked: FloatArray | None = None) -> Motion:
    """Exact states and biased readings at knots from 3 to 5 s."""
    knots = 3.0 + h_s * np.arange(round(2.0 / h_s) + 1)
    at = TRUTH.imu(knots)
    force = np.einsum("nji,nj->ni", at.R_world, at.a_m_s2 - GRAVITY)
    links = len(knots) - 1
    none = np.zeros((links, 2, 3))
    ok = np.ones(links, bool) if linked is None else linked.astype(bool)
    readings = UpsampledImu(
        knots, h_s, none, none, at.omega_rad_s + GYRO_BIAS, force + ACCEL_BIAS, np.zeros((links, 6)), ok
    )
    tile = (len(knots), 1)
    return Motion(
        readings, KnotStates(at.R_world, at.p_m, at.v_m_s), np.tile(GYRO_BIAS, tile), np.tile(ACCEL_BIAS, tile), GRAVITY
    )


def _worst(h_s: float) -> dict[str, float]:
    t = 3.2 + np.linspace(0.0, 1.6, 777)
    found, true = _motion(h_s).at(t), TRUTH.imu(t)
    assert found.usable.all()
    return {
        "rotation": float(np.abs(log(np.swapaxes(true.R_world, 1, 2) @ found.R)).max()),
        "position": float(np.abs(found.p - true.p_m).max()),
        "velocity": float(np.abs(found.v - true.v_m_s).max()),
        "rate": float(np.abs(found.omega_rad_s - true.omega_rad_s).max()),
    }


def test_between_knots_the_motion_is_the_simulators() -> None:
    """Fails when the position's square term is taken at the knot instead of a third of the way.

    Knots of 10 ms, hand-held motion of 1.5 Hz: a microradian, tens of nanometres, far below what a recording can show.
    """
    worst = _worst(0.01)
    assert worst["rotation"] < 1e-6
    assert worst["position"] < 5e-8
    assert worst["velocity"] < 5e-5
    assert worst["rate"] < 3e-4


def test_its_error_falls_with_the_spacing_as_its_terms_promise() -> None:
    """Fails when the rate's second difference is left out of the rotation, or divides by 2 h.

    Rotation to the third power of the time from the knot, so the remainder is of fourth order: a sixteenth.
    """
    coarse, fine = _worst(0.04), _worst(0.02)
    assert coarse["rotation"] / fine["rotation"] > 12.0
    assert coarse["position"] / fine["position"] > 12.0
    assert coarse["velocity"] / fine["velocity"] > 6.5
    assert coarse["rate"] / fine["rate"] > 6.5


def _shaken(frequency_hz: float, h_s: float, *, substeps: int = 2) -> tuple[FloatArray, FloatArray]:
    """What turns [rad] and rates [rad/s] are off between knots, (N, 3), of a rig turned to and fro by half a milliradian.

    Poses at knots and readings at knots and Gauss points are exact.
    """
    axis, by, omega = np.array([0.6, 0.0, -0.8]), 5e-4, 2.0 * np.pi * frequency_hz
    knots = h_s * np.arange(101)
    gauss = knots[:-1, None] + gauss_nodes(substeps) * h_s

    def turn(t: FloatArray) -> FloatArray:
        return np.asarray(by * np.sin(omega * t + 0.3)[..., None] * axis)

    def rate(t: FloatArray) -> FloatArray:
        return np.asarray(by * omega * np.cos(omega * t + 0.3)[..., None] * axis)

    still = np.zeros((101, 3))
    readings = UpsampledImu(
        knots, h_s, rate(gauss) + GYRO_BIAS, np.zeros((100, 2 * substeps, 3)), rate(knots) + GYRO_BIAS, still,
        np.zeros((100, 6)), np.ones(100, bool),
    )  # fmt: skip
    states = KnotStates(exp(turn(knots)), still, still)
    motion = Motion(readings, states, np.tile(GYRO_BIAS, (101, 1)), still, np.zeros(3))
    t = knots[2] + np.linspace(0.0, 96.0 * h_s, 1777)
    found = motion.at(t)
    assert found.usable.all()
    return log(np.swapaxes(exp(turn(t)), 1, 2) @ found.R), found.omega_rad_s - rate(t)


@pytest.mark.parametrize(
    ("frequency_hz", "turn", "rate"), [(5.0, 2e-6, 2e-4), (15.0, 2e-4, 0.004), (40.0, 0.01, 0.06), (85.0, 0.15, 0.5)]
)
def test_what_shakes_faster_than_knots_follow_is_known_between_them(
    frequency_hz: float, turn: float, rate: float
) -> None:
    """Turns and rates, as parts of the largest. By differences from knot to knot: 2e-4, 0.013, 0.5 and 3 of the turn.

    A rotor's 85 Hz put the time offset off by 26 sigmas, and a clock was said to have been set. Mutations: differences from knot
    to knot; the two Gauss points before a knot exchanged; the side left out of the rate's derivative.
    """
    off, off_rate = _shaken(frequency_hz, 0.01)
    assert np.abs(off).max() < turn * 5e-4
    assert np.abs(off_rate).max() < rate * 5e-4 * 2.0 * np.pi * frequency_hz


def test_of_rarer_readings_knots_tell_what_is_between_them() -> None:
    """Where half a spacing is more than a substep. Mutation: a link's first two Gauss points taken as those of half of it."""
    off, _ = _shaken(2.0, 0.02, substeps=4)
    assert np.abs(off).max() < 3e-4 * 5e-4


def test_the_lidar_rides_on_the_imu() -> None:
    """Fails when the lever arm is turned by R_imu_lidar, or the lidar's velocity leaves out the swing of the arm."""
    t = 3.2 + np.linspace(0.0, 1.6, 333)
    found = _motion(0.01).lidar_at(t, TRUTH.R_imu_lidar, TRUTH.p_imu_lidar)
    true = TRUTH.lidar(t)
    np.testing.assert_allclose(found.R, true.R_world, atol=1e-6)
    np.testing.assert_allclose(found.p, true.p_m, atol=4e-7)
    np.testing.assert_allclose(found.omega_rad_s, true.omega_rad_s, atol=3e-4)
    v_lidar = np.einsum("nji,nj->ni", true.R_world, true.v_m_s)
    np.testing.assert_allclose(found.v_m_s, v_lidar, atol=1e-4)


def test_poses_are_given_only_where_they_are_known() -> None:
    """Fails when a knot's silent side is told by its own index on both sides (linked[k] for later instants too)."""
    linked = np.ones(200, bool)
    linked[50:52] = False
    motion = _motion(0.01, linked=linked)
    t = np.array([2.99, 2.996, 3.001, 3.499, 3.501, 3.506, 3.519, 3.521, 4.999, 5.004, 5.02])
    usable = np.array([0, 0, 1, 1, 0, 0, 0, 1, 1, 0, 0], bool)
    np.testing.assert_array_equal(motion.at(t).usable, usable)


@pytest.mark.parametrize("shift_s", [0.0, 0.0049, -0.0049])
def test_the_nearest_knot_is_the_nearest(shift_s: float) -> None:
    """Fails when instants are floored to the knot before them."""
    motion = _motion(0.01)
    k = np.arange(200)
    np.testing.assert_array_equal(motion.nearest_knot(motion.readings.knots_s[k] + shift_s), k)
    np.testing.assert_array_equal(motion.nearest_knot(np.array([-1e3, 1e3])), [0, 200])
