"""Axes within planes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from calib_core.geometry.so3 import cross
from calib_core.types import FloatArray


def plane_axes(normals: FloatArray) -> FloatArray:
    """Two unit vectors that span each plane: (e1, e2, normal) is right-handed. normals: (..., 3). Returns (..., 2, 3)."""
    n = np.ascontiguousarray(normals, dtype=np.float64)
    return _axes_of(n.tobytes(), n.shape)


@lru_cache(maxsize=64)
def _axes_of(data: bytes, shape: tuple[int, ...]) -> FloatArray:
    """The axes of one set of normals, asked for scan after scan; not to be written to."""
    n = np.frombuffer(data).reshape(shape)
    helper = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    e1 = cross(helper, n)
    e1 /= np.linalg.norm(e1, axis=-1, keepdims=True)
    axes = np.stack([e1, cross(n, e1)], axis=-2)
    axes.flags.writeable = False
    return axes
