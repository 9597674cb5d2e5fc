"""Solids that rays can meet: boxes, upright cylinders and balls, still or moving while the rays fly.

World frame, metres. Rays: origins (3, N) and unit directions (3, N), one instant each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.simulate.motion import Vector, Wave
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Rays:
    """Rays with the instants they are fired at.

    origins_m, directions: (3, N), world.   t_s: (N,).   lidar_m: (3, N), where the lidar is.   home_m: (3,), at t = 0.
    """

    origins_m: FloatArray
    directions: FloatArray
    t_s: FloatArray
    lidar_m: FloatArray
    home_m: FloatArray

    def subset(self, chosen: IntArray) -> Rays:
        """The rays at these indices."""
        lidar_m = self.lidar_m[:, chosen]
        origins_m = lidar_m if self.origins_m is self.lidar_m else self.origins_m[:, chosen]
        return Rays(origins_m, self.directions[:, chosen], self.t_s[chosen], lidar_m, self.home_m)


@dataclass(frozen=True, slots=True)
class Path:
    """How a body moves: waves along world axes, plus a share of the lidar's own displacement (whoever carries it)."""

    waves: tuple[tuple[Wave, ...], tuple[Wave, ...], tuple[Wave, ...]] = ((), (), ())
    carried: float = 0.0

    def displacement(self, rays: Rays) -> FloatArray:
        """(3, N) [m]."""
        moved: FloatArray = self.carried * (rays.lidar_m - rays.home_m[:, None])
        for axis, waves in enumerate(self.waves):
            for wave in waves:
                moved[axis] += wave.amplitude * np.sin(2.0 * np.pi * wave.frequency_hz * rays.t_s + wave.phase_rad)
        return moved

    def wander_m(self, span_s: float, lidar_spread_m: float) -> float:
        """A bound on how far displacements differ within `span_s` in which the lidar moved by `lidar_spread_m`."""
        speed = sum(2.0 * np.pi * wave.frequency_hz * abs(wave.amplitude) for waves in self.waves for wave in waves)
        return float(speed * span_s + abs(self.carried) * lidar_spread_m)


class Body(Protocol):
    """A solid in the scene."""

    @property
    def name(self) -> str: ...
    @property
    def center_m(self) -> Vector: ...
    @property
    def reflectivity(self) -> float: ...
    @property
    def path(self) -> Path | None: ...
    @property
    def bounding_radius_m(self) -> float: ...

    def hit(self, origins_m: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Range (inf for a miss) and cosine of incidence, each (N,), of rays relative to the body's centre, (3, N)."""


@dataclass(frozen=True, slots=True)
class Box:
    """A box of full size `size_m`, turned by `rotvec_deg`, about its centre."""

    name: str
    center_m: Vector
    size_m: Vector
    rotvec_deg: Vector = (0.0, 0.0, 0.0)
    reflectivity: float = 0.4
    path: Path | None = None

    @property
    def bounding_radius_m(self) -> float:
        """Of a sphere about the centre that holds the box."""
        return float(np.linalg.norm(self.size_m)) / 2.0

    def hit(self, origins_m: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Slab by slab in the box's own axes; a ray that starts inside meets nothing."""
        R = Rotation.from_rotvec(self.rotvec_deg, degrees=True).as_matrix()
        o, d = R.T @ origins_m, R.T @ directions
        half = np.asarray(self.size_m)[:, None] / 2.0
        with np.errstate(divide="ignore", invalid="ignore"):
            near, far = (-half - o) / d, (half - o) / d
        near, far = np.minimum(near, far), np.maximum(near, far)
        axis = np.argmax(near, axis=0)
        entry = near.max(axis=0)
        met = (entry < far.min(axis=0)) & (entry > 0.0)
        return np.where(met, entry, np.inf), np.abs(np.take_along_axis(d, axis[None], axis=0)[0])


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder about its centre."""

    name: str
    center_m: Vector
    radius_m: float
    height_m: float
    reflectivity: float = 0.4
    path: Path | None = None

    @property
    def bounding_radius_m(self) -> float:
        """Of a sphere about the centre that holds the cylinder."""
        return float(np.hypot(self.radius_m, self.height_m / 2.0))

    def hit(self, origins_m: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mantle first, then the two lids."""
        ox, oy, oz = origins_m
        dx, dy, dz = directions
        a, b, c = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - self.radius_m**2
        with np.errstate(divide="ignore", invalid="ignore"):
            mantle = (-b - np.sqrt(b * b - a * c)) / a
            on_mantle = (mantle > 0.0) & (np.abs(oz + mantle * dz) <= self.height_m / 2.0)
            lid = (-np.sign(dz) * self.height_m / 2.0 - oz) / dz
            on_lid = (lid > 0.0) & (np.hypot(ox + lid * dx, oy + lid * dy) <= self.radius_m)
        mantle_m = np.where(on_mantle, mantle, np.inf)
        lid_m = np.where(on_lid, lid, np.inf)
        reach = np.where(on_mantle, mantle, 0.0)
        cos_mantle = np.abs((ox + reach * dx) * dx + (oy + reach * dy) * dy) / self.radius_m
        return np.minimum(mantle_m, lid_m), np.where(lid_m < mantle_m, np.abs(dz), cos_mantle)


@dataclass(frozen=True, slots=True)
class Sphere:
    """A ball."""

    name: str
    center_m: Vector
    radius_m: float
    reflectivity: float = 0.4
    path: Path | None = None

    @property
    def bounding_radius_m(self) -> float:
        """Its own radius."""
        return self.radius_m

    def hit(self, origins_m: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearer root of |o + r d| = radius."""
        b = np.einsum("in,in->n", origins_m, directions)
        c = np.einsum("in,in->n", origins_m, origins_m) - self.radius_m**2
        root = b * b - c
        met = (root > 0.0) & (-b > np.sqrt(np.maximum(root, 0.0)))
        half_chord = np.sqrt(np.maximum(root, 0.0))
        return np.where(met, -b - half_chord, np.inf), half_chord / self.radius_m
