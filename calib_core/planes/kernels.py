"""Loops over points of the search for planes, compiled. Twins in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import FloatArray, IntArray


@numba.njit(cache=True, nogil=True)
def support_kernel(
    points: FloatArray, tolerance: FloatArray, least_along: FloatArray, normals: FloatArray, offsets: FloatArray
) -> IntArray:
    """How many points (N, 3) lie within their tolerance (N,) of each plane (H,) and are seen face on.

    least_along: (N,) of a point's component along the normal.   normals: (H, 3), offsets: (H,).
    """
    x, y, z = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    support = np.empty(normals.shape[0], np.int64)
    for h in range(normals.shape[0]):
        a, b, c, w = normals[h, 0], normals[h, 1], normals[h, 2], offsets[h]
        count = 0
        for i in range(x.shape[0]):
            along = a * x[i] + b * y[i] + c * z[i]
            count += (abs(along + w) < tolerance[i]) & (abs(along) > least_along[i])
        support[h] = count
    return support
