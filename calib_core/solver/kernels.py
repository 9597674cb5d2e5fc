"""Elimination of a chain of small blocks, compiled. SciPy's banded solver is its twin in the tests.

    L_k L_k' = D_k - M_k M_k',   M_k = E_{k-1} L_{k-1}'^-1,   W_k = L_k^-1 (B_k - M_k W_{k-1})

so that B' A^-1 B = sum of W_k' W_k: the border needs the forward pass alone, and one column the way back.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import BoolArray, FloatArray, IntArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def take_rows(factors: FloatArray, rows: FloatArray, count: int, row: FloatArray) -> None:
    """Takes so many rows, each times its factor, from a row: three at a time, so that it is fetched a third as often."""
    columns = row.shape[0]
    for j in range(0, count - count % 3, 3):
        f0, f1, f2 = factors[j], factors[j + 1], factors[j + 2]
        for c in range(columns):
            row[c] -= f0 * rows[j, c] + f1 * rows[j + 1, c] + f2 * rows[j + 2, c]
    for j in range(count - count % 3, count):
        factor = factors[j]
        for c in range(columns):
            row[c] -= factor * rows[j, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
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
                take_rows(M[r], previous, n, B[r])
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
            take_rows(D[i], B, i, B[i])
            factor = 1.0 / D[i, i]
            for c in range(columns):
                B[i, c] *= factor
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def forward_kernel(L: FloatArray, M: FloatArray, y: FloatArray) -> None:
    """The forward pass of one more column in place: y (K, n) becomes L_k^-1 (y_k - M_k y_{k-1}). L, M: of eliminate_kernel."""
    knots, n, _ = L.shape
    for k in range(knots):
        for i in range(n):
            value = y[k, i]
            if k > 0:
                for c in range(n):
                    value -= M[k - 1, i, c] * y[k - 1, c]
            for j in range(i):
                value -= L[k, i, j] * y[k, j]
            y[k, i] = value / L[k, i, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def touched_kernel(border: FloatArray) -> BoolArray:
    """(C,) which columns of a border (k, n, C) are anything but zero."""
    touched = np.zeros(border.shape[2], np.bool_)
    for k in range(border.shape[0]):
        for r in range(border.shape[1]):
            for c in range(border.shape[2]):
                if border[k, r, c] != 0.0:
                    touched[c] = True
    return touched


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_kernel(
    diagonal: FloatArray,
    lower: FloatArray,
    border: FloatArray,
    gradient: FloatArray,
    scale: FloatArray,
    own: IntArray,
    damping: float,
    has_before: bool,
    D: FloatArray,
    E: FloatArray,
    W: FloatArray,
) -> None:
    """Fills D (k, n, n), E (k - 1, n, n) and W (k, n, ..) of a part's first knots (solver/system.py), in units of scale (.., n).

    W: the border's columns `own`, the knot before the part in its own units where has_before, the gradient.   damping: grows
    D's diagonal.
    """
    count, n, _ = D.shape
    width, shared = W.shape[2], own.shape[0]
    for k in range(count):
        for r in range(n):
            unit = scale[k, r]
            for c in range(n):
                D[k, r, c] = diagonal[k, r, c] * unit * scale[k, c]
            D[k, r, r] *= 1.0 + damping
            if k > 0:
                for c in range(n):
                    E[k - 1, r, c] = lower[k, r, c] * unit * scale[k - 1, c]
            for c in range(shared):
                W[k, r, c] = border[k, r, own[c]] * unit
            if has_before:
                for c in range(n):
                    W[k, r, shared + c] = lower[k, r, c] * unit if k == 0 else 0.0
            W[k, r, width - 1] = gradient[k, r] * unit


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_places_kernel(square: FloatArray, own: IntArray, theirs: IntArray, total: FloatArray) -> None:
    """Adds rows and columns `own` (F,) of a square to rows and columns `theirs` (F,) of another."""
    for i in range(own.shape[0]):
        row, into = square[own[i]], total[theirs[i]]
        for j in range(own.shape[0]):
            into[theirs[j]] += row[own[j]]
