"""Loops over points for the parts of planes that are known, compiled. Twins in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.factors.cell_kernels import cell_of
from calib_core.full.odometry.kernels import BLOCK
from calib_core.types import BoolArray, CountArray, FloatArray


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _owners(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    held: int,
    normals: FloatArray,
    offsets: FloatArray,
    eye_at: FloatArray,
    least: FloatArray,
    which: FloatArray,
) -> None:
    """Fills least and which (held,): how far the nearest plane is of those seen from their front, and its number, -1 for none.

    eye_at: (P,) of the eye from each.   Numbers are floats, so that the machine does several points at once.
    """
    for k in range(held):
        least[k], which[k] = np.inf, -1.0
    for j in range(normals.shape[0]):
        n0, n1, n2, w, eye, number = normals[j, 0], normals[j, 1], normals[j, 2], offsets[j], eye_at[j], float(j)
        for k in range(held):
            value = w + n0 * x[k] + n1 * y[k] + n2 * z[k]
            away = abs(value) if value < eye else np.inf
            before = least[k]
            less = away < before
            which[k] = number if less else which[k]
            least[k] = away if less else before


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fill(reach: BoolArray, filled: CountArray, plane: int, row: int, column: int, around: int) -> bool:
    """Adds a cell's neighbours, where that was not done before; whether one was new."""
    width, changed = reach.shape[1], False
    if filled[plane, row, column] >= around:
        return False
    filled[plane, row, column] = around
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
    filled: CountArray,
    cell_m: float,
    near_m: float,
    near_per_m: float,
    widen_cells: float,
    eye: FloatArray,
    passes: int,
) -> None:
    """Lets planes reach on: a point near a plane, in a cell that it reaches, adds that cell's neighbours; in `passes` rounds.

    x_map: (N, 3) map.   eye: (3,) from where they were seen.   reach: (P, W, W), changed; filled: (P, W, W) so many cells around
    each are known to be reached, changed too: most points lie where others have lain.   A point speaks for the plane nearest to
    it alone. Far away rings are wide apart: one more cell every `widen_cells` cells of range.
    """
    width, n = reach.shape[1], x_map.shape[0]
    eye_at = np.empty(normals.shape[0])
    for j in range(normals.shape[0]):
        eye_at[j] = offsets[j] + normals[j, 0] * eye[0] + normals[j, 1] * eye[1] + normals[j, 2] * eye[2]
    # Those in cells that are not reached yet, which a later round may: plane, row, column, cells around.
    waiting, left, changed = np.empty((n, 4), np.int64), 0, False
    xs, ys, zs, ranges = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    least, owner = np.empty(BLOCK), np.empty(BLOCK)
    for first in range(0, n, BLOCK):
        held = min(BLOCK, n - first)
        for k in range(held):
            x, y, z = x_map[first + k, 0], x_map[first + k, 1], x_map[first + k, 2]
            ranges[k] = np.sqrt((x - eye[0]) ** 2 + (y - eye[1]) ** 2 + (z - eye[2]) ** 2)
            xs[k], ys[k], zs[k] = x, y, z
        _owners(xs, ys, zs, held, normals, offsets, eye_at, least, owner)
        for k in range(held):
            x, y, z, j = xs[k], ys[k], zs[k], int(owner[k])
            if j < 0 or not least[k] < near_m + near_per_m * ranges[k]:
                continue
            row = cell_of(axes[j, 0, 0] * x + axes[j, 0, 1] * y + axes[j, 0, 2] * z, cell_m, width)
            column = cell_of(axes[j, 1, 0] * x + axes[j, 1, 1] * y + axes[j, 1, 2] * z, cell_m, width)
            around = 1 + int(ranges[k] / (widen_cells * cell_m))
            if reach[j, row, column]:
                changed |= _fill(reach, filled, j, row, column, around)
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
                changed |= _fill(reach, filled, j, row, column, waiting[i, 3])
            else:
                waiting[still, :] = waiting[i, :]
                still += 1
        left = still
