"""Axes within planes."""

from __future__ import annotations

import numpy as np

from calib_core.geometry.so3 import cross
from calib_core.types import FloatArray


def plane_axes(normals: FloatArray) -> FloatArray:
    """Two unit vectors that span each plane: (e1, e2, normal) is right-handed. normals: (..., 3). Returns (..., 2, 3)."""
    n = np.asarray(normals)
    helper = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    e1 = cross(helper, n)
    e1 /= np.linalg.norm(e1, axis=-1, keepdims=True)
    return np.stack([e1, cross(n, e1)], axis=-2)
