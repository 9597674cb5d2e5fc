"""What a scene is made of, as data. All coordinates in metres, in the frame the scene is drawn in."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.planes.palette import Colors, Rgb
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
    """A flat mesh seen from both sides. patch: what a click on it means, the patch's place; None: not clickable."""

    path: str
    vertices: Float32Array
    faces: NDArray[np.uint32]
    rgb: Rgb
    opacity: float
    patch: int | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """A polyline. xyz: (K, 3).   width_px: on the screen."""

    path: str
    xyz: Float32Array
    rgb: Rgb
    width_px: float = 1.5


@dataclass(frozen=True, eq=False, slots=True)
class Axes:
    """A frame's three axes. R_scene_frame: (3, 3).   p_scene_frame: (3,)."""

    path: str
    R_scene_frame: FloatArray
    p_scene_frame: FloatArray
    length_m: float


@dataclass(frozen=True, eq=False, slots=True)
class Label:
    """A word at a place."""

    path: str
    text: str
    position: FloatArray


#: Aims of cameras. The first scans are a part of the room, and what is inspected moves through it: each is looked at for
#: itself.
FIRST_SCANS, WHOLE_ROOM, ONE_PLACE = "first scans", "room", "one"

Item = Cloud | Sheet | Line | Axes | Label


@dataclass(frozen=True, eq=False)
class Content:
    """A whole scene and what is said about it beside the canvas.

    legend: what the colours mean, with units.   note: why it is empty or other than asked.
    pickable_m: (N, 3) source points a click in the canvas may mean, map frame; empty where clicks mean nothing.
    aim: cameras look at the whole anew when this changes; "" leaves them where they are.
    """

    items: tuple[Item, ...]
    legend: str
    note: str = ""
    aim: str = ""
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


def frame_names(p_lidar: FloatArray, p_imu: FloatArray, breadth: float) -> tuple[Label, Label]:
    """The sensors' names, the lidar's above and the IMU's below, as far apart as words need in a scene that broad."""
    up = np.array([0.0, 0.0, 0.045 * breadth])
    return Label("/names/lidar", "lidar", p_lidar + up), Label("/names/imu", "IMU", p_imu - up)


def point_size_m(xyz: Float32Array) -> float:
    """How large points (N, 3) are drawn so that surfaces close without hiding what is thin."""
    if len(xyz) < 2:
        return 0.02
    low, high = np.percentile(xyz, [2, 98], axis=0)
    return float(np.clip(0.26 * np.linalg.norm(high - low) / np.sqrt(len(xyz)), 0.015, 0.04))


def fingerprint(item: Item) -> int:
    """A number that differs where items differ, so that what stays is not sent again."""
    match item:
        case Cloud(xyz=xyz, rgb=rgb, size_m=size_m):
            return zlib.crc32(rgb.tobytes(), zlib.crc32(np.ascontiguousarray(xyz).tobytes(), hash(size_m) & 0xFFFF))
        case Sheet(vertices=vertices, faces=faces, rgb=rgb, opacity=opacity, patch=patch):
            return hash((vertices.tobytes(), faces.tobytes(), rgb, opacity, patch))
        case Line(xyz=xyz, rgb=rgb, width_px=width_px):
            return hash((xyz.tobytes(), rgb, width_px))
        case Axes(R_scene_frame=rotation, p_scene_frame=position, length_m=length_m):
            return hash((rotation.tobytes(), position.tobytes(), length_m))
        case Label(text=text, position=position):
            return hash((text, position.tobytes()))
