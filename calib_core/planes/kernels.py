"""Loops over points of the search for planes, compiled. Twins in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import BoolArray, FloatArray, IntArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def band_kernel(
    points: FloatArray,
    least_along: FloatArray,
    tolerance: FloatArray,
    free: BoolArray,
    normal: FloatArray,
    offset: float,
    narrow_m: float,
    least_share: float,
    inliers: BoolArray,
) -> FloatArray:
    """Fills inliers (N,) with the free points seen face on within a band of a plane; their signed distances (K,) in order.

    The band is narrow_m wide, but least_share of each point's tolerance at the least, and all of it at the most.
    """
    a, b, c = normal[0], normal[1], normal[2]
    distance, held = np.empty(points.shape[0]), 0
    for i in range(points.shape[0]):
        along = a * points[i, 0] + b * points[i, 1] + c * points[i, 2]
        band = min(tolerance[i], max(narrow_m, least_share * tolerance[i]))
        inliers[i] = free[i] and abs(along) > least_along[i] and abs(along + offset) < band
        if inliers[i]:
            distance[held] = along + offset
            held += 1
    return distance[:held]
