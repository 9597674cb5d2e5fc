"""From state to items: pure functions, one per mode. Nothing here knows viser, HTTP or files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.planes.geometry import labels
from app.planes.state import EditedPatch, PlaneSet
from app.results.thickness import nearest_plane, rigid_map_points, spread
from app.scene import palette
from app.scene.items import Axes, Cloud, Content, Item, Label, Line, Sheet
from app.scene.palette import Colors
from app.schemas.view import ColorBy, Show
from calib_core import api
from calib_core.result import PlaneQuality
from calib_core.types import Float32Array, FloatArray, PlaneProposals, PointArray, Recording, Scan, Trajectory

CONFIRMED_OPACITY = 0.40
DROPPED_OPACITY = 0.10
#: Colours: how far from a plane a point still takes its colour, and where the residual's scale ends.
PLANE_GATE_M = 0.10
RESIDUAL_GATE_M = 0.30
RESIDUAL_HALF_M = 0.05
#: Scans accumulated in the map.
MAP_SCANS = 60

_LEGENDS: dict[ColorBy, str] = {
    "plane": "Colour: the plane a point lies on, within 0.1 m; grey: none.",
    "time": "Colour: time in the sweep, dark blue first, yellow last.",
    "residual": "Colour: signed distance to the nearest plane, blue -50 mm, white 0, orange +50 mm; grey: none near.",
    "intensity": "Colour: intensity, dark blue weak, yellow strong.",
}


@dataclass(frozen=True)
class Solved:
    """What a solve left for showing. colors: palette place of each plane.   T_imu_lidar: (4, 4)."""

    trajectory: Trajectory
    planes: Sequence[PlaneQuality]
    colors: list[int]
    T_imu_lidar: FloatArray


def build_planes(proposals: PlaneProposals, planes: PlaneSet, *, limit: int) -> Content:
    """The static cloud coloured by patch, a sheet per patch to click, and the lidar's axes."""
    owner = labels(proposals, planes)
    shown = thinned(len(proposals.cloud_m), limit)
    rgb = palette.by_label(owner[shown], [patch.color for patch in planes.patches])
    items: list[Item] = [
        Cloud("/cloud", proposals.cloud_m[shown], rgb),
        Axes("/lidar", np.eye(3), np.zeros(3), 0.5),
    ]
    for place, patch in enumerate(planes.patches):
        sheet = _sheet(place, patch)
        if sheet is not None:
            items.append(sheet)
            items.append(Label(f"/names/{place}", patch.name, sheet.vertices[0].astype(np.float64)))
    return Content(
        items=tuple(items),
        legend="Colour: the plane; a confirmed plane is filled, a dropped one faint. Click a plane to change it.",
        pickable_m=proposals.cloud_m,
    )


def build_scan(
    recording: Recording, place: int, solved: Solved, *, show: Show, color_by: ColorBy, limit: int
) -> Content:
    """One scan (or the accumulated map) in the map frame, raw, de-skewed or both, with the motion as a line."""
    trajectory = solved.trajectory
    if show == "map":
        clouds = [_map_cloud(recording, solved, color_by, limit)]
    else:
        scan = thinned_scan(recording.scans[place], limit // 2 if show == "both" else limit)
        clouds = []
        if show in {"raw", "both"}:
            rigid = rigid_map_points(scan, trajectory)
            one = palette.uniform(len(rigid), palette.RAW)
            clouds.append(Cloud("/raw", rigid, one if show == "both" else _colors(scan, rigid, solved, color_by)))
        if show in {"deskewed", "both"}:
            moved = api.map_points(scan, trajectory)
            one = palette.uniform(len(moved), palette.DESKEWED)
            clouds.append(Cloud("/deskewed", moved, one if show == "both" else _colors(scan, moved, solved, color_by)))
    legend = "Orange: as published; blue: de-skewed." if show == "both" else _LEGENDS[color_by]
    return Content(items=(*clouds, *_motion(recording, place, trajectory)), legend=legend)


def build_unsolved(recording: Recording, place: int, *, color_by: ColorBy, limit: int, note: str) -> Content:
    """One scan as published, lidar frame, before there is an answer."""
    scan = thinned_scan(recording.scans[place], limit)
    by: ColorBy = "intensity" if color_by == "intensity" else "time"
    cloud = Cloud("/raw", scan.points["xyz"].astype(np.float32), _scan_colors(scan, by))
    return Content(items=(cloud, Axes("/lidar", np.eye(3), np.zeros(3), 0.5)), legend=_LEGENDS[by], note=note)


def build_straightened(
    scan: Scan, points_m: Float32Array, *, R_lidar_imu: FloatArray, p_lidar_imu: FloatArray
) -> Content:
    """One sweep with the motion of the current estimate taken out, and where that estimate has the IMU.

    points_m: (N, 3), the scan's points in the lidar frame at the sweep's start.
    """
    return Content(
        items=(
            Cloud("/sweep", points_m, _scan_colors(scan, "time")),
            Axes("/lidar", np.eye(3), np.zeros(3), 0.5),
            Axes("/imu", R_lidar_imu, p_lidar_imu, 0.3),
        ),
        legend="The sweep that turned fastest, with the estimate's motion taken out. " + _LEGENDS["time"],
    )


def empty(note: str) -> Content:
    """Nothing to show, and why."""
    return Content(items=(Axes("/lidar", np.eye(3), np.zeros(3), 0.5),), legend="", note=note)


def thinned(count: int, limit: int) -> NDArray[np.int64]:
    """At most `limit` places spread evenly over 0 .. count - 1; the same ones each time."""
    if count <= limit:
        return np.arange(count)
    return np.linspace(0, count - 1, limit).astype(np.int64)


def thinned_scan(scan: Scan, limit: int) -> Scan:
    """The scan with at most `limit` of its points."""
    if len(scan.points) <= limit:
        return scan
    points: PointArray = scan.points[thinned(len(scan.points), limit)]
    return Scan(index=scan.index, stamp_ns=scan.stamp_ns, points=points)


def _sheet(place: int, patch: EditedPatch) -> Sheet | None:
    corners = np.array(patch.outline_m, dtype=np.float32).reshape(-1, 3)
    count = len(corners)
    if count < 3:
        return None
    around = np.arange(count, dtype=np.uint32)
    faces = np.stack([np.zeros_like(around), 1 + around, 1 + (around + 1) % count], axis=1)
    return Sheet(
        path=f"/planes/{place}",
        vertices=np.concatenate([corners.mean(axis=0, keepdims=True), corners]),
        faces=faces.astype(np.uint32),
        rgb=palette.plane_rgb(patch.color) if patch.confirmed else palette.NO_PLANE,
        opacity=CONFIRMED_OPACITY if patch.confirmed else DROPPED_OPACITY,
        patch=place,
    )


def _map_cloud(recording: Recording, solved: Solved, color_by: ColorBy, limit: int) -> Cloud:
    places = spread(len(recording.scans), MAP_SCANS)
    each = max(1, limit // max(1, len(places)))
    scans = [thinned_scan(recording.scans[place], each) for place in places]
    moved = [api.map_points(scan, solved.trajectory) for scan in scans]
    rgb = [_colors(scan, points, solved, color_by) for scan, points in zip(scans, moved, strict=True)]
    return Cloud("/map", np.concatenate(moved), np.concatenate(rgb))


def _colors(scan: Scan, points_map: Float32Array, solved: Solved, color_by: ColorBy) -> Colors:
    if color_by in {"time", "intensity"}:
        return _scan_colors(scan, color_by)
    normals = np.array([plane.normal for plane in solved.planes], dtype=np.float64).reshape(-1, 3)
    offsets_m = np.array([plane.offset_m for plane in solved.planes], dtype=np.float64)
    if color_by == "plane":
        owner, _ = nearest_plane(points_map, normals, offsets_m, gate_m=PLANE_GATE_M)
        return palette.by_label(owner, solved.colors)
    _, dist_m = nearest_plane(points_map, normals, offsets_m, gate_m=RESIDUAL_GATE_M)
    return palette.diverging(dist_m, RESIDUAL_HALF_M)


def _scan_colors(scan: Scan, color_by: ColorBy) -> Colors:
    if len(scan.points) == 0:
        return palette.uniform(0, palette.NO_PLANE)
    if color_by == "time":
        offset_ns = scan.points["offset_ns"].astype(np.float32)
        return palette.sequential(offset_ns, 0.0, float(offset_ns.max()))
    intensity = scan.points["intensity"].astype(np.float32)
    low, high = np.percentile(intensity, [2, 98])
    return palette.sequential(intensity, float(low), float(high))


def _motion(recording: Recording, place: int, trajectory: Trajectory) -> tuple[Item, ...]:
    path = trajectory.p_map_lidar[thinned(len(trajectory.p_map_lidar), 2000)].astype(np.float32)
    scan_s = (recording.scans[place].stamp_ns - trajectory.epoch_ns) * 1e-9
    knot = int(np.abs(trajectory.times_s - scan_s).argmin())
    return (
        Line("/motion", path, palette.NO_PLANE),
        Axes("/sensor", trajectory.R_map_lidar[knot], trajectory.p_map_lidar[knot], 0.4),
    )
