"""Loops over a cloud's points, compiled: masks and packing, each with a plain NumPy twin in the tests.

A minute of recording is tens of millions of points; NumPy alone spends its time in temporaries of a few hundred
kilobytes each, which the system hands out page by page. Compiled code lets the interpreter go, so scans are packed on
several threads at once.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from calib_core.types import BoolArray, Float32Array, FloatArray

#: Added and taken away again it rounds a float64 below 2**51 to the nearest integer, halves to even, as np.rint does.
_ROUND = 6755399441055744.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_valid(
    x: Float32Array,
    y: Float32Array,
    z: Float32Array,
    times_ns: FloatArray,
    limits_m2: tuple[np.float32, np.float32],
    limits_ns: tuple[float, float],
    keep: BoolArray,
) -> tuple[int, int, float]:
    """Fills keep (N,): a return between the squared ranges, its time inside the limits.

    Rounds the kept times_ns (N,) in place. Returns how many returned, how many are kept, and the least kept time.
    NaN and infinite coordinates or times fail every comparison.
    """
    n_returned = 0
    for i in range(x.shape[0]):
        squared = x[i] * x[i] + y[i] * y[i] + z[i] * z[i]
        returned = (squared >= limits_m2[0]) & (squared <= limits_m2[1])
        n_returned += returned
        keep[i] = returned & (times_ns[i] >= limits_ns[0]) & (times_ns[i] <= limits_ns[1])
    n_kept = 0
    first_ns = np.inf
    for i in range(x.shape[0]):
        if keep[i]:
            n_kept += 1
            times_ns[i] = (times_ns[i] + _ROUND) - _ROUND
            first_ns = min(first_ns, times_ns[i])
    return n_returned, n_kept, first_ns


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pack_points(
    x: Float32Array,
    y: Float32Array,
    z: Float32Array,
    intensity: Float32Array,
    ring: NDArray[np.uint16],
    times_ns: FloatArray,
    first_ns: float,
    keep: BoolArray,
    out_floats: Float32Array,
    out_ints: NDArray[np.int32],
) -> None:
    """Fills the kept points' records, one after the other; out_floats and out_ints are two views of them, 6 words each."""
    at = 0
    for i in range(x.shape[0]):
        if keep[i]:
            out_floats[at] = x[i]
            out_floats[at + 1] = y[i]
            out_floats[at + 2] = z[i]
            out_floats[at + 3] = intensity[i]
            out_ints[at + 4] = np.int32(times_ns[i] - first_ns)
            out_ints[at + 5] = np.int32(ring[i])  # the ring, and zero in the reserved half above it
            at += 6
