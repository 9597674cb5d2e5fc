"""Loops over hits in the cells of their planes, compiled. Each has a plain NumPy twin in the tests."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from calib_core.types import BoolArray, CountArray, Float32Array, FloatArray, IntArray


class Grids(NamedTuple):
    """The planes' cells as the lidar sees them from the middles of slices.

    u: (S, P, 2, 3) the planes' in-plane axes; origin: (S, P, 2) the lidar's in-plane coordinates.   half: cells on each side.
    """

    u: FloatArray
    origin: FloatArray
    cell_m: float
    half: int


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def cell_of(value_m: float, cell_m: float, width: int) -> int:
    """Row or column of an in-plane coordinate in a grid `width` cells wide about the origin; the rim takes what is beyond."""
    return min(max(int(np.floor(value_m / cell_m)) + width // 2, 0), width - 1)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cells_kernel(
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    grids: Grids,
    cell: IntArray,
) -> None:
    """Fills cell (N, 2): row and column of each hit in its plane's grid, -1 where plane is -1."""
    u, origin, cell_m, half = grids
    for i in range(plane.shape[0]):
        j, k = plane[i], slice_index[i]
        cell[i, 0] = -1
        cell[i, 1] = -1
        if j < 0:
            continue
        for a in range(2):
            value = origin[k, j, a]
            for b in range(3):
                value += u[k, j, a, b] * x_hit[i, b]
            cell[i, a] = cell_of(value, cell_m, 2 * half)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def near_kernel(
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    grids: Grids,
    near_m: float,
    noise_m: tuple[float, float],
    on_gate: tuple[float, float],
    off_gate: tuple[float, float],
    near: IntArray,
    cell: IntArray,
    on_plane: BoolArray,
    off: FloatArray,
) -> int:
    """Hits nearer to their planes than near_m: which, in what cells, whether on the plane, and how far off. Returns how many.

    noise_m: along the ray and across the plane.   on_gate, off_gate: so many standard deviations and so much more: the first
    tells what is on, the second is the unit of off.   near, on_plane, off: (N,), cell: (N, 2), filled from their beginning.
    """
    u, origin, cell_m, half = grids
    count = 0
    for i in range(plane.shape[0]):
        j, k = plane[i], slice_index[i]
        if j < 0 or not abs(d[i]) < near_m:
            continue
        std = np.sqrt((noise_m[0] * cosine[i]) ** 2 + noise_m[1] ** 2)
        for a in range(2):
            value = origin[k, j, a]
            for b in range(3):
                value += u[k, j, a, b] * x_hit[i, b]
            cell[count, a] = cell_of(value, cell_m, 2 * half)
        near[count] = j
        on_plane[count] = abs(d[i]) < on_gate[0] * std + on_gate[1]
        off[count] = d[i] / (off_gate[0] * std + off_gate[1])
        count += 1
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def count_kernel(
    plane: IntArray,
    cell: IntArray,
    on_plane: BoolArray,
    off: FloatArray,
    on: CountArray,
    beside: CountArray,
    total: Float32Array,
    box: IntArray,
) -> None:
    """Counts hits in cells (N, 2) of their planes (N,): in `on` or in `beside` (P, rows, columns).

    total: (P, rows, columns), the sum of `off` (N,) over those on the plane.

    box: (P, 4) lowest row and column, highest row and column of those on the plane, widened as they come.
    """
    for i in range(plane.shape[0]):
        j, r, c = plane[i], cell[i, 0], cell[i, 1]
        if not on_plane[i]:
            beside[j, r, c] += 1
            continue
        on[j, r, c] += 1
        total[j, r, c] += off[i]
        box[j, 0], box[j, 1] = min(box[j, 0], r), min(box[j, 1], c)
        box[j, 2], box[j, 3] = max(box[j, 2], r), max(box[j, 3], c)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def lies_within(
    x: float, y: float, z: float, k: int, j: int, u: FloatArray, origin: FloatArray, cell_m: float, half: int, inside: BoolArray
) -> bool:  # fmt: skip
    """Whether a hit on plane j, seen from slice k, lies in one of its cells (P, rows, columns). u, origin: as in Grids."""
    row = origin[k, j, 0] + u[k, j, 0, 0] * x + u[k, j, 0, 1] * y + u[k, j, 0, 2] * z
    column = origin[k, j, 1] + u[k, j, 1, 0] * x + u[k, j, 1, 1] * y + u[k, j, 1, 2] * z
    return inside[j, cell_of(row, cell_m, 2 * half), cell_of(column, cell_m, 2 * half)]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def within_kernel(
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    grids: Grids,
    inside: BoolArray,
    keep: BoolArray,
) -> None:
    """Takes hits outside of their plane's cells out of keep (N,). inside: (P, rows, columns)."""
    u, origin, cell_m, half = grids
    for i in range(plane.shape[0]):
        if not keep[i]:
            continue
        j, k = plane[i], slice_index[i]
        keep[i] = lies_within(x_hit[i, 0], x_hit[i, 1], x_hit[i, 2], k, j, u, origin, cell_m, half, inside)
