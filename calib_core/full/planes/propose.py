"""The reference scan, and planes as patches of a cloud, from fits or from a point that a person points at.

Planes are proposed, and the lidar is followed, in the frame of the lidar at the reference scan's first point: the first scan from
which the planes determine a pose. What a result tells is in the map, the first used scan's frame (joint/state_views.py).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from calib_core.errors import Cancelled, Refused
from calib_core.events import ShouldCancel, never_cancel
from calib_core.full.planes.settings import PATCHES, SEARCH
from calib_core.geometry import plane_axes
from calib_core.memoised import told_once
from calib_core.planes.same_plane import same_place
from calib_core.planes.segment import PlaneFit, determinacy, fit_plane, segment_planes
from calib_core.planes.settings import SegmentSettings
from calib_core.presets.lidar import FARTHEST_M, NEAREST_M
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray, Plane, PlanePatch, PlaneProposals, Scan

#: A prime beyond all cells of a side: a row and a column are one number.
_ROW_KEY = 1_000_003


def scan_points(scan: Scan, field_of_view_deg: float | None = None) -> FloatArray:
    """The scan's points (N, 3) [m] in the lidar frame, within the field of view."""
    xyz = scan.points["xyz"].astype(np.float64)
    if field_of_view_deg is not None:
        xyz = xyz[np.abs(np.arctan2(xyz[:, 1], xyz[:, 0])) <= np.radians(field_of_view_deg)]
    return xyz


def find_reference(
    scans: Sequence[Scan], settings: CalibrateSettings, *, should_cancel: ShouldCancel = never_cancel
) -> tuple[int, list[PlaneFit]]:
    """Position of the first scan whose planes determine a pose, and its planes; where none does, of the scan whose planes face
    most ways, and of those the one with most planes.
    """
    best: tuple[tuple[int, int], int, list[PlaneFit]] = ((-1, 0), 0, [])
    s = SEARCH
    candidates = list(range(min(s.first_scans, len(scans))))
    candidates += range(s.step_scans, len(scans), max(s.step_scans, len(scans) // s.scans))
    for position in candidates:
        if should_cancel():
            raise Cancelled("the search for planes was cancelled")
        fits = _fits_of(scans, position, settings.field_of_view_deg, settings.random_seed)
        ways = ways_held(np.array([f.normal for f in fits]).reshape(-1, 3))
        if (ways, len(fits)) > best[0]:
            best = ((ways, len(fits)), position, fits)
        if ways == 3:
            break
    return best[1], best[2]


@told_once
def _fits_of(scans: Sequence[Scan], position: int, field_of_view_deg: float | None, seed: int) -> list[PlaneFit]:
    """The planes of one scan."""
    return segment_planes(scan_points(scans[position], field_of_view_deg), seed=seed)


def determines_a_pose(fits: Sequence[PlaneFit]) -> bool:
    """Whether a scan's planes hold a place three ways: the search for the reference ends at the first such scan."""
    return ways_held(np.array([fit.normal for fit in fits]).reshape(-1, 3)) == 3


def ways_held(normals: FloatArray) -> int:
    """In how many directions planes of these normals (P, 3) hold a place, 0 to 3."""
    return sum(determinacy(normals, open_ways) >= SEARCH.least_determinacy for open_ways in range(3))


def no_planes(scans: Sequence[Scan]) -> Refused:
    """What is said where no scan shows a plane: that coordinates are no metres, where they cannot be."""
    spread = np.unique(np.linspace(0, len(scans) - 1, SEARCH.looked_at).astype(np.int64))
    half_m = float(np.median(np.concatenate([np.linalg.norm(scan_points(scans[k]), axis=1) for k in spread])))
    if NEAREST_M < half_m < FARTHEST_M:
        return Refused(
            "planes.none", "no plane was found in any scan; record in front of walls and floor, at 1 to 20 m"
        )
    away = f"farther than {half_m:,.0f} m" if half_m > 1.0 else f"nearer than {1e3 * half_m:.2g} mm"
    return Refused(
        "points.unit",
        f"half of the points lie {away}, where no lidar measures: expected coordinates in metres, they seem to be in "
        f"{'millimetres or centimetres' if half_m > 1.0 else 'a larger unit'}; convert them in the lidar's driver",
    )


def distinct(fits: Sequence[PlaneFit], cloud_m: FloatArray) -> list[PlaneFit]:
    """The fits without those that lie along a larger one: a door a hand's breadth in front of its wall.

    Both would make each other's points ambiguous, and the pair be lost. cloud_m: (N, 3), what the fits were found in.
    """
    kept: list[PlaneFit] = []
    for fit in fits:
        centre = cloud_m[fit.inliers].mean(axis=0)
        known = same_place(
            np.array([f.normal for f in kept]).reshape(-1, 3), np.array([f.offset_m for f in kept]), fit.normal, centre,
            within_deg=PATCHES.distinct_deg, within_m=PATCHES.distinct_m,
        )  # fmt: skip
        if not known.any():
            kept.append(fit)
    return kept


def named_planes(fits: Sequence[PlaneFit]) -> list[Plane]:
    """Fits as planes named by their rank."""
    return [Plane(f"plane {j + 1}", f.normal, f.offset_m) for j, f in enumerate(fits)]


def near_plane(
    cloud_m: FloatArray, plane: Plane, ranges_m: FloatArray | None = None
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Points on a plane, by the segmentation's own tolerance. ranges_m: (N,) of the points, where that is known."""
    s = SegmentSettings()
    away_m = np.linalg.norm(cloud_m, axis=1) if ranges_m is None else ranges_m
    along_m = cloud_m @ plane.normal
    near = np.abs(along_m + plane.offset_m) < s.distance_m + s.distance_per_range * away_m
    return np.asarray((np.abs(along_m) > s.min_incidence * away_m) & near)


def make_patch(plane: Plane, points_m: FloatArray) -> PlanePatch:
    """A plane with the outline, area and roughness of its points. points_m: (N, 3), map frame."""
    axes = plane_axes(plane.normal)
    uv = points_m @ axes.T
    foot = -plane.offset_m * plane.normal
    try:
        corners = uv[scipy.spatial.ConvexHull(uv).vertices]
    except (scipy.spatial.QhullError, ValueError):
        corners = uv[:0]
    row, column = np.floor(uv / PATCHES.cell_m).astype(np.int64).T
    cells = np.unique(row * _ROW_KEY + column)
    distance = points_m @ plane.normal + plane.offset_m
    return PlanePatch(
        plane=plane,
        outline_m=foot + corners @ axes,
        n_points=len(points_m),
        rms_m=float(np.sqrt(np.mean(distance**2))) if len(distance) else 0.0,
        area_m2=float(len(cells)) * PATCHES.cell_m**2,
    )


def grow_plane(proposals: PlaneProposals, seed_m: FloatArray) -> PlanePatch | None:
    """The plane around a point of the reference cloud, from points that belong to none yet; None where there is none.

    seed_m: (3,) map frame. The neighbourhood widens until its points lie on a plane that passes the seed.
    """
    cloud = proposals.cloud_m.astype(np.float64)
    free = proposals.cloud_patch < 0
    away = np.linalg.norm(cloud - seed_m, axis=1)
    for radius_m in PATCHES.radii_m:
        near = free & (away < radius_m)
        if near.sum() < PATCHES.fewest_near:
            continue
        for fit in segment_planes(cloud[near], settings=PATCHES.around):
            if abs(fit.normal @ seed_m + fit.offset_m) < PATCHES.seed_m:
                return _spread(cloud, free, fit, seed_m, f"plane {len(proposals.patches) + 1}")
    return None


def _spread(
    cloud: FloatArray, free: np.ndarray[tuple[int], np.dtype[np.bool_]], fit: PlaneFit, seed_m: FloatArray, name: str
) -> PlanePatch | None:
    """A local fit grown over the connected cells of free points on its plane, then refitted."""
    plane = Plane(name, fit.normal, fit.offset_m)
    on = np.flatnonzero(free & near_plane(cloud, plane))
    axes = plane_axes(plane.normal)
    cells = np.floor(cloud[on] @ axes.T / PATCHES.joined_m).astype(np.int64)
    filled = {(int(a), int(b)) for a, b in np.unique(cells, axis=0)}
    start = np.floor(axes @ seed_m / PATCHES.joined_m).astype(np.int64)
    reached: set[tuple[int, int]] = set()
    frontier = [(int(start[0]) + a, int(start[1]) + b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    while frontier:
        cell = frontier.pop()
        if cell in filled and cell not in reached:
            reached.add(cell)
            frontier.extend((cell[0] + a, cell[1] + b) for a in (-1, 0, 1) for b in (-1, 0, 1))
    mine = on[[(int(a), int(b)) in reached for a, b in cells]]
    if len(mine) < PATCHES.fewest_points:
        return None
    normal, offset, _ = fit_plane(cloud[mine])
    sign = 1.0 if offset >= 0 else -1.0
    return make_patch(Plane(name, normal * sign, offset * sign), cloud[mine])
