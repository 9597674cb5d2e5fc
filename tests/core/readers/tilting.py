"""Readings of an IMU that is tilted to and fro."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.types import FloatArray

RATE = 100.0


def tilting(duration_s: float = 30.0, *, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Rates (Q, 3) [rad/s] and specific force (Q, 3) of a rig turned about all axes after 3 s of stillness.

    The attitude is integrated with SciPy's rotations in small steps: nothing here is shared with the reader.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(int(duration_s * RATE)) / RATE
    rates = np.stack(
        [np.deg2rad(25) * np.sin(2 * np.pi * f * times + p) for f, p in ((0.23, 0.3), (0.31, 1.0), (0.41, 2.0))], 1
    )
    rates[times < 3.0] = 0
    attitude = Rotation.identity()
    force = np.empty((times.size, 3))
    for k in range(times.size):
        force[k] = attitude.inv().apply([0, 0, 9.81])
        attitude = attitude * Rotation.from_rotvec(rates[k] / RATE)
    return rates + rng.normal(0, 2e-3, rates.shape), force + rng.normal(0, 0.02, force.shape)
