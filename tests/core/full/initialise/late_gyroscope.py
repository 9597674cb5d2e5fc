"""A gyroscope whose stamps are late."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.types import FloatArray

R_C = np.asarray(Rotation.from_euler("xyz", [40.0, -70.0, 130.0], degrees=True).as_matrix())
LAG_S = -0.37


def turning_rate(t_s: FloatArray, tempo: float = 1.0) -> FloatArray:
    """(N, 3) [rad/s]: two waves on every axis, as a hand swings."""
    t = tempo * t_s[:, None]
    first = np.array([0.5, 0.4, 0.3]) * np.sin(np.array([2.1, 2.6, 1.7]) * t + np.array([0.0, 1.0, 2.0]))
    return np.asarray(first + 0.15 * np.sin(np.array([4.3, 3.9, 4.8]) * t + np.array([2.0, 0.5, 1.0])))


def late_gyroscope(tempo: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Stamps (N,) [s], and rates (N, 3) [rad/s] about axes that are turned by R_C."""
    t = np.arange(-1.0, 13.0, 0.005)
    return t - LAG_S, turning_rate(t, tempo) @ R_C.T
