"""Loops over points for the parts of planes that are known, compiled. Twins in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.factors.cell_kernels import cell_of
from calib_core.types import BoolArray, FloatArray


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _owner(
    x: float, y: float, z: float, normals: FloatArray, offsets: FloatArray, eye_at: FloatArray, near_m: float
) -> int:
    """The plane nearest to a point, seen from its front, within near_m; -1 for none. eye_at: (P,) of the eye from each."""
    owner, nearest = -1, near_m
    for j in range(normals.shape[0]):
        value = offsets[j] + normals[j, 0] * x + normals[j, 1] * y + normals[j, 2] * z
        if abs(value) < nearest and value < eye_at[j]:
            nearest = abs(value)
            owner = j
    return owner


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fill(reach: BoolArray, plane: int, row: int, column: int, around: int) -> bool:
    """Adds a cell's neighbours; whether one was new."""
    width, changed = reach.shape[1], False
    for r in range(max(row - around, 0), min(row + around + 1, width)):
        for c in range(max(column - around, 0), min(column + around + 1, width)):
            if not reach[plane, r, c]:
                reach[plane, r, c] = True
                changed = True
    return changed


@numba.njit(cache=True, nogil=True, error_model="numpy")
def spread_kernel(
    x_map: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    reach: BoolArray,
    cell_m: float,
    near_m: float,
    near_per_m: float,
    widen_cells: float,
    eye: FloatArray,
    passes: int,
) -> None:
    """Lets planes reach on: a point near a plane, in a cell that it reaches, adds that cell's neighbours; in `passes` rounds.

    x_map: (N, 3) map.   eye: (3,) from where they were seen.   reach: (P, W, W), changed.   A point speaks for the plane
    nearest to it alone. Far away rings are wide apart: one more cell every `widen_cells` cells of range.
    """
    width, n = reach.shape[1], x_map.shape[0]
    eye_at = np.empty(normals.shape[0])
    for j in range(normals.shape[0]):
        eye_at[j] = offsets[j] + normals[j, 0] * eye[0] + normals[j, 1] * eye[1] + normals[j, 2] * eye[2]
    # Those in cells that are not reached yet, which a later round may: plane, row, column, cells around.
    waiting, left, changed = np.empty((n, 4), np.int64), 0, False
    for i in range(n):
        x, y, z = x_map[i, 0], x_map[i, 1], x_map[i, 2]
        away = np.sqrt((x - eye[0]) ** 2 + (y - eye[1]) ** 2 + (z - eye[2]) ** 2)
        j = _owner(x, y, z, normals, offsets, eye_at, near_m + near_per_m * away)
        if j < 0:
            continue
        row = cell_of(axes[j, 0, 0] * x + axes[j, 0, 1] * y + axes[j, 0, 2] * z, cell_m, width)
        column = cell_of(axes[j, 1, 0] * x + axes[j, 1, 1] * y + axes[j, 1, 2] * z, cell_m, width)
        around = 1 + int(away / (widen_cells * cell_m))
        if reach[j, row, column]:
            changed |= _fill(reach, j, row, column, around)
        else:
            waiting[left, 0], waiting[left, 1], waiting[left, 2], waiting[left, 3] = j, row, column, around
            left += 1
    for _ in range(passes - 1):
        if not changed:
            break
        changed, still = False, 0
        for i in range(left):
            j, row, column = waiting[i, 0], waiting[i, 1], waiting[i, 2]
            if reach[j, row, column]:
                changed |= _fill(reach, j, row, column, waiting[i, 3])
            else:
                waiting[still, :] = waiting[i, :]
                still += 1
        left = still
