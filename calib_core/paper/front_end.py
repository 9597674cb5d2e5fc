"""Points and their planes, scan by scan (paper section II-E).

Planes are detected in every scan by RANSAC. Those of the first scan, taken while the sensors stand still, are the map.
Each later scan's planes are matched to the last tracked scan's by their normals; where one is missing the scan is
dropped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import OnEvent, ShouldCancel, StageEvent
from calib_core.paper.plane_tracking import match_normals
from calib_core.paper.records import FrontEnd, TrackedScan
from calib_core.paper.scan_pose import rough_pose
from calib_core.phrasing import counted
from calib_core.planes.segment import PlaneFit, fit_plane, segment_planes
from calib_core.planes.settings import SegmentSettings
from calib_core.types import FloatArray, IntArray, Plane, Scan

#: Few hypotheses, because a scan of the target is mostly its planes; the first scan is given more. What could be an
#: imaginary cut is let through: a plane must still match one that is followed, and a partly seen one is wanted.
_EACH_SCAN = SegmentSettings(
    hypotheses=80,
    subsample=800,
    max_planes=6,
    min_points=40,
    dominance=0.0,
    min_breadth_m=0.05,
    piece_breadth_m=0.0,
    min_incidence=0.03,
)
#: Points of a later scan among which planes are sought; all points on them are used.
_SEGMENTED_POINTS = 2500
#: Least half-width of the band around a plane in which points belong to it.
_LEAST_BAND_M = 0.02
_FIRST_SCAN = SegmentSettings(hypotheses=1500, subsample=5000, max_planes=8, min_points=150)
#: Followed planes differ by more than this in direction: nearest normals could not tell parallel ones apart.
_MIN_ANGLE_RAD = np.radians(30.0)
#: Turn allowed between two scans, and after any number of lost ones.
_MAX_TURN_RAD, _MAX_TURN_AFTER_LOSS_RAD = 0.35, 0.8
#: A point this close to two planes is on their edge and is given to neither: to the wrong one it would be an outlier.
_EDGE_M = 0.06
#: Points seen flatter than this (cosine) say little of the range's noise.
_FLAT_COSINE = 0.2


@dataclass(frozen=True, slots=True)
class Selection:
    """Which points are used (III-C). points_per_plane: None for all.   field_of_view_deg: azimuth within +-.

    by_map: points belong to a plane by their distance from the map's, seen from the scan's rough pose; else, as published, from
    the plane that was fitted to the scan by itself.
    """

    points_per_plane: int | None
    field_of_view_deg: float
    seed: int
    by_map: bool = False


@dataclass(frozen=True, slots=True)
class _View:
    """Points of one scan within the field of view. points_lidar: (n, 3) [m].   elapsed_s: (n,)."""

    points_lidar: FloatArray
    elapsed_s: FloatArray


def run_front_end(
    scans: Sequence[Scan],
    positions: range,
    *,
    planes: Sequence[Plane] | None,
    selection: Selection,
    on_event: OnEvent,
    should_cancel: ShouldCancel,
) -> FrontEnd:
    """The map, and every scan's points on it.

    positions: of the scans looked at; the first is the map's.   planes: known ones in its frame, else they are
    detected.
    Without a plane in the first scan: an empty map and no tracked scans.
    """
    epoch_ns = scans[positions[0]].stamp_ns
    first = _view(scans[positions[0]], selection)
    if planes is None:
        fits = _distinct(segment_planes(first.points_lidar, seed=selection.seed, settings=_FIRST_SCAN))
        fits = [_refitted(fit, first) for fit in _off_edges(fits, first)]
        planes = [Plane(f"plane {i + 1}", fit.normal, fit.offset_m) for i, fit in enumerate(fits)]
    else:
        fits = _off_edges([_on_plane(first, plane) for plane in planes], first)
    if not fits:
        return FrontEnd(epoch_ns, (), (), tuple(positions), 0.0)
    range_std_m = _range_std(first, fits)
    tracker = _Tracker(tuple(planes), selection, epoch_ns)
    tracked = [tracker.track(positions[0], scans[positions[0]], first, fits, None)]
    dropped: list[int] = []
    for position in positions[1:]:
        if should_cancel():
            raise Cancelled("stopped while planes were tracked from scan to scan; nothing was written")
        view = _view(scans[position], selection)
        found = _segmented(view, selection.seed)
        limit = min(_MAX_TURN_RAD * (position - tracked[-1].position), _MAX_TURN_AFTER_LOSS_RAD)
        match = match_normals(_normals(fits), _normals(found), max_turn_rad=limit)
        if match is None:
            dropped.append(position)
        else:
            fits = _off_edges([found[i] for i in match], view)
            tracked.append(tracker.track(position, scans[position], view, fits, tracked[-1]))
        fraction = (position - positions[0]) / len(positions)
        on_event(StageEvent(stage="track", fraction=fraction, text=f"{counted(len(dropped), 'scan')} lost"))
    return FrontEnd(epoch_ns, tracker.planes, tuple(tracked), tuple(dropped), range_std_m)


@dataclass(frozen=True, slots=True)
class _Tracker:
    """Makes tracked scans: the points of the matched planes, the rough pose, and the points kept for the solve."""

    planes: tuple[Plane, ...]
    selection: Selection
    epoch_ns: int

    def track(
        self, position: int, scan: Scan, view: _View, fits: Sequence[PlaneFit], last: TrackedScan | None
    ) -> TrackedScan:
        plane = np.full(view.points_lidar.shape[0], -1, dtype=np.int64)
        for i, fit in enumerate(fits):
            plane[fit.inliers] = i
        on_any = np.flatnonzero(plane >= 0)
        normals = np.array([each.normal for each in self.planes])
        offsets = np.array([each.offset_m for each in self.planes])
        R, p = np.eye(3), np.zeros(3)
        if last is not None:
            points, of = view.points_lidar[on_any], plane[on_any]
            R, p = rough_pose(points, normals[of], offsets[of], last.R_map_lidar, last.p_map_lidar)
            if self.selection.by_map:
                fits = _off_edges(
                    [_seen_from(each, R, p, fit, view) for each, fit in zip(self.planes, fits, strict=True)], view
                )
                plane[:] = -1
                for i, fit in enumerate(fits):
                    plane[fit.inliers] = i
                on_any = np.flatnonzero(plane >= 0)
        start_s = (scan.stamp_ns - self.epoch_ns) * 1e-9
        pose_s = start_s + float(np.mean(view.elapsed_s[on_any]))
        kept = on_any[_capped(plane[on_any], self.selection, position)]
        return TrackedScan(
            position, start_s, view.points_lidar[kept], view.elapsed_s[kept], plane[kept], R, p, pose_s
        )  # fmt: skip


def _view(scan: Scan, selection: Selection) -> _View:
    xyz = scan.points["xyz"].astype(np.float64)
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0])
    kept = np.abs(azimuth) <= np.radians(selection.field_of_view_deg)
    return _View(xyz[kept], scan.points["offset_ns"][kept] * 1e-9)


def _segmented(view: _View, seed: int) -> list[PlaneFit]:
    """The planes of a scan, found among some of its points, with all points in their bands."""
    # At random: a stride could leave out whole rings.
    n_points = view.points_lidar.shape[0]
    some = np.random.default_rng(seed).permutation(n_points)[:_SEGMENTED_POINTS]
    thinned = view.points_lidar[np.sort(some)]
    fits = []
    for fit in segment_planes(thinned, seed=seed, settings=_EACH_SCAN):
        distance = np.abs(view.points_lidar @ fit.normal + fit.offset_m)
        fits.append(replace(fit, inliers=distance < max(3.0 * fit.rms_m, _LEAST_BAND_M)))
    return fits


def _normals(fits: Sequence[PlaneFit]) -> FloatArray:
    return np.array([fit.normal for fit in fits]).reshape(-1, 3)


def _distinct(fits: Sequence[PlaneFit]) -> list[PlaneFit]:
    """The largest planes of clearly different directions."""
    chosen: list[PlaneFit] = []
    for fit in fits:
        if all(fit.normal @ other.normal < np.cos(_MIN_ANGLE_RAD) for other in chosen):
            chosen.append(fit)
    return chosen


def _off_edges(fits: Sequence[PlaneFit], view: _View) -> list[PlaneFit]:
    """The same planes without the points that are close to two of them."""
    near = np.zeros(view.points_lidar.shape[0], dtype=np.int64)
    for fit in fits:
        near += np.abs(view.points_lidar @ fit.normal + fit.offset_m) < _EDGE_M
    return [replace(fit, inliers=fit.inliers & (near < 2)) for fit in fits]


def _refitted(fit: PlaneFit, view: _View) -> PlaneFit:
    """The plane of least squares through the points that are left."""
    if fit.inliers.sum() < _FIRST_SCAN.min_points:
        return fit
    normal, offset_m, std_m = fit_plane(view.points_lidar[fit.inliers])
    side = 1.0 if normal @ fit.normal >= 0 else -1.0
    return PlaneFit(side * normal, side * offset_m, fit.inliers, float(std_m[0]))


def _on_plane(view: _View, plane: Plane) -> PlaneFit:
    """The first scan's points on a plane that is already known; its normal turned to the sensor's side."""
    distance = view.points_lidar @ plane.normal + plane.offset_m
    inliers = np.abs(distance) < _FIRST_SCAN.distance_m
    rms = float(np.sqrt(np.mean(distance[inliers] ** 2))) if inliers.any() else 0.0
    side = 1.0 if plane.offset_m >= 0 else -1.0
    return PlaneFit(side * plane.normal, side * plane.offset_m, inliers, rms)


def _seen_from(plane: Plane, R: FloatArray, p: FloatArray, fit: PlaneFit, view: _View) -> PlaneFit:
    """A map's plane in a scan taken from R, p, and the scan's points as near to it as those of the scan's own fit are."""
    normal, offset_m = R.T @ plane.normal, float(plane.normal @ p + plane.offset_m)
    distance = np.abs(view.points_lidar @ normal + offset_m)
    return PlaneFit(normal, offset_m, distance < max(3.0 * fit.rms_m, _LEAST_BAND_M), fit.rms_m)


def _range_std(view: _View, fits: Sequence[PlaneFit]) -> float:
    """The range's standard deviation [m], from distances to the planes and the angle at which the beam meets them."""
    errors = []
    for fit in fits:
        points = view.points_lidar[fit.inliers]
        cosine = np.abs(points @ fit.normal) / np.linalg.norm(points, axis=1)
        seen = cosine > _FLAT_COSINE
        errors.append((points @ fit.normal + fit.offset_m)[seen] / cosine[seen])
    joined = np.concatenate(errors)
    return float(np.sqrt(np.mean(joined**2))) if joined.size else 0.0


def _capped(plane: IntArray, selection: Selection, position: int) -> IntArray:
    """Which points to keep: at most the given number on each plane, chosen at random, in order. plane: (n,)."""
    if selection.points_per_plane is None:
        return np.arange(plane.size)
    rng = np.random.default_rng([selection.seed, position])
    kept = []
    for index in np.unique(plane):
        mine = np.flatnonzero(plane == index)
        if mine.size > selection.points_per_plane:
            mine = rng.choice(mine, selection.points_per_plane, replace=False)
        kept.append(mine)
    return np.sort(np.concatenate(kept)) if kept else np.empty(0, dtype=np.int64)
