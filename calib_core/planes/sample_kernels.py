"""Loops that take some of a scan's points, compiled. Twins in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import CountArray, Float32Array, FloatArray, IntArray

#: (sqrt(5) - 1) / 2: its multiples modulo one are spread as evenly as any sequence's.
_GOLDEN = 0.6180339887498949


@numba.njit(cache=True, nogil=True, error_model="numpy")
def places_kernel(n: int, count: int) -> IntArray:
    """Places among n, in order, that the first multiples of the golden ratio fall on, modulo one."""
    taken = np.zeros(n, np.bool_)
    for k in range(count if n > 0 else 0):
        turns = k * _GOLDEN
        taken[int((turns - np.floor(turns)) * n)] = True
    places, at = np.empty(min(n, count), np.int64), 0
    for i in range(n):
        if taken[i]:
            places[at] = i
            at += 1
    return places[:at]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def take_kernel(points: Float32Array, times_ns: CountArray, which: IntArray, xyz: FloatArray, tau: FloatArray) -> None:
    """Fills xyz (K, 3) [m] and tau (K,) [s] with some of points (N, 3) and their times (N,), columns of records. which: (K,)."""
    for i in range(which.shape[0]):
        k = which[i]
        for a in range(3):
            xyz[i, a] = points[k, a]
        tau[i] = times_ns[k] * 1e-9
