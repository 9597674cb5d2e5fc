"""The planes a lidar-only track follows, each with the part of it that was seen, and new ones as they come into view.

An equation goes on for ever, a box top does not: each plane keeps the cells of a coarse grid within which points were
found on it, one cell more on every side. Points that lie on no plane are looked through for new planes now and then.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.full.odometry.kernels import Surfaces
from calib_core.full.odometry.reach_kernels import spread_kernel
from calib_core.full.odometry.settings import MAP
from calib_core.geometry import plane_axes
from calib_core.planes.same_plane import apart, same_points
from calib_core.planes.segment import PlaneFit, segment_planes
from calib_core.types import BoolArray, CountArray, FloatArray, IntArray, Plane


class PlaneMap:
    """Planes with their reach. normals: (P, 3), offsets_m: (P,), axes: (P, 2, 3), reach: (P, W, W) bool; map frame.

    filled: (P, W, W) so many cells around each are known to be reached, as reach only grows.
    given: how many of them came from outside; the others were found on the way.   support: (P,) scans that had points
    on each.
    """

    def __init__(self, normals: FloatArray, offsets_m: FloatArray) -> None:
        self.normals = np.array(normals, dtype=np.float64).reshape(-1, 3)
        self.offsets_m = np.array(offsets_m, dtype=np.float64)
        # Of one plane they come in another order than of several: loops would be compiled for either.
        self.axes = np.array(plane_axes(self.normals), order="C")
        self.given = len(self.normals)
        self.support = np.zeros(self.given, np.int64)
        self.reach: BoolArray = np.zeros((self.given, MAP.cells, MAP.cells), np.bool_)
        self.filled: CountArray = np.zeros(self.reach.shape, np.int32)

    @staticmethod
    def of(planes: Sequence[Plane]) -> PlaneMap:
        """From planes in the map frame; they reach nowhere yet."""
        return PlaneMap(np.array([p.normal for p in planes]), np.array([p.offset_m for p in planes]))

    @staticmethod
    def endless(planes: Sequence[Plane]) -> PlaneMap:
        """From planes that reach everywhere."""
        made = PlaneMap.of(planes)
        made.reach = np.ones((made.given, 1, 1), np.bool_)
        made.filled = np.zeros(made.reach.shape, np.int32)
        return made

    def surfaces(self, outside_m: float) -> Surfaces:
        """As compiled loops take them. outside_m: a point off a plane's known part counts as so much further away."""
        return Surfaces(self.normals, self.offsets_m, self.axes, self.reach, MAP.cell_m, outside_m)

    def seed(self, x_map_m: FloatArray, near_m: float = MAP.near_m) -> None:
        """Let every plane reach wherever points lie on it. x_map_m: (N, 3)."""
        distance = np.abs(x_map_m @ self.normals.T + self.offsets_m)
        nearest = np.argmin(distance, axis=1)
        on = distance[np.arange(len(distance)), nearest] < near_m
        for j in range(len(self.normals)):
            self._mark(j, x_map_m[on & (nearest == j)])

    def spread(self, x_map_m: FloatArray, eye_m: FloatArray) -> None:
        """Let planes reach on where points next to their known part lie on them. x_map_m: (N, 3), seen from eye_m (3,)."""
        spread_kernel(
            x_map_m, self.normals, self.offsets_m, self.axes, self.reach, self.filled, MAP.cell_m, MAP.near_m, MAP.near_per_m,
            MAP.widen_cells, eye_m, MAP.spread_passes,
        )  # fmt: skip

    def count(self, plane: IntArray, least: int = MAP.seen_points) -> None:
        """Note which planes a scan had points on. plane: (N,) index of each point on one."""
        self.support += np.bincount(plane, minlength=len(self.normals)) >= least

    def strays(self, x_map_m: FloatArray, eye_m: FloatArray) -> BoolArray:
        """Which points lie on no plane's known part: (N,). x_map_m: (N, 3), seen from eye_m (3,)."""
        stray = np.ones(len(x_map_m), np.bool_)
        for j, normal in enumerate(self.normals):
            along = x_map_m @ normal
            on = (np.abs(along + self.offsets_m[j]) < MAP.stray_m) & (along < eye_m @ normal)
            row, column = self._cells(j, x_map_m[on])
            stray[np.flatnonzero(on)[self.reach[j, row, column]]] = False
        return stray

    def grow(self, strays_m: FloatArray, eye_m: FloatArray) -> int:
        """Add the planes among points that lie on none, or let known ones reach there; how many changed.

        strays_m: (N, 3) map frame, seen from eye_m (3,).
        """
        changed = 0
        for fit in segment_planes(strays_m, viewpoint_m=eye_m, settings=MAP.new_planes):
            mine = strays_m[fit.inliers]
            apart_m = apart(self.normals, self.offsets_m, mine)
            same, alike = (
                same_points(self.normals, fit.normal, apart_m, within_deg=deg, within_m=m)
                for deg, m in ((MAP.same_deg, MAP.same_m), (MAP.alike_deg, MAP.alike_m))
            )
            if same.any():
                self._mark(int(np.argmin(np.where(same, apart_m, np.inf))), mine)
                changed += 1
            elif not alike.any() and len(self.normals) < MAP.most_planes:
                self._add(fit, mine)
                changed += 1
        return changed

    def planes(self, given: Sequence[Plane], least_support: int = MAP.seen_scans) -> list[Plane]:
        """The given planes, and those found that were seen in so many scans, named on."""
        found = [j for j in range(self.given, len(self.normals)) if self.support[j] >= least_support]
        first = len(given) + 1
        return [
            *given,
            *(Plane(f"plane {first + k}", self.normals[j], float(self.offsets_m[j])) for k, j in enumerate(found)),
        ]

    def _add(self, fit: PlaneFit, points_m: FloatArray) -> None:
        self.normals = np.vstack([self.normals, fit.normal])
        self.offsets_m = np.append(self.offsets_m, fit.offset_m)
        # Of one plane they come in another order than of several: loops would be compiled for either.
        self.axes = np.array(plane_axes(self.normals), order="C")
        self.support = np.append(self.support, 0)
        new = np.zeros((1, *self.reach.shape[1:]), np.bool_)
        self.reach, self.filled = np.concatenate([self.reach, new]), np.concatenate([self.filled, new.astype(np.int32)])
        self._mark(len(self.normals) - 1, points_m)

    def _cells(self, j: int, x_map_m: FloatArray) -> tuple[IntArray, IntArray]:
        width = self.reach.shape[1]
        cell = np.floor(x_map_m @ self.axes[j].T / MAP.cell_m).astype(np.int64) + width // 2
        cell = np.clip(cell, 0, width - 1)
        return cell[:, 0], cell[:, 1]

    def _mark(self, j: int, points_m: FloatArray) -> None:
        """The cells of points and their neighbours."""
        row, column = self._cells(j, points_m)
        size = self.reach.shape[1]
        seen = np.zeros((size, size), np.bool_)
        seen[row, column] = True
        wide = seen.copy()
        wide[1:] |= seen[:-1]
        wide[:-1] |= seen[1:]
        reach = self.reach[j]
        reach |= wide
        reach[:, 1:] |= wide[:, :-1]
        reach[:, :-1] |= wide[:, 1:]
