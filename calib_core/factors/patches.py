"""Surfaces that are no planes: patches of them, each before or behind its plane by a height of its own.

Plaster is off flat by millimetres over metres. What all sweeps see at the same place is no noise, and sixteen lasers with free
angles explain it by themselves where the plane may not. A patch is a square of support cells; the height of its middle is one
more parameter with a prior (prepare/nuisance.py). Between middles the surface is linear in either direction, and so is what a
point says of the heights about it: by its shares of them, which are features of it (factors/laser_kernels.py). A step that took
each patch for flat and moved it as a whole kept slopes within patches for what points tell, of which the heights about them
decide: it came to rest only after dozens of rounds, and one parameter of a lidar was known three times worse than was stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from calib_core.factors.lidar_plane import Hits, cells_of, grids
from calib_core.factors.patch_kernels import between_kernel
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.types import BoolArray, FloatArray, IntArray

#: Bends are metres long: lines between heights this far apart leave (2 pi w / l)^2 / 8 of a wave of length l, a fifth of 3 m
#: (0.8 m apart they left a third, which turned the answer by up to two sigmas). A house has more square metres than a room: no
#: more patches. In a hall of 940 m2 with bends of 0.3 to 1 mm, 400 of them, 1.5 m apart, left the answer 2.4 to 4.5 of its
#: sigmas off, 1000 of them 1.2 to 2, for a third more time.
_LEAST_WIDTH_M, _MOST_PATCHES = 0.6, 1000


@dataclass(frozen=True)
class Between:
    """Where N hits lie between heights. square: (N,), the last of so many `squares` where there are none.   share: (N, 4) of the
    heights at its corners, one together, or nothing.
    """

    square: IntArray
    share: FloatArray
    squares: int


@dataclass(frozen=True)
class SurfacePatches:
    """Where the patches are. normals: (P, 3) that define the grids' axes.   number: (P, rows, columns) of patches, -1: none.

    width: of a patch, in cells.
    """

    normals: FloatArray
    number: IntArray
    width: int

    @property
    def count(self) -> int:
        """How many there are."""
        return int(self.number.max(initial=-1)) + 1

    @property
    def planes(self) -> IntArray:
        """(count,) the plane of each."""
        return np.argwhere(self.number >= 0)[:, 0]

    @property
    def names(self) -> tuple[str, ...]:
        """Of each: its plane's number and its place on it."""
        half = self.number.shape[1] // 2
        places = np.argwhere(self.number >= 0)
        return tuple(f"{plane + 1}:{row - half},{column - half}" for plane, row, column in places)

    def without(self, planes: BoolArray) -> SurfacePatches:
        """Those of the other planes, in the same order. planes: (P,) which have none."""
        kept = (self.number >= 0) & ~planes[:, None, None]
        number = np.full(self.number.shape, -1)
        number[kept] = np.arange(int(kept.sum()))
        return replace(self, number=number)

    def whitener(self, std_m: float, alike_m: float) -> FloatArray:
        """(count, count) W, lower triangular, of heights h: W h is white where they are std_m large and, on one plane, correlated
        by exp(-distance / alike_m), as what wanders like a random walk is and comes back over some such lengths.
        """
        places_m = np.argwhere(self.number >= 0)[:, 1:] * (self.width * CELL_M)
        distance_m = np.linalg.norm(places_m[:, None] - places_m[None], axis=-1)
        one_plane = self.planes[:, None] == self.planes[None]
        covariance = std_m**2 * np.where(one_plane, np.exp(-distance_m / alike_m), 0.0)
        return np.asarray(scipy.linalg.solve_triangular(np.linalg.cholesky(covariance), np.eye(self.count), lower=True))

    def of(self, hits: Hits) -> IntArray:
        """(N,) the patch that each hit lies on; `count` where it lies on none."""
        cell = cells_of(hits, self.normals) // self.width
        seen = hits.plane >= 0
        patch = np.full(len(hits.plane), self.count)
        found = self.number[hits.plane[seen], cell[seen, 0], cell[seen, 1]]
        patch[seen] = np.where(found >= 0, found, self.count)
        return patch

    @cached_property
    def _squares(self) -> tuple[IntArray, IntArray]:
        """The squares between middles: their numbers (P, rows + 1, columns + 1), -1: none, each the one before its patch's middle
        in both directions; and of each the four patches at its corners, (S, 4), -1: none.
        """
        around = np.full((len(self.number), *(side + 2 for side in self.number.shape[1:])), -1)
        around[:, 1:-1, 1:-1] = self.number
        corners = np.stack([around[:, :-1, :-1], around[:, :-1, 1:], around[:, 1:, :-1], around[:, 1:, 1:]], axis=-1)
        some = (corners >= 0).any(axis=-1)
        numbers = np.full(some.shape, -1)
        numbers[some] = np.arange(int(some.sum()))
        return numbers, corners[some]

    @cached_property
    def square_planes(self) -> IntArray:
        """(S,) the plane of each."""
        return np.argwhere(self._squares[0] >= 0)[:, 0]

    @property
    def corners(self) -> IntArray:
        """(S, 4) the patches whose middles are the corners of each square between them, -1: none."""
        return self._squares[1]

    def between(self, hits: Hits) -> Between:
        """Which square each hit lies in, and its shares of the heights at its corners."""
        axes, origin, _, _ = grids(hits.poses, self.normals)
        square, share = np.empty(len(hits.plane), np.int64), np.empty((len(hits.plane), 4))
        numbers, corners = self._squares
        between_kernel(
            hits.plane, hits.slice_index, hits.x_hit, axes, origin, CELL_M * self.width, HALF_CELLS / self.width,
            numbers, corners >= 0, square, share,
        )  # fmt: skip
        return Between(square, share, len(corners) + 1)

    def heights_m(self, between: Between, values_m: FloatArray) -> FloatArray:
        """(N,) where the surface lies before the plane at each hit: linear between the patches' middles, flat beyond the last.

        values_m: (count,) of the patches.
        """
        heights = np.append(values_m, 0.0)[np.vstack([self.corners, np.full((1, 4), -1)])]
        return np.asarray(np.einsum("nc,nc->n", between.share, heights[between.square]))


def patches_of(extents: PlaneExtents) -> SurfacePatches:
    """Patches over the planes' cells, as wide as their number allows."""
    area_m2 = float(extents.inside.sum()) * CELL_M**2
    width = int(np.ceil(max(_LEAST_WIDTH_M, np.sqrt(area_m2 / _MOST_PATCHES)) / CELL_M))
    planes, side = len(extents.normals), 2 * HALF_CELLS // width + 1
    filled = np.zeros((planes, side, side), bool)
    plane, row, column = np.nonzero(extents.inside)
    filled[plane, row // width, column // width] = True
    number = np.full(filled.shape, -1)
    number[filled] = np.arange(int(filled.sum()))
    return SurfacePatches(extents.normals, number, width)
