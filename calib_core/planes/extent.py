"""How far a plane is known to reach: cells of it that were seen, and seen to be flat.

An equation n . x + w = 0 goes on for ever; walls do not. Each plane carries a grid of cells in its own two axes. A cell
belongs to the plane where most of the returns near it lie within the noise of the plane itself, so that a shelf in front
of a wall, a door frame or the next room do not count on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.planes.segment import plane_axes
from calib_core.types import BoolArray, FloatArray, IntArray

CELL_M = 0.2
_HALF = 512  # cells either side of a plane's own origin: 100 m


def cell_indices(normals: FloatArray, plane: IntArray, points_map: FloatArray) -> IntArray:
    """A flat index (plane, row, column) of the cell each point falls in; points beyond the grid are clipped to its rim.

    normals: (P, 3).   plane: (N,).   points_map: (N, 3).
    """
    axes = np.array([plane_axes(n) for n in normals])  # (P, 2, 3)
    uv = np.einsum("nij,nj->ni", axes[plane], points_map)
    grid = np.clip(np.floor(uv / CELL_M).astype(np.int64) + _HALF, 0, 2 * _HALF - 1)
    return (plane * 2 * _HALF + grid[:, 0]) * 2 * _HALF + grid[:, 1]


@dataclass(frozen=True)
class PlaneExtents:
    """The cells of every plane. axes: (P, 3) normals that define the grids. cells: sorted flat indices."""

    normals: FloatArray
    cells: IntArray

    def contain(self, plane: IntArray, points_map: FloatArray) -> BoolArray:
        """Whether each point's cell belongs to its plane. (N,)."""
        index = cell_indices(self.normals, plane, points_map)
        if len(self.cells) == 0:
            return np.zeros(len(index), dtype=bool)
        place = np.minimum(np.searchsorted(self.cells, index), len(self.cells) - 1)
        return self.cells[place] == index

    def area_m2(self, plane: int) -> float:
        """Area of a plane's cells."""
        return float((self.cells // (2 * _HALF) ** 2 == plane).sum()) * CELL_M**2

    def centres_m(self, plane: int) -> FloatArray:
        """In-plane coordinates (u, v) of a plane's cells, (C, 2)."""
        mine = self.cells[self.cells // (2 * _HALF) ** 2 == plane] % (2 * _HALF) ** 2
        grid = np.stack([mine // (2 * _HALF), mine % (2 * _HALF)], axis=1) - _HALF
        return (grid + 0.5) * CELL_M


@dataclass
class ExtentSurvey:
    """Counts of returns on and beside every plane, cell by cell, gathered scan by scan."""

    normals: FloatArray
    on: dict[int, int]
    beside: dict[int, int]

    @staticmethod
    def empty(normals: FloatArray) -> ExtentSurvey:
        """No counts yet."""
        return ExtentSurvey(normals, {}, {})

    def add(self, plane: IntArray, hit_map: FloatArray, on_plane: BoolArray) -> None:
        """Count returns: where their rays meet the plane, and whether they lie on it or beside it."""
        index = cell_indices(self.normals, plane, hit_map)
        for counts, mask in ((self.on, on_plane), (self.beside, ~on_plane)):
            cells, number = np.unique(index[mask], return_counts=True)
            for cell, n in zip(cells.tolist(), number.tolist(), strict=True):
                counts[cell] = counts.get(cell, 0) + n

    def finish(self, *, least: int = 8, share: float = 0.75) -> PlaneExtents:
        """The cells with at least `least` returns of which `share` lie on the plane."""
        good = [cell for cell, n in self.on.items() if n >= least and n >= share * (n + self.beside.get(cell, 0))]
        return PlaneExtents(self.normals, np.array(sorted(good), dtype=np.int64))
