"""Where a ray really ends that met a plane which is no plane: bent walls, and windows in walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.simulate.bodies import Rays
from calib_core.simulate.motion import Vector
from calib_core.types import BoolArray, FloatArray

#: Of the search for the bent surface along a ray: each step divides what is left by 1 / (slope x tangent), 30 and more.
_STEPS = 4


@dataclass(frozen=True, slots=True)
class Bend:
    """How a wall departs from its plane towards whoever sees it: two waves across it, (amplitude [m], length [m], phase).

    along, up: unit axes within the plane.
    """

    along: Vector
    up: Vector
    wave_along: Vector
    wave_up: Vector

    def height_m(self, points_m: FloatArray) -> FloatArray:
        """(N,) at points in the plane or near it, (3, N) world."""
        height: FloatArray = np.zeros(points_m.shape[1])
        for axis, (amplitude, length, phase) in ((self.along, self.wave_along), (self.up, self.wave_up)):
            height += amplitude * np.sin(2.0 * np.pi / length * (np.asarray(axis) @ points_m) + phase)
        return height

    def closeness(self, rays: Rays, normal: FloatArray, offset_m: float) -> FloatArray:
        """1 / range of rays that meet the plane n . x + w = 0, to the bent surface: the fixed point of
        r = (n . o + w - height(o + r d)) / -(n . d)."""
        facing = -(normal @ rays.directions)
        distance = normal @ rays.origins_m + offset_m
        bent = distance
        for _ in range(_STEPS):
            bent = distance - self.height_m(rays.origins_m + rays.directions * (bent / facing))
        return np.asarray(facing / bent)


@dataclass(frozen=True, slots=True)
class Pane:
    """A window in a face: met nearly head-on it answers by itself, else the ray goes on to another such wall `depth_m` behind.

    face: index in the scene.   along, up: unit axes in the plane.   half_m: half its width and height.
    """

    face: int
    center_m: Vector
    along: Vector
    up: Vector
    half_m: tuple[float, float]
    depth_m: float = 2.0
    reflectivity: float = 0.5
    answers_above_cosine: float = 0.995

    def passes(self, rays: Rays, closeness_1_m: FloatArray, cosine: FloatArray) -> BoolArray:
        """(N,) Of rays that meet the face: which pass the glass."""
        hit = rays.origins_m + rays.directions / closeness_1_m - np.asarray(self.center_m)[:, None]
        inside: BoolArray = (np.abs(np.asarray(self.along) @ hit) < self.half_m[0]) & (
            np.abs(np.asarray(self.up) @ hit) < self.half_m[1]
        )
        return inside & (cosine < self.answers_above_cosine)
