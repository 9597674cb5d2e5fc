"""The scene of the inspection: raw, de-skewed and old clouds, in one place, side by side or cut by a wipe.

raw        the sweep as one rigid body at its first point's pose: what is seen without unsweep
deskewed   every point moved by the pose at its own time, with the answer, or with a nudged one
old        the same with the extrinsic the user had before
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal

import numpy as np

from app.planes import palette
from app.planes.palette import Colors
from app.results.imu_pose import imu_pose
from app.results.plane_table import PlaneTable
from app.results.thickness import GATE_M
from app.results.thinning import spread, thinned_scan
from app.scene.aim import DIRECTIONS, Stage
from app.scene.build import Solved, ground, legend_of, lightness, scan_colors, texture
from app.scene.camera import Camera
from app.scene.items import ONE_PLACE, Axes, Cloud, Content, Item, Label, Line, breadth_m, frame_names, point_size_m
from app.scene.readout import Readout, from_plane
from app.scene.wipe import left_of
from app.schemas.view import Against, ColorBy, Extent, Preset, Show
from calib_core import api
from calib_core.types import BoolArray, Float32Array, FloatArray, Recording, Scan, Trajectory

Source = Literal["raw", "deskewed", "old"]

#: Colours: how far from a plane a point still takes its colour, and where the residual's scale ends.
PLANE_GATE_M = GATE_M
RESIDUAL_GATE_M = 0.30
RESIDUAL_HALF_M = 0.05
#: Scans accumulated in the map.
MAP_SCANS = 60
#: Clouds beside each other stand this much of their own breadth apart.
SIDE_STEP = 1.12

TITLES: dict[Source, str] = {"raw": "Raw", "deskewed": "De-skewed", "old": "Old extrinsic"}
ONE_COLOR: dict[Source, palette.Rgb] = {
    "raw": palette.RAW,
    "deskewed": palette.DESKEWED,
    "old": palette.OLD,
}


@dataclass(frozen=True)
class Look:
    """What is wanted of the view, and how much can be drawn."""

    place: int
    show: Show
    against: Against
    extent: Extent
    color_by: ColorBy
    wipe: float
    limit: int
    stage: Stage = field(default_factory=Stage)
    #: From where it is looked at: clouds beside each other stand across that view, not one behind another.
    preset: Preset = "overview"
    #: Whether the background is.
    dark: bool = True


@dataclass(frozen=True)
class Motions:
    """The answer, what is shown as de-skewed (nudged, perhaps), and the old extrinsic's motion."""

    solved: Solved
    shown: Trajectory
    old: Trajectory | None
    #: What the old one is called; "" where nobody named it. It may be another run, which is not old.
    old_name: str = ""

    def title(self, source: Source) -> str:
        """What a cloud is called."""
        return self.old_name if source == "old" and self.old_name else TITLES[source]


def build_inspection(recording: Recording, look: Look, motions: Motions, camera: Camera | None) -> Content:
    """The clouds that are asked for, with the path and both sensors' frames."""
    sources = _sources(look, motions)
    # Of a wipe's two clouds about one half each is drawn.
    each = look.limit if look.show == "wipe" else look.limit // len(sources)
    one_color = look.show == "both"
    parts = [_cloud(recording, look, motions, source, each, one_color=one_color) for source in sources]
    kept: list[BoolArray | slice] = [slice(None)] * len(parts)
    if look.show == "wipe" and camera is not None:
        keep: list[Callable[[BoolArray], BoolArray]] = [lambda left: left, lambda left: ~left]
        chosen = [side(left_of(part.xyz, camera, look.wipe)) for part, side in zip(parts, keep, strict=True)]
        parts = [_kept(part, mask) for part, mask in zip(parts, chosen, strict=True)]
        kept = list(chosen)
    shifts = [np.zeros(3) for _ in parts]
    labels: list[Item] = []
    if look.show == "side":
        shifts = _shifts(parts, look)
        parts = [_moved(part, shift) for part, shift in zip(parts, shifts, strict=True)]
        labels = [_title(part, source, motions, look.stage) for part, source in zip(parts, sources, strict=True)]
    stand = shifts[sources.index("deskewed")] if "deskewed" in sources else shifts[-1]
    frames = _motion(recording, look, motions, stand, breadth_m([part.xyz for part in parts]))
    beside = look.show == "side"
    return Content(
        items=(*parts, *labels, *frames, *(() if beside else ground(parts[-1].xyz, look.stage))),
        legend=_legend(look, sources, motions),
        aim=f"side of {len(sources)}" if beside else ONE_PLACE,
        # Beside each other there is more than one room, and walls of none of them are where the planes say.
        stage=replace(look.stage, walls=look.stage.walls[:0]) if beside else look.stage,
        readout=_readout(
            parts, shifts, motions.solved, cache(lambda: _returns(recording, look, motions, limit=each, kept=kept))
        ),
    )


def _sources(look: Look, motions: Motions) -> tuple[Source, ...]:
    """Left to right. Without an old extrinsic, what asks for it shows the raw cloud."""
    against: Source = "old" if look.against == "old" and motions.old is not None else "raw"
    match look.show:
        case "raw" | "deskewed":
            return (look.show,)
        case "old":
            return ("old" if motions.old is not None else "raw",)
        case "side":
            return ("raw", "deskewed") if motions.old is None else ("raw", "old", "deskewed")
        case "both" | "wipe":
            return (against, "deskewed")


def _scans(recording: Recording, look: Look, trajectory: Trajectory, limit: int) -> list[Scan]:
    """Those of the cloud, thinned. A map is made of those whose motion is known; one that is asked for is shown anyway."""
    places = [look.place] if look.extent == "scan" else spread(len(recording.scans), MAP_SCANS)
    if look.extent != "scan":
        places = [place for place in places if api.covers(trajectory, recording.scans[place])] or places
    each = max(1, limit // len(places))
    return [thinned_scan(recording.scans[place], each) for place in places]


def _cloud(recording: Recording, look: Look, motions: Motions, source: Source, limit: int, *, one_color: bool) -> Cloud:
    scans = _scans(recording, look, motions.solved.trajectory, limit)
    points = [_points(scan, motions, source) for scan in scans]
    if one_color:
        rgb = palette.uniform(sum(len(part) for part in points), ONE_COLOR[source])
    else:
        pairs = zip(scans, points, strict=True)
        rgb = np.concatenate([_colors(scan, part, motions.solved, look) for scan, part in pairs])
    xyz = np.concatenate(points)
    return Cloud(f"/{source}", xyz, rgb, point_size_m(xyz))


def _returns(
    recording: Recording, look: Look, motions: Motions, *, limit: int, kept: Sequence[BoolArray | slice]
) -> FloatArray:
    """(N, 4) of the points of all clouds, one behind the other: scan, laser, range [m], time in the sweep [ms]."""
    columns = [
        np.stack(
            [
                np.full(len(scan.points), scan.index, dtype=np.float64),
                scan.points["ring"].astype(np.float64),
                np.linalg.norm(scan.points["xyz"], axis=1).astype(np.float64),
                scan.points["offset_ns"] * 1e-6,
            ],
            axis=1,
        )
        for scan in _scans(recording, look, motions.solved.trajectory, limit)
    ]
    of_cloud = np.concatenate(columns)
    return np.concatenate([of_cloud[mask] for mask in kept])


def _readout(
    parts: list[Cloud], shifts: list[FloatArray], solved: Solved, returns: Callable[[], FloatArray]
) -> Readout:
    """returns: made when a point is first asked for, since most scenes are only looked at."""
    drawn = np.concatenate([part.xyz for part in parts])
    part_of = np.repeat(np.arange(len(parts)), [len(part.xyz) for part in parts])
    table = PlaneTable.of(solved.planes)

    def says(place: int) -> str:
        scan, ring, range_m, ms = returns()[place]
        here = (drawn[place] - shifts[part_of[place]]).astype(np.float32)[None]
        owner, dist_m = table.nearest(here, gate_m=RESIDUAL_GATE_M)
        on = "no plane near" if owner[0] < 0 else from_plane(solved.planes[owner[0]].name, float(dist_m[0]))
        return f"{on}; ring {ring:.0f}, {range_m:.2f} m away, {ms:.1f} ms into scan {scan + 1:.0f}"

    return Readout(drawn, says)


def _points(scan: Scan, motions: Motions, source: Source) -> Float32Array:
    if source == "raw":
        return api.raw_map_points(scan, motions.solved.trajectory)
    trajectory = motions.old if source == "old" and motions.old is not None else motions.shown
    return api.map_points(scan, trajectory)


def _colors(scan: Scan, points_map: Float32Array, solved: Solved, look: Look) -> Colors:
    if look.color_by in {"time", "intensity"}:
        return scan_colors(scan, look.color_by)
    table = PlaneTable.of(solved.planes)
    if look.color_by == "plane":
        owner, _ = table.nearest(points_map, gate_m=PLANE_GATE_M)
        rgb = palette.by_label(owner, [palette.plane_rgb(place) for place in solved.colors])
        light = lightness(table.equations, look.stage)[owner]
        return palette.lit(rgb, light * texture(scan.points["intensity"].astype(np.float32)))
    _, dist_m = table.nearest(points_map, gate_m=RESIDUAL_GATE_M, bounded=False)
    return palette.diverging(dist_m, RESIDUAL_HALF_M, dark=look.dark)


def _kept(cloud: Cloud, chosen: BoolArray) -> Cloud:
    return Cloud(cloud.path, cloud.xyz[chosen], cloud.rgb[chosen], cloud.size_m)


def _moved(cloud: Cloud, shift_m: FloatArray) -> Cloud:
    return Cloud(cloud.path, (cloud.xyz + shift_m).astype(np.float32), cloud.rgb, cloud.size_m)


def _shifts(parts: list[Cloud], look: Look) -> list[FloatArray]:
    """Where clouds beside each other go: evenly spaced about where one alone would be, to the right of who looks."""
    x, y, _ = DIRECTIONS[look.preset]
    direction: FloatArray = np.array([-y, x, 0.0]) / np.hypot(x, y) @ look.stage.R_level_scene
    along_m = parts[-1].xyz @ direction if len(parts[-1].xyz) else np.zeros(1)
    low, high = np.percentile(along_m, [2, 98])
    step_m = SIDE_STEP * max(1.0, float(high - low))
    return [(place - (len(parts) - 1) / 2) * step_m * direction for place in range(len(parts))]


def _title(cloud: Cloud, source: Source, motions: Motions, stage: Stage) -> Label:
    if len(cloud.xyz) == 0:
        return Label(f"/titles/{source}", motions.title(source), np.zeros(3))
    low, high = np.percentile(cloud.xyz @ stage.R_level_scene.T, [2, 98], axis=0)
    above = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[2] + 1.1]) @ stage.R_level_scene
    return Label(f"/titles/{source}", motions.title(source), above)


def _motion(recording: Recording, look: Look, motions: Motions, stand: FloatArray, breadth: float) -> tuple[Item, ...]:
    """The way the lidar took, the part behind it brighter, and both sensors' axes at the scan's time."""
    trajectory, T_imu_lidar = motions.shown, motions.solved.T_imu_lidar
    path = (trajectory.p_map_lidar + stand).astype(np.float32)
    scan_s = trajectory.begin_s(recording.scans[look.place])
    knot = int(np.abs(trajectory.times_s - scan_s).argmin())
    R_map_lidar, p_map_lidar = trajectory.R_map_lidar[knot], trajectory.p_map_lidar[knot] + stand
    R_map_imu, p_map_imu = imu_pose(R_map_lidar, p_map_lidar, T_imu_lidar)
    items: list[Item] = [Line("/path/whole", path[spread(len(path), 2000)], palette.NO_PLANE)]
    if knot > 0:
        behind = path[: knot + 1]
        items.append(Line("/path/behind", behind[spread(len(behind), 2000)], palette.PATH, width_px=3.0))
    return (
        *items,
        Axes("/lidar", R_map_lidar, p_map_lidar, 0.45),
        Axes("/imu", R_map_imu, p_map_imu, 0.3),
        *frame_names(p_map_lidar, p_map_imu, breadth, up=look.stage.up),
    )


def _legend(look: Look, sources: tuple[Source, ...], motions: Motions) -> str:
    colours = legend_of(look.color_by, dark=look.dark)
    # A name given keeps its letters.
    first = motions.old_name if sources[0] == "old" and motions.old_name else TITLES[sources[0]].lower()
    if look.show == "both":
        return f"{'Orange' if sources[0] == 'raw' else 'Magenta'}: {first}; blue: de-skewed."
    if look.show == "wipe":
        return f"Left of the line: {first}; right: de-skewed. {colours}"
    return colours
