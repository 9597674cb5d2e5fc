"""What is under the pointer: which point, on which plane, by which laser, how far away. Pure; knows no browser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.scene.aim import hidden, wall_of
from app.scene.camera import Camera, Place
from app.scene.picking import pick_place
from calib_core.types import Float32Array, FloatArray

#: A plane leans so much less than half of a right angle that it is one to stand on.
STEEP_DEG = 45.0


@dataclass(frozen=True, eq=False)
class Readout:
    """Points that can be read. points_m: (N, 3) as drawn, scene frame.   says: of a point's place, in one short sentence."""

    points_m: Float32Array
    says: Callable[[int], str]


def read_out(readout: Readout, walls: FloatArray, camera: Camera, place: Place) -> str:
    """What is said of the point seen at `place`; "" where there is none. walls: (K, 4), cut away."""
    (ray,) = camera.rays([place])
    cut = np.append(hidden(walls, camera.p_scene_camera), False)

    def drawn(points_m: Float32Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        return ~cut[wall_of(points_m, walls)]

    found = pick_place(readout.points_m, camera.p_scene_camera, ray, drawn)
    return "" if found is None else readout.says(found)


def lean(normal: FloatArray, up: FloatArray) -> str:
    """How a plane stands: what a spirit level would say of a floor, and a plumb line of a wall."""
    tilt_deg = float(np.degrees(np.arccos(np.clip(abs(normal @ up) / np.linalg.norm(normal), 0.0, 1.0))))
    return f"{tilt_deg:.1f}° off level" if tilt_deg < STEEP_DEG else f"{90.0 - tilt_deg:.1f}° off plumb"


def from_plane(name: str, dist_m: float) -> str:
    """On which side of a plane, and how far off."""
    return f"{1e3 * dist_m:+.0f} mm from {name}".replace("-", "\N{MINUS SIGN}").replace("+0 mm", "0 mm")
