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
    ours: int,
    diagonal: FloatArray,
    lower: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds J' J and J' r of whitened links in a row to a part of an arrow system (solver/system.py), of L + 1 knots.

    first, second: (L, 9, 9) by the link's two knots.   D_gravity, D_gyro, D_accel: (L, 9, 3).   residual: (L, 9).
    D_nuisance: (L, 9, N), in the shared columns nuisance_column (N,).
    node, fraction: (L,): the bias is (1 - fraction) of node and fraction of the next, of so many nodes that the part knows; one
    alone has no next.   gravity_start: column of gravity; gyro bias nodes follow it, accelerometer nodes follow those.
    ours: the first link whose shared columns are this part's own business; those before it are counted in another.
    lower: (L, 9, 9), a link's second knot with its first.
    """
    links = first.shape[0]
    extra = nuisance_column.shape[0]
    walking = 15 if nodes > 1 else 9
    per_link = walking + extra
    # Rows of links between the same two nodes, which share their columns, are multiplied with each other by the dozen.
    rows, pulls, filled = np.empty((9 * _TOGETHER, per_link)), np.empty(9 * _TOGETHER), 0
    border_first, border_second = np.empty((9, per_link)), np.empty((9, per_link))
    column = np.empty(per_link, np.int64)
    for c in range(3):
        column[c] = gravity_start + c
    for c in range(extra):
        column[walking + c] = nuisance_column[c]
    for link in range(links):
        k, left, f = link, node[link], fraction[link]
        _bias_columns(left, gravity_start + 3, nodes, column)
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
        for i in range(9):
            for c in range(per_link):
                border[k, i, column[c]] += border_first[i, c]
                border[k + 1, i, column[c]] += border_second[i, c]
        if link < ours:
            continue
        filled += 9
        if link + 1 == links or node[link + 1] != left or filled == len(rows):
            some = rows[:filled]
            _put_in_place(np.dot(some.T, some), np.dot(some.T, pulls[:filled]), column, corner, gradient_shared)
            filled = 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def links_times_kernel(
    first: FloatArray,
    second: FloatArray,
    D_gravity: FloatArray,
    D_gyro: FloatArray,
    D_accel: FloatArray,
    gravity: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    out: FloatArray,
) -> None:
    """Adds to out (L + 1, 9, m) what links as in `add_links_kernel` say of their knots: J' J of them times columns of gravity
    (3, m) and of each link's biases (L, 3, m), the sensors' parameters among these.
    """
    count = out.shape[2]
    response = np.empty((9, count))
    for link in range(first.shape[0]):
        for r in range(9):
            row = response[r]
            row[:] = 0.0
            for j in range(3):
                g, w, a = D_gravity[link, r, j], D_gyro[link, r, j], D_accel[link, r, j]
                for c in range(count):
                    row[c] += g * gravity[j, c] + w * gyro[link, j, c] + a * accel[link, j, c]
        for m in range(9):
            row = response[m]
            for i in range(9):
                a, b = first[link, m, i], second[link, m, i]
                for c in range(count):
                    out[link, i, c] += a * row[c]
                    out[link + 1, i, c] += b * row[c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_bins_kernel(
    knot: IntArray,
    plane: IntArray,
    J: FloatArray,
    scatter: FloatArray,
    scattered: FloatArray,
    planes_start: int,
    clock_column: int,
    diagonal: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds J' M J and J' M a of bins to an arrow system: knot's 9, the calibration's first 7 columns, the plane's 3.

    knot, plane: (B,).   J: (B, 4, 19) of [n_lidar, w_lidar], or (B, 4, 20) where the clocks' rate has a column.
    scatter: (B, 5, 5) M.   scattered: (B, 5) M a.   planes_start: column of the first plane.   clock_column: of the rate.
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
                    border[k, i, at_plane + c] += own[i, 16 + c]
                if width > 19:
                    border[k, i, clock_column] += own[i, 19]
                continue
            row = i - 9 if i < 16 else at_plane + i - 16 if i < 19 else clock_column
            gradient_shared[row] += force
            for c in range(7):
                corner[row, c] += own[i, 9 + c]
            for c in range(3):
                corner[row, at_plane + c] += own[i, 16 + c]
            if width > 19:
                corner[row, clock_column] += own[i, 19]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def bins_times_kernel(
    knot: IntArray,
    plane: IntArray,
    J: FloatArray,
    scatter: FloatArray,
    calibration: FloatArray,
    planes: FloatArray,
    clock: FloatArray,
    crossed: FloatArray,
    out: FloatArray,
) -> None:
    """Adds to out (K, 9, m) what bins as in `add_bins_kernel` say of their knots: J' M J of them times columns, and J' crossed.

    calibration: (7, m).   planes: (P, 3, m).   clock: (1, m) of the
    clocks' rate.   crossed: (B, 4, m) what the lasers' own parameters add to M J times columns.
    """
    count, width = out.shape[2], J.shape[2]
    response, pull = np.empty((4, count)), np.empty((4, count))
    for b in range(knot.shape[0]):
        k, at = knot[b], planes[plane[b]]
        for i in range(4):
            row = response[i]
            row[:] = 0.0
            for r in range(7):
                for c in range(count):
                    row[c] += J[b, i, 9 + r] * calibration[r, c]
            for r in range(3):
                for c in range(count):
                    row[c] += J[b, i, 16 + r] * at[r, c]
            if width > 19:
                for c in range(count):
                    row[c] += J[b, i, 19] * clock[0, c]
        for i in range(4):
            w0, w1, w2, w3 = scatter[b, i, 0], scatter[b, i, 1], scatter[b, i, 2], scatter[b, i, 3]
            for c in range(count):
                pull[i, c] = (
                    crossed[b, i, c]
                    + w0 * response[0, c]
                    + w1 * response[1, c]
                    + w2 * response[2, c]
                    + w3 * response[3, c]
                )
        for r in range(9):
            j0, j1, j2, j3 = J[b, 0, r], J[b, 1, r], J[b, 2, r], J[b, 3, r]
            for c in range(count):
                out[k, r, c] += j0 * pull[0, c] + j1 * pull[1, c] + j2 * pull[2, c] + j3 * pull[3, c]
