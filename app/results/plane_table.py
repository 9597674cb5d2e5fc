"""The planes of an answer as arrays, and which of them each point lies on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.planes.geometry import within_outline
from calib_core.result import PlaneQuality
from calib_core.types import FloatArray


@dataclass(frozen=True, eq=False)
class PlaneTable:
    """K planes n . x + w = 0, map frame.

    equations: (K, 4), rows (n, w) with a unit normal.   outlines_m: for each the corners (C, 3) that it was restricted to in its
    solve, None where it was not; none at all where nobody restricts any.
    """

    equations: FloatArray
    outlines_m: Sequence[FloatArray | None] = ()

    @classmethod
    def of(cls, planes: Iterable[PlaneQuality]) -> Self:
        """The planes of a result."""
        found = list(planes)
        return cls(
            np.array([(*plane.normal, plane.offset_m) for plane in found], dtype=np.float64).reshape(-1, 4),
            [None if plane.outline_m is None else np.array(plane.outline_m, dtype=np.float64) for plane in found],
        )

    @property
    def normals(self) -> FloatArray:
        """(K, 3)."""
        return self.equations[:, :3]

    @property
    def offsets_m(self) -> FloatArray:
        """(K,) [m]."""
        return self.equations[:, 3]

    def nearest(
        self, points_map: NDArray[np.float32], *, gate_m: float, bounded: bool = True
    ) -> tuple[NDArray[np.int16], NDArray[np.float32]]:
        """Index of each point's nearest plane (-1: none within gate_m) and its signed distance to it [m].

        points_map: (N, 3).   Returns (N,) and (N,); NaN where there is none.
        bounded: points of a plane outside of its outline have none either.
        """
        if len(self.equations) == 0:
            return np.full(len(points_map), -1, dtype=np.int16), np.full(len(points_map), np.nan, dtype=np.float32)
        dist_m = points_map @ self.normals.T.astype(np.float32) + self.offsets_m.astype(np.float32)
        nearest = np.abs(dist_m).argmin(axis=1)
        chosen_m = np.take_along_axis(dist_m, nearest[:, None], axis=1)[:, 0]
        outside = ~(np.abs(chosen_m) <= gate_m)
        for plane, outline_m in enumerate(self.outlines_m if bounded else ()):
            if outline_m is not None:
                mine = np.flatnonzero((nearest == plane) & ~outside)
                outside[mine] = ~within_outline(points_map[mine], self.normals[plane], outline_m)
        labels = nearest.astype(np.int16)
        labels[outside] = -1
        return labels, np.where(outside, np.float32(np.nan), chosen_m)

    def distances_m(self, points_map: NDArray[np.float32], owner: NDArray[np.int16]) -> FloatArray:
        """(N,) signed distance [m] of each point (N, 3) from the plane whose index `owner` (N,) has."""
        distances: FloatArray = np.einsum("ij,ij->i", points_map, self.normals[owner]) + self.offsets_m[owner]
        return distances
