"""How far a plane is known to reach: cells of it that were seen, and seen to be flat.

An equation n . x + w = 0 goes on for ever; walls do not. Each plane carries a grid of cells in its own two axes. A cell
belongs to the plane where most of the returns near it lie within the noise of the plane itself, so that a shelf in front
of a wall, a door frame or the next room do not count on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_core.types import BoolArray, FloatArray, IntArray

CELL_M = 0.2
#: Cells either side of a plane's own origin: 100 m. Hits beyond are counted in the rim, which belongs to no plane.
HALF_CELLS = 500


@dataclass(frozen=True)
class PlaneExtents:
    """The cells of every plane. normals: (P, 3) that define the grids' axes. inside: (P, rows, columns)."""

    normals: FloatArray
    inside: NDArray[np.bool_]

    def contain(self, plane: IntArray, cell: IntArray) -> BoolArray:
        """Whether each hit's cell belongs to its plane. plane: (N,), -1 for none. cell: (N, 2)."""
        return (plane >= 0) & self.inside[plane, cell[:, 0], cell[:, 1]]

    def area_m2(self, plane: int) -> float:
        """Area of a plane's cells."""
        return float(self.inside[plane].sum()) * CELL_M**2


@dataclass
class ExtentSurvey:
    """Counts of returns on and beside every plane, cell by cell, gathered scan by scan. on, beside: (P, rows, columns)."""

    normals: FloatArray
    on: IntArray
    beside: IntArray

    @staticmethod
    def empty(normals: FloatArray) -> ExtentSurvey:
        """No counts yet."""
        shape = (len(normals), 2 * HALF_CELLS, 2 * HALF_CELLS)
        return ExtentSurvey(normals, np.zeros(shape, np.int64), np.zeros(shape, np.int64))

    def add(self, plane: IntArray, cell: IntArray, on_plane: BoolArray) -> None:
        """Count returns: the cell in which their rays meet the plane, and whether they lie on it or beside it."""
        flat = (plane * 2 * HALF_CELLS + cell[:, 0]) * 2 * HALF_CELLS + cell[:, 1]
        size, shape = self.on.size, self.on.shape
        self.on += np.bincount(flat[on_plane], minlength=size).reshape(shape)
        self.beside += np.bincount(flat[~on_plane], minlength=size).reshape(shape)

    def finish(self, *, least: int = 8, share: float = 0.75) -> PlaneExtents:
        """The cells with at least `least` returns of which `share` lie on the plane."""
        inside = (self.on >= least) & (self.on >= share * (self.on + self.beside))
        inside[:, [0, -1], :] = False
        inside[:, :, [0, -1]] = False
        return PlaneExtents(self.normals, inside)
