"""Surfaces that are no planes: patches of them, each before or behind its plane by a height of its own.

Plaster is off flat by millimetres over metres. What all sweeps see at the same place is no noise, and sixteen lasers with free
angles explain it by themselves where the plane may not. A patch is a square of support cells; its height is one more
parameter with a prior (prepare/nuisance.py), whose column is in factors/laser_kernels.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.factors.lidar_plane import Hits, cells_of, grids
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.types import FloatArray, IntArray

#: Bends are metres long: lines between heights this far apart leave (2 pi w / l)^2 / 8 of a wave of length l, a fifth of 3 m
#: (0.8 m apart they left a third, which turned the answer by up to two sigmas). A house has more square metres than a room: no
#: more patches.
_LEAST_WIDTH_M, _MOST_PATCHES = 0.6, 400


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

    def of(self, hits: Hits) -> IntArray:
        """(N,) the patch that each hit lies on; `count` where it lies on none."""
        cell = cells_of(hits, self.normals) // self.width
        seen = hits.plane >= 0
        patch = np.full(len(hits.plane), self.count)
        found = self.number[hits.plane[seen], cell[seen, 0], cell[seen, 1]]
        patch[seen] = np.where(found >= 0, found, self.count)
        return patch

    def heights_m(self, hits: Hits, values_m: FloatArray) -> FloatArray:
        """(N,) where the surface lies before the plane at each hit: linear between the patches' middles, flat beyond the last.

        values_m: (count,) of the patches. A step of the solve moves whole patches; points are laid out by what is between, so
        that where steps come to rest the surface has no edges.
        """
        seen = np.flatnonzero(hits.plane >= 0)
        plane, index = hits.plane[seen], hits.slice_index[seen]
        axes, origin, _, _ = grids(hits.poses, self.normals)
        place = origin[index, plane] + (axes[index, plane] @ hits.x_hit[seen][..., None])[..., 0]
        place = (place / CELL_M + HALF_CELLS) / self.width - 0.5
        first = np.floor(place).astype(np.int64)
        right = place - first
        value = np.append(values_m, 0.0)[self.number]
        side = self.number.shape[1] - 1
        total, weight = np.zeros(len(seen)), np.zeros(len(seen))
        for row in (0, 1):
            for column in (0, 1):
                at = plane, *np.clip(first + np.array([row, column]), 0, side).T
                share = np.abs(1 - row - right[:, 0]) * np.abs(1 - column - right[:, 1]) * (self.number[at] >= 0)
                total += share * value[at]
                weight += share
        height = np.zeros(len(hits.plane))
        height[seen] = np.where(weight > 0.0, total / np.maximum(weight, 1e-12), 0.0)
        return height


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
