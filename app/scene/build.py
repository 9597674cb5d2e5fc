"""From state to items: pure functions, one per mode. Nothing here knows viser, HTTP or files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.planes import palette
from app.planes.geometry import labels, within_region
from app.planes.palette import Colors
from app.planes.state import EditedPatch, PlaneSet
from app.scene.items import FIRST_SCANS, WHOLE_ROOM, Axes, Cloud, Content, Item, Label, Sheet
from app.schemas.view import ColorBy
from calib_core.result import PlaneQuality
from calib_core.types import Float32Array, FloatArray, PlaneProposals, PointArray, Recording, Scan, Trajectory

CONFIRMED_OPACITY = 0.40
DROPPED_OPACITY = 0.10
TARGET_OPACITY = 0.75
#: Of the points outside a box every so many-th is drawn.
OUTSIDE_STRIDE = 6

#: What the colours mean.
LEGENDS: dict[ColorBy, str] = {
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
    time_offset_s: float = 0.0


def build_planes(
    proposals: PlaneProposals, planes: PlaneSet, *, limit: int, judging: bool = True, target: int | None = None
) -> Content:
    """The static cloud coloured by patch, a sheet per patch to click, and the lidar's axes.

    judging: a click confirms or drops.   target: the patch that the next box is for.
    """
    owner = labels(proposals, planes)
    shown = thinned(len(proposals.cloud_m), limit)
    if planes.region:  # what a box has left out stays as a trace
        inside = within_region(proposals.cloud_m[shown], planes.region)
        shown = np.concatenate([shown[inside], shown[~inside][::OUTSIDE_STRIDE]])
    rgb = palette.by_label(owner[shown], [_patch_rgb(patch) for patch in planes.patches])
    items: list[Item] = [
        Cloud("/cloud", proposals.cloud_m[shown], rgb),
        Axes("/lidar", np.eye(3), np.zeros(3), 0.5),
    ]
    for place, patch in enumerate(planes.patches):
        sheet = _sheet(place, patch)
        if sheet is not None and place == target:
            sheet = replace(sheet, opacity=TARGET_OPACITY)
        if sheet is not None:
            items.append(sheet)
            items.append(Label(f"/names/{place}", patch.name, sheet.vertices[0].astype(np.float64)))
    return Content(
        items=tuple(items),
        legend="Colour: the plane; a dropped one is faint, grey is no plane."
        + (" Click a plane to change it." if judging else ""),
        aim=WHOLE_ROOM,
        # What lies outside a box makes no plane, so it is no place to click either.
        pickable_m=proposals.cloud_m[within_region(proposals.cloud_m, planes.region)],
    )


def build_unsolved(recording: Recording, place: int, *, color_by: ColorBy, limit: int, note: str) -> Content:
    """One scan as it came, lidar frame, before there is an answer."""
    scan = thinned_scan(recording.scans[place], limit)
    by: ColorBy = "intensity" if color_by == "intensity" else "time"
    cloud = Cloud("/raw", scan.points["xyz"].astype(np.float32), scan_colors(scan, by))
    return Content(items=(cloud, Axes("/lidar", np.eye(3), np.zeros(3), 0.5)), legend=LEGENDS[by], note=note)


def build_first(points: PointArray, *, limit: int, note: str) -> Content:
    """The first points (N,) of a recording, lidar frame, before its planes are known."""
    shown: PointArray = points[thinned(len(points), limit)]
    scan = Scan(index=0, stamp_ns=0, points=shown)
    cloud = Cloud("/cloud", shown["xyz"].astype(np.float32), scan_colors(scan, "intensity"))
    axes = Axes("/lidar", np.eye(3), np.zeros(3), 0.5)
    return Content(items=(cloud, axes), legend=LEGENDS["intensity"], note=note, aim=FIRST_SCANS)


def build_straightened(
    scan: Scan, points_m: Float32Array, *, R_lidar_imu: FloatArray, p_lidar_imu: FloatArray
) -> Content:
    """One sweep with the motion of the current estimate taken out, and where that estimate has the IMU.

    points_m: (N, 3), the scan's points in the lidar frame at the sweep's start.
    """
    return Content(
        items=(
            Cloud("/sweep", points_m, scan_colors(scan, "time")),
            Axes("/lidar", np.eye(3), np.zeros(3), 0.5),
            Axes("/imu", R_lidar_imu, p_lidar_imu, 0.3),
        ),
        legend="The sweep that turned fastest, with the estimate's motion taken out. " + LEGENDS["time"],
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


def _patch_rgb(patch: EditedPatch) -> palette.Rgb:
    """The colour of a patch's points: that of its plane, and only a trace of it once it is dropped."""
    rgb = palette.plane_rgb(patch.color)
    return rgb if patch.confirmed else palette.faint(rgb)


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


def scan_colors(scan: Scan, color_by: ColorBy) -> Colors:
    """(N, 3) colours by what a scan itself says: time in the sweep, or intensity."""
    if len(scan.points) == 0:
        return palette.uniform(0, palette.NO_PLANE)
    if color_by == "time":
        offset_ns = scan.points["offset_ns"].astype(np.float32)
        return palette.sequential(offset_ns, 0.0, float(offset_ns.max()))
    intensity = scan.points["intensity"].astype(np.float32)
    low, high = np.percentile(intensity, [2, 98])
    return palette.sequential(intensity, float(low), float(high))
