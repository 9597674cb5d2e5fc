"""Normal equations of links and bins added block by block, compiled. Each has a NumPy twin in the tests.

Why compiled: a link touches two knots, gravity and two bias nodes, a bin one knot, the calibration and one plane. Written
as products of whole arrays, nearly all of the arithmetic would be with zeros, and it would grow with the recording twice
over: more links, and more bias nodes a link.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import FloatArray, IntArray

#: Links whose rows are multiplied at once: a hundred kilobytes of them, with the columns that a solve has as a rule.
_TOGETHER = 32


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _bias_columns(left: int, start: int, nodes: int, column: IntArray) -> None:
    """Fills column (C,) from its fourth on: of the node on the left, its gyroscope's and accelerometer's; then of the next.

    start: of the gyroscope's nodes, so many, which those of the accelerometer follow; a single one has none next to it.
    """
    for c in range(3):
        column[3 + c] = start + 3 * left + c
        column[6 + c] = start + 3 * (nodes + left) + c
        if nodes > 1:
            column[9 + c] = start + 3 * (left + 1) + c
            column[12 + c] = start + 3 * (nodes + left + 1) + c


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_in_place(
    own: FloatArray, force: FloatArray, column: IntArray, corner: FloatArray, gradient_shared: FloatArray
) -> None:
    """Adds the upper triangle of own (C, C) and force (C,) to the shared columns (C,)."""
    for c in range(column.shape[0]):
        gradient_shared[column[c]] += force[c]
        corner[column[c], column[c]] += own[c, c]
        for e in range(c + 1, column.shape[0]):
            corner[column[c], column[e]] += own[c, e]
            corner[column[e], column[c]] += own[c, e]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_links_kernel(
    first: FloatArray,
    second: FloatArray,
    D_gravity: FloatArray,
    D_gyro: FloatArray,
    D_accel: FloatArray,
    D_nuisance: FloatArray,
    residual: FloatArray,
    node: IntArray,
    fraction: FloatArray,
    nodes: int,
    gravity_start: int,
    nuisance_column: IntArray,
    window: IntArray,
    width: int,
    diagonal: FloatArray,
    lower: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds J' J and J' r of whitened links to an arrow system (solver/arrow.py).

    first, second: (L, 9, 9) by the link's two knots.   D_gravity, D_gyro, D_accel: (L, 9, 3).   residual: (L, 9).
    D_nuisance: (L, 9, N), in the shared columns nuisance_column (N,).
    node, fraction: (L,): the bias is (1 - fraction) of node and fraction of the next; one node where nodes is 1.
    gravity_start: column of gravity; gyro bias nodes follow it, accelerometer nodes follow those.   window: (K,) the first node
    that a knot's border has, of so many: what follows the nodes comes that much earlier in it (Layout.known_to_knots).
    """
    links = first.shape[0]
    extra = nuisance_column.shape[0]
    walking = 15 if nodes > 1 else 9
    per_link = walking + extra
    # Rows of links between the same two nodes, which share their columns, are multiplied with each other by the dozen.
    rows, pulls, filled = np.empty((9 * _TOGETHER, per_link)), np.empty(9 * _TOGETHER), 0
    border_first, border_second = np.empty((9, per_link)), np.empty((9, per_link))
    column = np.empty(per_link, np.int64)
    place = np.empty((2, per_link), np.int64)
    for c in range(3):
        column[c] = place[0, c] = place[1, c] = gravity_start + c
    for c in range(extra):
        column[walking + c] = nuisance_column[c]
        place[0, walking + c] = place[1, walking + c] = nuisance_column[c] - 6 * (nodes - width)
    for link in range(links):
        k, left, f = link, node[link], fraction[link]
        _bias_columns(left, gravity_start + 3, nodes, column)
        for end in range(2):
            _bias_columns(left - window[k + end], gravity_start + 3, width, place[end])
        shared = rows[filled : filled + 9]
        for r in range(9):
            for c in range(3):
                shared[r, c] = D_gravity[link, r, c]
                shared[r, 3 + c] = (1.0 - f) * D_gyro[link, r, c]
                shared[r, 6 + c] = (1.0 - f) * D_accel[link, r, c]
                if nodes > 1:
                    shared[r, 9 + c] = f * D_gyro[link, r, c]
                    shared[r, 12 + c] = f * D_accel[link, r, c]
            for c in range(extra):
                shared[r, walking + c] = D_nuisance[link, r, c]
        # Summed up in small arrays of fixed columns, then put in place once: the inner loops run along memory.
        A, B, res = first[link], second[link], residual[link]
        pulls[filled : filled + 9] = res
        filled += 9
        border_first[:], border_second[:] = 0.0, 0.0
        for i in range(9):
            for m in range(9):
                gradient[k, i] += A[m, i] * res[m]
                gradient[k + 1, i] += B[m, i] * res[m]
            # Three rows at a time: what is added to is fetched and put back a third as often.
            for m in range(0, 9, 3):
                a0, a1, a2 = A[m, i], A[m + 1, i], A[m + 2, i]
                b0, b1, b2 = B[m, i], B[m + 1, i], B[m + 2, i]
                for j in range(9):
                    diagonal[k, i, j] += a0 * A[m, j] + a1 * A[m + 1, j] + a2 * A[m + 2, j]
                for j in range(9):
                    diagonal[k + 1, i, j] += b0 * B[m, j] + b1 * B[m + 1, j] + b2 * B[m + 2, j]
                for j in range(9):
                    lower[k, i, j] += b0 * A[m, j] + b1 * A[m + 1, j] + b2 * A[m + 2, j]
                for c in range(per_link):
                    border_first[i, c] += a0 * shared[m, c] + a1 * shared[m + 1, c] + a2 * shared[m + 2, c]
                for c in range(per_link):
                    border_second[i, c] += b0 * shared[m, c] + b1 * shared[m + 1, c] + b2 * shared[m + 2, c]
        for c in range(per_link):
            for i in range(9):
                border[k, i, place[0, c]] += border_first[i, c]
                border[k + 1, i, place[1, c]] += border_second[i, c]
        if link + 1 == links or node[link + 1] != left or filled == len(rows):
            some = rows[:filled]
            _put_in_place(np.dot(some.T, some), np.dot(some.T, pulls[:filled]), column, corner, gradient_shared)
            filled = 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_bins_kernel(
    knot: IntArray,
    plane: IntArray,
    J: FloatArray,
    scatter: FloatArray,
    scattered: FloatArray,
    planes_start: int,
    clock_column: int,
    squeezed: int,
    diagonal: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds J' M J and J' M a of bins to an arrow system: knot's 9, the calibration's first 7 columns, the plane's 3.

    knot, plane: (B,).   J: (B, 4, 19) of [n_lidar, w_lidar], or (B, 4, 20) where the clocks' rate has a column.
    scatter: (B, 5, 5) M.   scattered: (B, 5) M a.   planes_start: column of the first plane.   clock_column: of the rate.
    squeezed: by so much these come earlier in a knot's border (Layout.squeezed).
    """
    width = J.shape[2]
    weighted, own = np.empty((4, width)), np.empty((width, width))
    for b in range(knot.shape[0]):
        # J' M J of the bin by itself, in loops along memory: put in place it is in a dozen places.
        for i in range(4):
            w0, w1, w2, w3 = scatter[b, i, 0], scatter[b, i, 1], scatter[b, i, 2], scatter[b, i, 3]
            for c in range(width):
                weighted[i, c] = w0 * J[b, 0, c] + w1 * J[b, 1, c] + w2 * J[b, 2, c] + w3 * J[b, 3, c]
        for i in range(width):
            j0, j1, j2, j3 = J[b, 0, i], J[b, 1, i], J[b, 2, i], J[b, 3, i]
            for c in range(width):
                own[i, c] = j0 * weighted[0, c] + j1 * weighted[1, c] + j2 * weighted[2, c] + j3 * weighted[3, c]
        k, at_plane = knot[b], planes_start + 3 * plane[b]
        f0, f1, f2, f3 = scattered[b, 0], scattered[b, 1], scattered[b, 2], scattered[b, 3]
        for i in range(width):
            force = f0 * J[b, 0, i] + f1 * J[b, 1, i] + f2 * J[b, 2, i] + f3 * J[b, 3, i]
            if i < 9:
                gradient[k, i] += force
                for j in range(9):
                    diagonal[k, i, j] += own[i, j]
                for c in range(7):
                    border[k, i, c] += own[i, 9 + c]
                for c in range(3):
                    border[k, i, at_plane - squeezed + c] += own[i, 16 + c]
                if width > 19:
                    border[k, i, clock_column - squeezed] += own[i, 19]
                continue
            row = i - 9 if i < 16 else at_plane + i - 16 if i < 19 else clock_column
            gradient_shared[row] += force
            for c in range(7):
                corner[row, c] += own[i, 9 + c]
            for c in range(3):
                corner[row, at_plane + c] += own[i, 16 + c]
            if width > 19:
                corner[row, clock_column] += own[i, 19]
