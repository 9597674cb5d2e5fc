"""What an IMU reads of a motion: samples or averages, with bias, noise, random walks and steps of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.worlds.motions import GRID_HZ, Motion
from calib_core.types import FloatArray

_GRAVITY_M_S2 = 9.81
_UP_M_S2 = np.array([0.0, 0.0, _GRAVITY_M_S2])
_GYRO_STEP_RAD_S = np.radians(1000.0) / 32768
_ACCEL_STEP_M_S2 = 8 * _GRAVITY_M_S2 / 32768


@dataclass(frozen=True)
class Imu:
    """rate_hz; averages: each reading is the mean over its period.   noise, walk: gyroscope and accelerometer, SI."""

    rate_hz: float
    averages: bool
    noise: tuple[float, float]
    walk: tuple[float, float]


#: Industrial, cheap and in between.
GRADES = (
    ((8e-5, 8e-4), (3e-6, 4e-5)),
    ((2e-4, 2e-3), (1e-5, 1e-4)),
    ((3e-4, 3e-3), (2e-5, 3e-4)),
)


def readings(rng: np.random.Generator, imu: Imu, motion: Motion, duration_s: float) -> tuple[FloatArray, ...]:
    """(Q,) s, (Q, 3) rad/s, (Q, 3) m/s2 without what is wrong with its axes (faults.py)."""
    t = motion.time_s
    # Between two instants of the grid the turn, and about each of them the acceleration, are what they are on average.
    turns = (motion.rotation[:-1].inv() * motion.rotation[1:]).as_rotvec()
    a = np.zeros_like(motion.p_m)
    a[1:-1] = (motion.p_m[2:] - 2 * motion.p_m[1:-1] + motion.p_m[:-2]) * GRID_HZ**2
    force = motion.rotation.inv().apply(a + _UP_M_S2)
    at_s = np.arange(0.0, duration_s, 1 / imu.rate_hz)
    angle = np.vstack([np.zeros(3), np.cumsum(turns, axis=0)])
    velocity = np.vstack([np.zeros(3), np.cumsum(0.5 * (force[1:] + force[:-1]), axis=0)]) / GRID_HZ
    over_s = 1 / imu.rate_hz if imu.averages else 2 / GRID_HZ
    gyro, accel = (_means(at_s, over_s, t, whole) for whole in (angle, velocity))
    out = []
    for clean, noise, walk, bias, step in zip(
        (gyro, accel), imu.noise, imu.walk, (0.005, 0.05), (_GYRO_STEP_RAD_S, _ACCEL_STEP_M_S2), strict=True
    ):
        drift = np.cumsum(rng.normal(0, walk / np.sqrt(imu.rate_hz), clean.shape), axis=0)
        read = clean + rng.normal(0, bias, 3) + drift + rng.normal(0, noise * np.sqrt(imu.rate_hz), clean.shape)
        out.append(np.round(read / step) * step)
    return at_s, out[0], out[1]


def _means(at_s: FloatArray, over_s: float, t: FloatArray, whole: FloatArray) -> FloatArray:
    """(Q, 3), the mean rate of what grows as whole (N, 3) does, over so long about each instant."""
    after, before = (
        np.stack([np.interp(at_s + side * over_s, t, column) for column in whole.T], axis=1) for side in (0.5, -0.5)
    )
    return np.asarray((after - before) / over_s)
