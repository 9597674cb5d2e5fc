"""What the lidar looks at: scenes as data, and the exact intersection of rays with them.

Faces are planes, unbounded (the walls of a closed convex room, seen from inside) or bounded by a convex outline.
Bodies are solids (boxes, cylinders, spheres) that may move while the rays fly: furniture, people, the rig's operator.
World frame, metres. Rays: origins (3, N) and unit directions (3, N), one instant each.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib_core.simulate.motion import Vector, Wave
from calib_core.types import BoolArray, FloatArray, IntArray


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
class Hits:
    """What each ray met first. range_m: (N,), inf for nothing.

    cos_incidence: (N,) in 0..1.   surface: (N,) index into the scene's faces, then its bodies; -1 for nothing.
    """

    range_m: FloatArray
    cos_incidence: FloatArray
    surface: NDArray[np.int16]


@dataclass(frozen=True, slots=True)
class Face:
    """A plane through `point_m`. `normal` points to the side that is seen; any length.

    outline_m: corners of a convex polygon in the plane, in order; empty for an unbounded plane.
    """

    name: str
    normal: Vector
    point_m: Vector
    outline_m: tuple[Vector, ...] = ()
    reflectivity: float = 0.5

    @property
    def unit_normal(self) -> FloatArray:
        """(3,)."""
        normal = np.asarray(self.normal, dtype=np.float64)
        unit: FloatArray = normal / np.linalg.norm(normal)
        return unit

    @property
    def offset_m(self) -> float:
        """W in n . x + w = 0."""
        return -float(self.unit_normal @ np.asarray(self.point_m))


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


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything a ray can meet. The faces are the calibration's planes; bodies are clutter."""

    faces: tuple[Face, ...]
    bodies: tuple[Body, ...] = field(default=())

    def cast(self, rays: Rays) -> Hits:
        """What each ray meets first. Works with closeness, 1 / range: 0 is a miss, no infinities on the way."""
        n = rays.t_s.shape[0]
        hits = _Nearest(np.zeros(n), np.zeros(n), np.full(n, -1, dtype=np.int16))
        for index, face in enumerate(self.faces):
            _cast_face(index, face, rays, hits)
        spread_m = max(float(np.linalg.norm(np.ptp(places, axis=1))) for places in (rays.origins_m, rays.lidar_m))
        for index, body in enumerate(self.bodies, start=len(self.faces)):
            _cast_body(index, body, rays, hits, spread_m)
        with np.errstate(divide="ignore"):
            return Hits(1.0 / hits.closeness_1_m, hits.cosine, hits.surface)

    @property
    def reflectivity(self) -> FloatArray:
        """Of faces, then bodies: indexable by `Hits.surface`; one more at the end for no hit (index -1)."""
        return np.array([f.reflectivity for f in self.faces] + [b.reflectivity for b in self.bodies] + [0.0])


@dataclass(frozen=True, slots=True)
class _Nearest:
    """The best so far, updated in place: closeness 1 / range, cosine of incidence, surface; (N,) each."""

    closeness_1_m: FloatArray
    cosine: FloatArray
    surface: NDArray[np.int16]


def _cast_face(index: int, face: Face, rays: Rays, hits: _Nearest) -> None:
    """A ray meets the plane if it starts on the seen side and comes down towards it."""
    normal = face.unit_normal
    facing = -(normal @ rays.directions)
    height = normal @ rays.origins_m + face.offset_m
    if height.min() <= 0.0:
        height[height <= 0.0] = -np.inf
    closeness = facing / height
    nearer = closeness > hits.closeness_1_m
    if face.outline_m:
        nearer &= _inside(face, normal, rays, closeness)
    np.copyto(hits.closeness_1_m, closeness, where=nearer)
    np.copyto(hits.cosine, facing, where=nearer)
    np.copyto(hits.surface, np.int16(index), where=nearer)


def _inside(face: Face, normal: FloatArray, rays: Rays, closeness: FloatArray) -> BoolArray:
    """Which rays meet the plane within the face's outline; true only where closeness is positive.

    A point o + d / c is inside an edge e, k if e . (o + d / c) >= k, which is (e . o - k) c + e . d >= 0 for c > 0.
    """
    corners = np.asarray(face.outline_m, dtype=np.float64)
    middle = corners.mean(axis=0)
    inside = closeness > 0.0
    for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inward = np.cross(normal, following - corner)
        inward *= np.sign(inward @ (middle - corner))
        side = inward @ rays.origins_m - inward @ corner
        side *= closeness
        side += inward @ rays.directions
        inside &= side >= 0.0
    return inside


def _cast_body(index: int, body: Body, rays: Rays, hits: _Nearest, spread_m: float) -> None:
    """Only rays that can pass the bounding sphere, wherever it and the lidar are within the sweep, look closer.

    spread_m: a bound on the distance between any two of the rays' origins, and of the lidar's places.
    """
    ends = rays.subset(np.array([0, rays.t_s.shape[0] - 1]))
    span_s = float(ends.t_s[1] - ends.t_s[0])
    start_m = rays.origins_m[:, 0]
    to_center = np.asarray(body.center_m, dtype=np.float64) - start_m
    radius = body.bounding_radius_m + spread_m
    if body.path is not None:
        to_center = to_center + body.path.displacement(ends)[:, 0]
        radius += body.path.wander_m(span_s, spread_m)
    distance2 = float(to_center @ to_center)
    nearest = np.sqrt(distance2 - radius**2) if distance2 > radius**2 else -np.inf
    chosen = np.flatnonzero(to_center @ rays.directions >= nearest)
    if chosen.size == 0:
        return
    near = rays.subset(chosen)
    origins = near.origins_m - np.asarray(body.center_m, dtype=np.float64)[:, None]
    if body.path is not None:
        origins -= body.path.displacement(near)
    reach, cosine = body.hit(origins, near.directions)
    nearer = 1.0 / reach > hits.closeness_1_m[chosen]
    hit = chosen[nearer]
    hits.closeness_1_m[hit], hits.cosine[hit], hits.surface[hit] = 1.0 / reach[nearer], cosine[nearer], index
