"""What a perfect lidar-only track and the IMU beside it give of a simulated motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.initialise.start import LidarTrack
from calib_core.geometry import log
from calib_core.simulate import SCENARIOS, Scenario, Truth
from calib_core.simulate.motions import PAPER_FAST
from calib_core.types import FloatArray

SWEEP_S = 0.1
GYRO_BIAS, ACCEL_BIAS = np.array([0.01, -0.02, 0.015]), np.array([0.1, -0.05, 0.08])
SCENARIO = replace(SCENARIOS["paper-normal"], motion=PAPER_FAST)


def truth_of(scenario: Scenario) -> Truth:
    """The motion of a scenario, with all times counted from 0 and an IMU without biases."""
    return Truth(scenario, 0, 0, 0, np.zeros(3), np.zeros(3))


def tracked_lidar(truth: Truth, first_s: float, last_s: float, *, noise: float = 0.0) -> LidarTrack:
    """What a perfect lidar-only track gives: poses at the sweeps' starts and the mean rates within them."""
    start = np.arange(first_s, last_s, SWEEP_S)
    R0, p0 = truth.map_lidar(start)
    R1, p1 = truth.map_lidar(start + SWEEP_S)
    rng = np.random.default_rng(0)
    omega = log(np.swapaxes(R0, 1, 2) @ R1) / SWEEP_S + noise * rng.normal(size=(len(start), 3))
    return LidarTrack(start, np.full(len(start), SWEEP_S), R0, p0, omega, (p1 - p0) / SWEEP_S, np.zeros_like(R0))


def imu_readings(
    truth: Truth, first_s: float, last_s: float, offset_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stamps on the IMU's own clock, and biased readings without noise, 100 Hz."""
    t = np.arange(first_s, last_s, 0.01)
    at = truth.imu(t)
    force = np.einsum("nji,nj->ni", at.R_world, at.a_m_s2 - truth.gravity_world_m_s2)
    return t - offset_s, at.omega_rad_s + GYRO_BIAS, force + ACCEL_BIAS
