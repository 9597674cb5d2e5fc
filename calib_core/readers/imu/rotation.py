"""Rotation matrices of small turns, for the checks of this package only (readers know nothing of geometry)."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray


def rotation_matrices(rotvec: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations by the rotation vectors (N, 3) [rad], by Rodrigues' formula."""
    angle = np.linalg.norm(rotvec, axis=1)
    axis = rotvec / np.where(angle > 0, angle, 1.0)[:, None]
    x, y, z = axis.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, versine = np.sin(angle)[:, None, None], (1 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross), np.float64)
