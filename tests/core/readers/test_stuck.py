"""An axis that is stuck, beside sensors that have reasons to read one number twice."""

from __future__ import annotations

import numpy as np

from calib_core.readers.imu.stuck import stuck_axis
from calib_core.types import FloatArray

T = np.arange(1000) * 0.01


def _said(gyro: FloatArray, accel: FloatArray) -> str:
    found = stuck_axis(np.rint(T * 1e9).astype(np.int64), gyro, accel, "/imu")
    return "" if found is None else found.text


def _noisy(seed: int, size: float) -> FloatArray:
    return np.asarray(size * np.random.default_rng(seed).standard_normal((len(T), 3)))


def test_the_axis_is_named_and_since_when() -> None:
    """Mutations: another axis; the longest run of readings that do change; the sensor's other axes not asked."""
    gyro, accel = _noisy(1, 1e-3), _noisy(2, 1e-2)
    assert _said(gyro, accel) == ""
    accel[300:, 1] = accel[300, 1]
    assert _said(gyro, accel).startswith(
        f"The accelerometer's y axis on /imu reads {accel[300, 1]:.4g} m/s² and nothing else for 7.0 s, from 3.0 s"
    )
    gyro[:, 2] = 0.0
    assert _said(gyro, accel).startswith(
        "The gyroscope's z axis on /imu reads 0 rad/s and nothing else for 10.0 s, from 0.0 s on"
    )


def test_readings_that_are_held_coarse_or_stuck_for_a_moment_are_none() -> None:
    """Mutations: half a second is enough; asked of no other axis; of its own readings otherwise nothing."""
    gyro, accel = _noisy(3, 1e-3), _noisy(4, 1e-2)
    moment = gyro.copy()
    moment[200:290, 0] = moment[200, 0]
    assert _said(moment, accel) == ""
    held = gyro.copy()
    held[200:500] = held[200]
    assert _said(held, accel) == ""
    coarse = accel.copy()
    coarse[:, 2] = np.rint(np.sin(0.3 * T) * 4.0) * 0.05  # turns slowly past a step every half second
    assert _said(gyro, coarse) == ""
