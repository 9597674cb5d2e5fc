"""From state to items: pure functions, one per mode. Nothing here knows viser, HTTP or files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.planes import palette
from app.planes.geometry import labels, within_region
from app.planes.palette import Colors
from app.planes.state import EditedPatch, PlaneSet
from app.results.plane_table import PlaneTable
from app.results.thinning import spread, thinned_scan
from app.scene.aim import Stage, stage_of
from app.scene.items import (
    FIRST_SCANS,
    WHOLE_ROOM,
    Axes,
    Cloud,
    Content,
    Edges,
    Floor,
    Item,
    Label,
    Sheet,
    point_size_m,
)
from app.scene.readout import Readout, from_plane, lean
from app.scene.support import support_of
from app.scene.upright import vertical_of
from app.schemas.results import Thickness
from app.schemas.view import ColorBy
from calib_core.result import PlaneQuality
from calib_core.types import Float32Array, FloatArray, PlaneProposals, PointArray, Recording, Scan, Trajectory

CONFIRMED_OPACITY = 0.3
DROPPED_OPACITY = 0.08
TARGET_OPACITY = 0.6
#: Where the lamp is, level axes, and how dark a wall is that it only grazes.
LAMP = np.array([0.48, 0.29, 0.83])
DARKEST = 0.72
#: How much of a colour's lightness intensity may take or add.
TEXTURE = 0.18
#: The grid lies this much below the floor, whose own points it must not cut.
UNDER_FLOOR_M = 0.03
#: Of the points outside a box every so many-th is drawn.
OUTSIDE_STRIDE = 6

#: What the colours mean.
LEGENDS: dict[ColorBy, str] = {
    "plane": "Colour: the plane a point lies on, within 0.1 m; grey: none.",
    "time": "Colour: time in the sweep, dark blue first, yellow last.",
    "residual": "Colour: signed distance to the nearest plane, "
    "blue \N{MINUS SIGN}50 mm, {zero} 0, orange +50 mm; grey: none near.",
    "intensity": "Colour: intensity, dark blue weak, yellow strong.",
}


def legend_of(color_by: ColorBy, *, dark: bool) -> str:
    """What the colours mean on such a background."""
    return LEGENDS[color_by].format(zero=palette.ZERO[dark])


@dataclass(frozen=True)
class Solved:
    """What a solve left for showing. colors: palette place of each plane.   T_imu_lidar: (4, 4).

    walls: how thick they were measured to be: the one number that every screen tells; None where nobody has measured.
    """

    trajectory: Trajectory
    planes: Sequence[PlaneQuality]
    colors: list[int]
    T_imu_lidar: FloatArray
    time_offset_s: float = 0.0
    walls: Thickness | None = None


def solved_stage(recording: Recording, solved: Solved) -> Stage:
    """The solved planes, upright."""
    up = vertical_of(recording, solved.trajectory, solved.T_imu_lidar, time_offset_s=solved.time_offset_s)
    return stage_of(up, PlaneTable.of(solved.planes).equations)


def build_planes(
    proposals: PlaneProposals,
    planes: PlaneSet,
    *,
    limit: int,
    judging: bool = True,
    target: int | None = None,
    up: FloatArray | None = None,
    shaded: bool = True,
) -> Content:
    """The static cloud coloured by patch, a sheet per patch to click, the ground, and the lidar's axes.

    judging: a click confirms or drops.   target: the patch that the next box is for.   up: (3,) map frame, where it is
    known.   shaded: with depth; else the bare colours.
    """
    owner = labels(proposals, planes)
    walls = np.array([(*patch.normal, patch.offset_m) for patch in planes.patches], dtype=np.float64).reshape(-1, 4)
    stage = stage_of(up, walls)
    shown = spread(len(proposals.cloud_m), limit)
    if planes.region:  # what a box has left out stays as a trace
        inside = within_region(proposals.cloud_m[shown], planes.region)
        shown = np.concatenate([shown[inside], shown[~inside][::OUTSIDE_STRIDE]])
    xyz = proposals.cloud_m[shown]
    rgb = palette.by_label(owner[shown], [_patch_rgb(patch) for patch in planes.patches])
    if shaded:
        light = lightness(walls, stage)[owner[shown]]
        rgb = palette.lit(rgb, light * texture(proposals.cloud_intensity[shown]))
    items: list[Item] = [
        Cloud("/cloud", xyz, rgb, point_size_m(xyz)),
        Axes("/lidar", np.eye(3), np.zeros(3), 0.5),
        *ground(xyz, stage),
    ]
    for place, patch in enumerate(planes.patches):
        items += _drawn(place, patch, proposals.cloud_m[owner == place], stage, chosen=place == target)
    return Content(
        items=tuple(items),
        legend="Colour: the plane; a dropped one is faint, grey is no plane."
        + (" Click a plane to change it." if judging else ""),
        aim=WHOLE_ROOM if up is None else f"{WHOLE_ROOM}, upright",
        stage=stage,
        glass=True,
        readout=Readout(xyz, lambda place: _said(xyz[place], owner[shown[place]], planes, stage)),
        # What lies outside a box makes no plane, so it is no place to click either.
        pickable_m=proposals.cloud_m[within_region(proposals.cloud_m, planes.region)],
    )


def _said(point_m: Float32Array, owner: int, planes: PlaneSet, stage: Stage) -> str:
    """Of a point of the static cloud, which was seen from its origin: first of its plane, then of itself."""
    away = f"{np.linalg.norm(point_m):.2f} m from the lidar"
    if owner < 0:
        return f"No plane; this point is {away}"
    patch = planes.patches[owner]
    normal = np.array(patch.normal)
    off = from_plane("the plane", float(normal @ point_m + patch.offset_m))
    plane = f"{lean(normal, stage.up)}, {abs(patch.offset_m):.2f} m from the lidar"
    return f"{patch.name}: {plane}; this point is {away}, {off}"


def lightness(walls: FloatArray, stage: Stage) -> Float32Array:
    """(K + 1,) how light each wall (K, 4) is under a lamp that stands off to one side; the last is of what has no wall."""
    lamp = LAMP @ stage.R_level_scene
    return np.append(DARKEST + (1.0 - DARKEST) * np.abs(walls[:, :3] @ lamp), 1.0).astype(np.float32)


def texture(intensity: Float32Array) -> Float32Array:
    """(N,) a little lighter and darker by intensity: posters, edges and floors show in a colour that is all one."""
    if len(intensity) == 0:
        return np.ones(0, dtype=np.float32)
    low, high = np.percentile(intensity, [2, 98])
    share = np.clip((intensity - low) / max(float(high - low), 1e-9), 0.0, 1.0)
    return (1.0 + TEXTURE * (2.0 * share - 1.0)).astype(np.float32) if high > low else np.ones_like(intensity)


def ground(points_m: Float32Array, stage: Stage) -> tuple[Floor, ...]:
    """A grid of metres under the points (N, 3), once it is known which way is down."""
    if len(points_m) == 0:
        return ()
    level = points_m.astype(np.float64) @ stage.R_level_scene.T
    low, high = np.percentile(level, [1, 99], axis=0)
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2] - UNDER_FLOOR_M])
    width, depth = (2.0 * np.ceil((high - low)[:2] / 2.0 + 0.5)).tolist()
    return (Floor("/ground", stage.R_level_scene.T, middle @ stage.R_level_scene, (width, depth)),)


def _drawn(place: int, patch: EditedPatch, points_m: Float32Array, stage: Stage, *, chosen: bool) -> list[Item]:
    """A patch: the sheet of what is used of it, its outline, its name."""
    rgb = palette.plane_rgb(patch.color) if patch.confirmed else palette.NO_PLANE
    opacity = TARGET_OPACITY if chosen else CONFIRMED_OPACITY if patch.confirmed else DROPPED_OPACITY
    support = support_of(points_m, np.array([*patch.normal, patch.offset_m]), stage.up)
    path = f"/planes/{place}"
    if support is None:
        return []
    return [
        Sheet(path, support.vertices, support.faces, rgb, opacity, patch=place, wall=place),
        Edges(f"/outlines/{place}", support.edges, rgb, wall=place),
        Label(f"/names/{place}", patch.name, support.middle, wall=place),
    ]


def build_unsolved(recording: Recording, place: int, *, color_by: ColorBy, limit: int, note: str) -> Content:
    """One scan as it came, lidar frame, before there is an answer."""
    scan = thinned_scan(recording.scans[place], limit)
    by: ColorBy = "intensity" if color_by == "intensity" else "time"
    xyz = scan.points["xyz"].astype(np.float32)
    cloud = Cloud("/raw", xyz, scan_colors(scan, by), point_size_m(xyz))
    return Content(items=(cloud, Axes("/lidar", np.eye(3), np.zeros(3), 0.5)), legend=LEGENDS[by], note=note)


def build_first(points: PointArray, *, limit: int, note: str) -> Content:
    """The first points (N,) of a recording, lidar frame, before its planes are known."""
    shown: PointArray = points[spread(len(points), limit)]
    scan = Scan(index=0, stamp_ns=0, points=shown)
    xyz = shown["xyz"].astype(np.float32)
    cloud = Cloud("/cloud", xyz, scan_colors(scan, "intensity"), point_size_m(xyz))
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
            Cloud("/sweep", points_m, scan_colors(scan, "time"), point_size_m(points_m)),
            Axes("/lidar", np.eye(3), np.zeros(3), 0.5),
            Axes("/imu", R_lidar_imu, p_lidar_imu, 0.3),
        ),
        legend="The sweep that turned fastest, with the estimate's motion taken out. " + LEGENDS["time"],
    )


def empty(note: str) -> Content:
    """Nothing to show, and why."""
    return Content(items=(Axes("/lidar", np.eye(3), np.zeros(3), 0.5),), legend="", note=note)


def _patch_rgb(patch: EditedPatch) -> palette.Rgb:
    """The colour of a patch's points: that of its plane, and only a trace of it once it is dropped."""
    rgb = palette.plane_rgb(patch.color)
    return rgb if patch.confirmed else palette.faint(rgb)


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
