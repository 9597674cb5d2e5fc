"""What a scene is made of, as data. All coordinates in metres, in the frame the scene is drawn in."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.planes.palette import Colors, Rgb
from app.scene.aim import Stage
from app.scene.readout import Readout
from app.schemas.view import Preset
from calib_core.types import Float32Array, FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Cloud:
    """Points. xyz: (N, 3) float32, so that millimetres survive.   rgb: (N, 3)."""

    path: str
    xyz: Float32Array
    rgb: Colors
    size_m: float = 0.02


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """A flat mesh seen from both sides. patch: what a click on it means, the patch's place; None: not clickable.

    wall: the wall of the stage that it is part of, hidden with it; None: of none.
    """

    path: str
    vertices: Float32Array
    faces: NDArray[np.uint32]
    rgb: Rgb
    opacity: float
    patch: int | None = None
    wall: int | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """A polyline. xyz: (K, 3).   width_px: on the screen."""

    path: str
    xyz: Float32Array
    rgb: Rgb
    width_px: float = 1.5


@dataclass(frozen=True, eq=False, slots=True)
class Edges:
    """Separate lines. ends: (E, 2, 3).   width_px: on the screen.   wall: as of a sheet."""

    path: str
    ends: Float32Array
    rgb: Rgb
    width_px: float = 1.5
    wall: int | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Floor:
    """A grid of metres on the ground. R_scene_grid: (3, 3), its third column up.   size_m: how far it goes, both ways."""

    path: str
    R_scene_grid: FloatArray
    p_scene_grid: FloatArray
    size_m: tuple[float, float]


@dataclass(frozen=True, eq=False, slots=True)
class Axes:
    """A frame's three axes. R_scene_frame: (3, 3).   p_scene_frame: (3,)."""

    path: str
    R_scene_frame: FloatArray
    p_scene_frame: FloatArray
    length_m: float


@dataclass(frozen=True, eq=False, slots=True)
class Label:
    """A word at a place. wall: as of a sheet."""

    path: str
    text: str
    position: FloatArray
    wall: int | None = None


#: Aims of cameras. The first scans are a part of the room, and what is inspected moves through it: each is looked at for
#: itself.
FIRST_SCANS, WHOLE_ROOM, ONE_PLACE = "first scans", "room", "one"

#: Points are drawn no smaller and no larger than this.
SMALLEST_POINT_M, LARGEST_POINT_M = 0.008, 0.035
#: How far apart points lie is asked of so many, among so many, by so many neighbours: a few milliseconds.
SPACING_ASKED, SPACING_KNOWN, SPACING_NEIGHBOURS = 300, 20_000, 8

Item = Cloud | Sheet | Line | Edges | Floor | Axes | Label


@dataclass(frozen=True, eq=False)
class Content:
    """A whole scene and what is said about it beside the canvas.

    legend: what the colours mean, with units.   note: why it is empty or other than asked.
    pickable_m: (N, 3) source points a click in the canvas may mean, map frame; empty where clicks mean nothing.
    aim: cameras look at the whole anew when this changes; "" leaves them where they are.
    stage: the room around it, which says what is up, and what is cut away.   preset: from where cameras look; they
    go there again when `looks` changes.   glass: of what is cut away, sheets, outlines and names stay, to be clicked.
    readout: what is said of a point under the pointer; None: nothing.
    """

    items: tuple[Item, ...]
    legend: str
    note: str = ""
    aim: str = ""
    stage: Stage = field(default_factory=Stage)
    preset: Preset = "overview"
    looks: int = 0
    glass: bool = False
    readout: Readout | None = None
    pickable_m: Float32Array = field(default_factory=lambda: np.zeros((0, 3), dtype=np.float32))

    @property
    def points_shown(self) -> int:
        """Points sent to the browser."""
        return sum(len(item.xyz) for item in self.items if isinstance(item, Cloud))


def breadth_m(clouds: Sequence[Float32Array]) -> float:
    """Diagonal of all clouds (N, 3) together, strays left out."""
    joined = np.concatenate([np.zeros((0, 3), dtype=np.float32), *clouds])
    if len(joined) == 0:
        return 1.0
    low, high = np.percentile(joined, [2, 98], axis=0)
    return max(1.0, float(np.linalg.norm(high - low)))


def frame_names(
    p_lidar: FloatArray, p_imu: FloatArray, breadth: float, *, up: FloatArray | None = None
) -> tuple[Label, Label]:
    """The sensors' names, the lidar's above and the IMU's below, as far apart as words need in a scene that broad."""
    away = 0.045 * breadth * (np.array([0.0, 0.0, 1.0]) if up is None else up)
    return Label("/names/lidar", "lidar", p_lidar + away), Label("/names/imu", "IMU", p_imu - away)


def point_size_m(xyz: Float32Array) -> float:
    """How large points (N, 3) are drawn so that surfaces close without hiding what is thin: by how far apart they lie.

    Measured from some points to their neighbours: k of them within r of each lie 1 / sqrt(k / (pi r^2)) apart.
    """
    from scipy.spatial import cKDTree

    if len(xyz) < 2 * SPACING_NEIGHBOURS:
        return LARGEST_POINT_M
    known = xyz[:: max(1, len(xyz) // SPACING_KNOWN)]
    asked = known[:: max(1, len(known) // SPACING_ASKED)]
    away_m, _ = cKDTree(known).query(asked, k=SPACING_NEIGHBOURS + 1)
    apart_m = float(np.median(away_m[:, -1])) * np.sqrt(np.pi / SPACING_NEIGHBOURS) * np.sqrt(len(known) / len(xyz))
    return float(np.clip(0.8 * apart_m, SMALLEST_POINT_M, LARGEST_POINT_M))


def fingerprint(item: Item) -> int:
    """A number that differs where items differ, so that what stays is not sent again."""
    match item:
        case Cloud(xyz=xyz, rgb=rgb, size_m=size_m):
            return zlib.crc32(rgb.tobytes(), zlib.crc32(np.ascontiguousarray(xyz).tobytes(), hash(size_m) & 0xFFFF))
        case Sheet(vertices=vertices, faces=faces, rgb=rgb, opacity=opacity, patch=patch):
            return hash((vertices.tobytes(), faces.tobytes(), rgb, opacity, patch))
        case Line(xyz=xyz, rgb=rgb, width_px=width_px):
            return hash((xyz.tobytes(), rgb, width_px))
        case Edges(ends=ends, rgb=rgb, width_px=width_px):
            return hash((ends.tobytes(), rgb, width_px))
        case Floor(R_scene_grid=rotation, p_scene_grid=position, size_m=size_m):
            return hash((rotation.tobytes(), position.tobytes(), size_m))
        case Axes(R_scene_frame=rotation, p_scene_frame=position, length_m=length_m):
            return hash((rotation.tobytes(), position.tobytes(), length_m))
        case Label(text=text, position=position):
            return hash((text, position.tobytes()))
