"""Where points lie between the heights of bent surfaces, compiled. It has a NumPy twin in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import BoolArray, FloatArray, IntArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def between_kernel(
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    axes: FloatArray,
    origin: FloatArray,
    width_m: float,
    half: float,
    numbers: IntArray,
    there: BoolArray,
    square: IntArray,
    share: FloatArray,
) -> None:
    """Fills square (N,) and share (N, 4): patches.Between.

    plane, slice_index: (N,).   x_hit: (N, 3).   axes (S, P, 2, 3), origin (S, P, 2): of the planes, from each slice.
    width_m, half: of a patch, and of a plane's grid in such widths.   numbers: (P, rows, columns) of the squares, -1: none.
    there: (Q, 4) which corners a square has; what others would have is theirs.
    """
    none = there.shape[0]
    for i in range(plane.shape[0]):
        j, s = plane[i], slice_index[i]
        square[i] = none
        share[i, 0] = share[i, 1] = share[i, 2] = share[i, 3] = 0.0
        if j < 0:
            continue
        row = _along(axes[s, j, 0], origin[s, j, 0], x_hit[i], width_m, half)
        column = _along(axes[s, j, 1], origin[s, j, 1], x_hit[i], width_m, half)
        # The square before a patch's middle has its number.
        r, c = int(np.floor(row)), int(np.floor(column))
        if not (0 <= r < numbers.shape[1] and 0 <= c < numbers.shape[2]) or numbers[j, r, c] < 0:
            continue
        q, below, right = numbers[j, r, c], row - r, column - c
        square[i] = q
        total = 0.0
        for corner in range(4):
            if there[q, corner]:
                one = (below if corner >= 2 else 1.0 - below) * (right if corner % 2 == 1 else 1.0 - right)
                share[i, corner] = one
                total += one
        if total > 0.0:
            for corner in range(4):
                share[i, corner] /= total


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _along(axis: FloatArray, origin: float, x: FloatArray, width_m: float, half: float) -> float:
    """Where a hit lies along an axis of its plane's grid, in widths of a patch, from half a one before the first patch."""
    return (origin + axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2]) / width_m + half + 0.5
