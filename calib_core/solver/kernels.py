"""Elimination of a chain of small blocks, compiled. SciPy's banded solver is its twin in the tests.

    L_k L_k' = D_k - M_k M_k',   M_k = E_{k-1} L_{k-1}'^-1,   W_k = L_k^-1 (B_k - M_k W_{k-1})

so that B' A^-1 B = sum of W_k' W_k: the border needs the forward pass alone, and one column the way back.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import BoolArray, FloatArray, IntArray


@numba.njit(cache=True, nogil=True)
def eliminate_kernel(diagonal: FloatArray, lower: FloatArray, W: FloatArray) -> bool:
    """The forward pass in place: diagonal (K, n, n) becomes L_k, lower (K - 1, n, n) becomes M_{k+1}, W (K, n, S) from B.

    Returns False where a block is not positive definite; the arrays are then of no use.
    """
    knots, n, _ = diagonal.shape
    columns = W.shape[2]
    for k in range(knots):
        D, B = diagonal[k], W[k]
        if k > 0:
            M, before, previous = lower[k - 1], diagonal[k - 1], W[k - 1]
            for r in range(n):  # M L' = E, row by row
                for i in range(n):
                    value = M[r, i]
                    for j in range(i):
                        value -= M[r, j] * before[i, j]
                    M[r, i] = value / before[i, i]
            for r in range(n):
                for c in range(r + 1):
                    value = D[r, c]
                    for j in range(n):
                        value -= M[r, j] * M[c, j]
                    D[r, c] = value
                for j in range(n):
                    factor = M[r, j]
                    for c in range(columns):
                        B[r, c] -= factor * previous[j, c]
        for i in range(n):
            for j in range(i):
                value = D[i, j]
                for m in range(j):
                    value -= D[i, m] * D[j, m]
                D[i, j] = value / D[j, j]
            value = D[i, i]
            for m in range(i):
                value -= D[i, m] ** 2
            if not value > 1e-15:
                return False
            D[i, i] = np.sqrt(value)
            for j in range(i):
                factor = D[i, j]
                for c in range(columns):
                    B[i, c] -= factor * B[j, c]
            factor = 1.0 / D[i, i]
            for c in range(columns):
                B[i, c] *= factor
    return True


@numba.njit(cache=True, nogil=True)
def substitute_kernel(L: FloatArray, M: FloatArray, y: FloatArray) -> None:
    """The way back in place: y (K, n) becomes x with L_k' x_k = y_k - M_{k+1}' x_{k+1}. L, M: of eliminate_kernel."""
    knots, n, _ = L.shape
    for k in range(knots - 1, -1, -1):
        if k + 1 < knots:
            for r in range(n):
                for i in range(n):
                    y[k, i] -= M[k, r, i] * y[k + 1, r]
        for i in range(n - 1, -1, -1):
            value = y[k, i]
            for r in range(i + 1, n):
                value -= L[k, r, i] * y[k, r]
            y[k, i] = value / L[k, i, i]


@numba.njit(cache=True, nogil=True)
def touched_kernel(border: FloatArray, columns: IntArray, first: int, last: int) -> BoolArray:
    """Which of the columns (F,) of a border (K, n, S) are anything but zero at the knots first..last (exclusive)."""
    touched = np.zeros(columns.shape[0], np.bool_)
    for k in range(first, last):
        for r in range(border.shape[1]):
            for c in range(columns.shape[0]):
                touched[c] |= border[k, r, columns[c]] != 0.0
    return touched


@numba.njit(cache=True, nogil=True)
def fill_kernel(
    diagonal: FloatArray,
    lower: FloatArray,
    border: FloatArray,
    gradient: FloatArray,
    scale: FloatArray,
    columns: IntArray,
    damping: float,
    first: int,
    has_before: bool,
    D: FloatArray,
    E: FloatArray,
    W: FloatArray,
) -> None:
    """Fills D (k, n, n), E (k - 1, n, n) and W (k, n, ..) of a piece of a chain from its first knot on, in units of scale (K, n).

    W: the border's columns (F,), the knot before the piece where has_before, the gradient.   damping: grows D's diagonal.
    """
    count, n, _ = D.shape
    shared, width = columns.shape[0], W.shape[2]
    for i in range(count):
        k = first + i
        for r in range(n):
            own = scale[k, r]
            for c in range(n):
                D[i, r, c] = diagonal[k, r, c] * own * scale[k, c]
            D[i, r, r] *= 1.0 + damping
            if i > 0:
                for c in range(n):
                    E[i - 1, r, c] = lower[k - 1, r, c] * own * scale[k - 1, c]
            for c in range(shared):
                W[i, r, c] = border[k, r, columns[c]] * own
            if has_before:
                for c in range(n):
                    W[i, r, shared + c] = lower[k - 1, r, c] * own * scale[k - 1, c] if i == 0 else 0.0
            W[i, r, width - 1] = gradient[k, r] * own
