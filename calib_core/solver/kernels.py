"""Elimination of a chain of small blocks, compiled. SciPy's banded solver is its twin in the tests.

    L_k L_k' = D_k - M_k M_k',   M_k = E_{k-1} L_{k-1}'^-1,   W_k = L_k^-1 (B_k - M_k W_{k-1})

so that B' A^-1 B = sum of W_k' W_k: the border needs the forward pass alone, and one column the way back.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import FloatArray


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
