"""How far a plane is known to reach: cells of it that were seen, and seen to be flat.

An equation n . x + w = 0 goes on for ever; walls do not. Each plane carries a grid of cells in its own two axes. A cell
belongs to the plane where most of the returns near it lie within the noise of the plane itself, and not all of them on one
side of it, so that a shelf in front of a wall, a door in it or the next room do not count on it. Where a person has drawn an
outline, no cell that reaches over it belongs to the plane, whatever was seen there.
"""

from __future__ import annotations

import math
import mmap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from calib_core.factors.cell_kernels import count_kernel
from calib_core.geometry import plane_axes
from calib_core.types import BoolArray, CountArray, Float32Array, FloatArray, IntArray

CELL_M = 0.2
#: A cell's mean is off where it is beyond so many times what is usual on its plane, and beyond so many standard deviations of
#: chance: what stands before the rim of a wall fills the rest of the cell with returns from there. A skirting board of 15 mm
#: in a third of a cell moves its mean by 5. What reaches into the next cell by less than a mean tells is there for all that:
#: cells beside one that is off are left out with it (_CROSS).
_OFF_TIMES, _OFF_SIGMAS = 3.0, 3.0
#: In the units of `off` (1: too far for any mean) what walls do anyway, where they are flatter than that: a thirtieth of a
#: return's standard deviation, under a millimetre.
_USUAL_OFF = 1 / 60
_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]])
#: Cells either side of a plane's own origin: 100 m. Hits beyond are counted in the rim, which belongs to no plane.
HALF_CELLS = 500


@dataclass(frozen=True)
class PlaneExtents:
    """The cells of every plane. normals: (P, 3) that define the grids' axes. inside: (P, rows, columns)."""

    normals: FloatArray
    inside: NDArray[np.bool_]

    def area_m2(self, plane: int) -> float:
        """Area of a plane's cells."""
        return float(self.inside[plane].sum()) * CELL_M**2


def cells_within(normals: FloatArray, outlines_m: Sequence[FloatArray | None]) -> BoolArray:
    """The cells that lie wholly within their plane's outline, (P, rows, columns); all of them where there is none.

    normals: (P, 3), that define the grids' axes.   outlines_m: convex polygons (K, 3) in the frame of the normals.
    Wholly: so that not one point from beyond an outline counts.
    """
    within = np.ones((len(normals), 2 * HALF_CELLS, 2 * HALF_CELLS), bool)
    for plane, (axes, outline_m) in enumerate(zip(plane_axes(normals), outlines_m, strict=True)):
        if outline_m is not None:
            within[plane] = _whole_cells(outline_m @ axes.T)
    return within


def _whole_cells(corners_m: FloatArray) -> BoolArray:
    """The cells of a grid inside a convex polygon, (rows, columns). corners_m: (K, 2) along the grid's axes, in order.

    On the inner side of an edge a u + b v + c >= 0. Over a cell its smallest value is that at the lower corner, and less
    by the cell's width times every coefficient that is below zero.
    """
    lower_m = (np.arange(2 * HALF_CELLS) - HALF_CELLS) * CELL_M
    inside = np.ones((2 * HALF_CELLS, 2 * HALF_CELLS), bool)
    ahead = np.roll(corners_m, -1, axis=0)
    x, y = corners_m.T
    turning = np.sign(x @ ahead[:, 1] - y @ ahead[:, 0])  # -1 where they go round clockwise
    for (u, v), (along, across) in zip(corners_m, turning * (ahead - corners_m), strict=True):
        a, b = -across, along
        least = -a * u - b * v + (min(a, 0.0) + min(b, 0.0)) * CELL_M
        inside &= (a * lower_m)[:, None] + (b * lower_m)[None, :] + least >= 0.0
    return inside


def reach_around(extents: PlaneExtents, reach_m: float) -> PlaneExtents:
    """The extents with every cell within a reach of them, so that a plane may go on a little beyond what was seen of it."""
    cells = max(1, round(reach_m / CELL_M))
    inside = np.zeros_like(extents.inside)
    for plane, row, column in np.argwhere(extents.inside):
        inside[plane, max(row - cells, 0) : row + cells + 1, max(column - cells, 0) : column + cells + 1] = True
    return PlaneExtents(extents.normals, inside)


@dataclass
class ExtentSurvey:
    """Counts of returns on and beside every plane, cell by cell, gathered scan by scan. on, beside: (P, rows, columns).

    off: (P, rows, columns), sums over those on the plane of how far off they are, 1 being too far for a mean.
    box: (P, 4) lowest row, lowest column, highest row, highest column with a return on the plane.
    return_std: standard deviation of one return, in the units of `off`.
    """

    normals: FloatArray
    on: CountArray
    beside: CountArray
    off: Float32Array
    box: IntArray
    return_std: float

    @staticmethod
    def empty(normals: FloatArray, return_std: float = 0.5) -> ExtentSurvey:
        """No counts yet."""
        shape = (len(normals), 2 * HALF_CELLS, 2 * HALF_CELLS)
        nothing = np.tile([2 * HALF_CELLS, 2 * HALF_CELLS, -1, -1], (len(normals), 1))
        return ExtentSurvey(
            normals,
            _untouched(shape).view(np.int32),
            _untouched(shape).view(np.int32),
            _untouched(shape).view(np.float32),
            nothing,
            return_std,
        )

    def add(self, plane: IntArray, cell: IntArray, on_plane: BoolArray, off: FloatArray) -> None:
        """Count returns: the cell in which their rays meet the plane, whether they lie on it or beside it, and how far off.

        off: (N,) signed, 1 where the mean of many would be too far.
        """
        count_kernel(plane, cell, on_plane, off, self.on, self.beside, self.off, self.box)

    def finish(
        self,
        within: BoolArray | None = None,
        *,
        aloof: bool = False,
        least: int = 8,
        share: float = 0.75,
        island: float = 0.02,
    ) -> PlaneExtents:
        """The cells with at least `least` returns of which `share` lie on the plane, without islands.

        within: (P, rows, columns) from `cells_within`; what was seen of a plane elsewhere is as if it had not been.
        aloof: leave out the cells beside those where less than `share` of as many lie on the plane, too. What stands there
        reaches into them by less than any mean tells, the more the less the motion is known.

        An island is a patch, apart from the others, with less than this share of the plane's returns: where a pot stands on
        the ground, its foot lies on the ground's plane too, and nothing but its foot is seen there.
        """
        inside = np.zeros(self.on.shape, bool)
        for plane, (top, left, bottom, right) in enumerate(self.box):
            # A plane fills a small part of its grid; what stands beside it may be seen a cell further.
            box = slice(max(top - 1, 0), bottom + 2), slice(max(left - 1, 0), right + 2)
            on, beside = self.on[plane][box].astype(np.int64), self.beside[plane][box]
            seen = on >= least if within is None else (on >= least) & within[plane][box]
            flat = seen & (on >= share * (on + beside)) & (np.abs(self.off[plane][box]) <= on)
            off = _off_the_others(self.off[plane][box], on, flat, self.return_std)
            apart = off & flat
            if aloof:
                apart |= (on + beside >= least) & (on < share * (on + beside))
            flat &= ~scipy.ndimage.binary_dilation(apart, _CROSS)
            if flat.any():
                inside[plane][box] = _without_islands(flat, on, island)
        inside[:, [0, -1], :] = False
        inside[:, :, [0, -1]] = False
        return PlaneExtents(self.normals, inside)


def _untouched(shape: tuple[int, ...]) -> NDArray[np.uint32]:
    """Zeros, of which the system makes what somebody touches: a plane fills a small part of its grid.

    What NumPy asks for would be wiped from end to end where the process keeps memory that was let go.
    """
    count = math.prod(shape)
    return np.frombuffer(mmap.mmap(-1, max(1, 4 * count)), np.uint32, count).reshape(shape)


def _off_the_others(off: Float32Array, on: IntArray, flat: BoolArray, return_std: float) -> BoolArray:
    """The cells whose mean is beyond both chance and what the plane's other flat cells do, (rows, columns)."""
    if not flat.any():
        return flat
    count = np.maximum(on, 1)
    mean = np.abs(off) / count
    order = np.argsort(mean[flat])
    weight = np.cumsum(on[flat][order])
    usual = 1.4826 * float(mean[flat][order][np.searchsorted(weight, 0.5 * weight[-1])])
    return np.asarray(mean > _OFF_TIMES * max(usual, _USUAL_OFF) + _OFF_SIGMAS * return_std / np.sqrt(count))


def _without_islands(inside: BoolArray, on: IntArray, share: float) -> BoolArray:
    """The cells in patches of at least this share of all returns. Cells two apart belong together: rings leave gaps."""
    patch, count = scipy.ndimage.label(
        scipy.ndimage.binary_dilation(inside, np.ones((3, 3)), iterations=1), np.ones((3, 3))
    )
    returns = np.bincount(patch[inside], on[inside], count + 1)
    return np.asarray(inside & (returns >= share * returns.sum())[patch])
