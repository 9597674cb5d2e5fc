"""Normal equations of links and bins added block by block, compiled. Each has a NumPy twin in the tests.

Why compiled: a link touches two knots, gravity and two bias nodes, a bin one knot, the calibration and one plane. Written
as products of whole arrays, nearly all of the arithmetic would be with zeros, and it would grow with the recording twice
over: more links, and more bias nodes a link.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import FloatArray, IntArray


@numba.njit(cache=True, nogil=True)
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
    gravity_start: column of gravity; gyro bias nodes follow it, accelerometer nodes follow those.
    """
    links = first.shape[0]
    extra = nuisance_column.shape[0]
    walking = 15 if nodes > 1 else 9
    per_link = walking + extra
    shared = np.empty((9, per_link))
    border_first, border_second = np.empty((9, per_link)), np.empty((9, per_link))
    own = np.empty((per_link, per_link))
    column = np.empty(per_link, np.int64)
    gyro_start = gravity_start + 3
    accel_start = gyro_start + 3 * nodes
    for c in range(extra):
        column[walking + c] = nuisance_column[c]
    for link in range(links):
        k, left, f = link, node[link], fraction[link]
        for c in range(3):
            column[c] = gravity_start + c
            column[3 + c] = gyro_start + 3 * left + c
            column[6 + c] = accel_start + 3 * left + c
            if nodes > 1:
                column[9 + c] = gyro_start + 3 * (left + 1) + c
                column[12 + c] = accel_start + 3 * (left + 1) + c
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
        border_first[:], border_second[:], own[:] = 0.0, 0.0, 0.0
        for m in range(9):
            res = residual[link, m]
            for i in range(9):
                a, b = first[link, m, i], second[link, m, i]
                gradient[k, i] += a * res
                gradient[k + 1, i] += b * res
                for j in range(9):
                    diagonal[k, i, j] += a * first[link, m, j]
                for j in range(9):
                    diagonal[k + 1, i, j] += b * second[link, m, j]
                for j in range(9):
                    lower[k, i, j] += b * first[link, m, j]
                for c in range(per_link):
                    border_first[i, c] += a * shared[m, c]
                for c in range(per_link):
                    border_second[i, c] += b * shared[m, c]
            for c in range(per_link):
                a = shared[m, c]
                gradient_shared[column[c]] += a * res
                for e in range(per_link):
                    own[c, e] += a * shared[m, e]
        for c in range(per_link):
            for i in range(9):
                border[k, i, column[c]] += border_first[i, c]
                border[k + 1, i, column[c]] += border_second[i, c]
            for e in range(per_link):
                corner[column[c], column[e]] += own[c, e]


@numba.njit(cache=True, nogil=True)
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
    shared = width - 9
    column = np.empty(shared, np.int64)
    weighted = np.empty((4, width))
    for b in range(knot.shape[0]):
        k = knot[b]
        for c in range(7):
            column[c] = c
        for c in range(3):
            column[7 + c] = planes_start + 3 * plane[b] + c
        if shared > 10:
            column[10] = clock_column
        for i in range(4):
            for c in range(width):
                weighted[i, c] = 0.0
            for m in range(4):
                w = scatter[b, i, m]
                for c in range(width):
                    weighted[i, c] += w * J[b, m, c]
        for m in range(4):
            force = scattered[b, m]
            for i in range(9):
                value = J[b, m, i]
                if value == 0.0:
                    continue
                gradient[k, i] += value * force
                for j in range(9):
                    diagonal[k, i, j] += value * weighted[m, j]
                for c in range(shared):
                    border[k, i, column[c]] += value * weighted[m, 9 + c]
            for c in range(shared):
                value = J[b, m, 9 + c]
                gradient_shared[column[c]] += value * force
                for e in range(shared):
                    corner[column[c], column[e]] += value * weighted[m, 9 + e]
