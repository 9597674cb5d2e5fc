"""What the lidar looks at: scenes as data, and the exact intersection of rays with them.

Faces are planes, unbounded (the walls of a closed convex room, seen from inside) or bounded by a convex outline. Bodies
are furniture, people, the rig's operator. World frame, metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib_core.simulate.bodies import Body, Rays
from calib_core.simulate.motion import Vector
from calib_core.simulate.uneven import Bend, Pane
from calib_core.types import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Hits:
    """What each ray met first. range_m: (N,), inf for nothing.

    cos_incidence: (N,) in 0..1.   surface: (N,) index into the scene's faces, then its bodies, then what is behind its
    panes; -1 for nothing.
    """

    range_m: FloatArray
    cos_incidence: FloatArray
    surface: NDArray[np.int16]


@dataclass(frozen=True, slots=True)
class Face:
    """A plane through `point_m`. `normal` points to the side that is seen; any length.

    outline_m: corners of a convex polygon in the plane, in order; empty for an unbounded plane.   bend: off flat.
    """

    name: str
    normal: Vector
    point_m: Vector
    outline_m: tuple[Vector, ...] = ()
    reflectivity: float = 0.5
    bend: Bend | None = None

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
class Scene:
    """Everything a ray can meet. The faces are the calibration's planes; bodies are clutter, panes windows in faces."""

    faces: tuple[Face, ...]
    bodies: tuple[Body, ...] = field(default=())
    panes: tuple[Pane, ...] = field(default=())

    def cast(self, rays: Rays) -> Hits:
        """What each ray meets first. Works with closeness, 1 / range: 0 is a miss, no infinities on the way."""
        n = rays.t_s.shape[0]
        hits = _Nearest(np.zeros(n), np.zeros(n), np.full(n, -1, dtype=np.int16))
        for index, face in enumerate(self.faces):
            _cast_face(index, face, rays, hits)
        spread_m = max(float(np.linalg.norm(np.ptp(places, axis=1))) for places in (rays.origins_m, rays.lidar_m))
        for index, body in enumerate(self.bodies, start=len(self.faces)):
            _cast_body(index, body, rays, hits, spread_m)
        for index, face in enumerate(self.faces):
            if face.bend is not None:
                _bend(index, face, rays, hits)
        for index, pane in enumerate(self.panes, start=len(self.faces) + len(self.bodies)):
            _look_through(index, pane, self.faces[pane.face], rays, hits)
        with np.errstate(divide="ignore"):
            return Hits(1.0 / hits.closeness_1_m, hits.cosine, hits.surface)

    @property
    def reflectivity(self) -> FloatArray:
        """Of faces, bodies, panes: indexable by `Hits.surface`; one more at the end for no hit (index -1)."""
        known = [[f.reflectivity for f in self.faces], [b.reflectivity for b in self.bodies]]
        return np.array([*known[0], *known[1], *(pane.reflectivity for pane in self.panes), 0.0])


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


def _bend(index: int, face: Face, rays: Rays, hits: _Nearest) -> None:
    """The rays that met this face end where it really is."""
    mine = np.flatnonzero(hits.surface == index)
    if mine.size:
        hits.closeness_1_m[mine] = _closeness(face, rays.subset(mine))


def _closeness(face: Face, rays: Rays, behind_m: float = 0.0) -> FloatArray:
    """1 / range (N,) of rays that come down towards this face, to a surface of its shape so far behind it."""
    normal, offset_m = face.unit_normal, face.offset_m + behind_m
    if face.bend is not None:
        return face.bend.closeness(rays, normal, offset_m)
    return np.asarray(-(normal @ rays.directions) / (normal @ rays.origins_m + offset_m))


def _look_through(index: int, pane: Pane, face: Face, rays: Rays, hits: _Nearest) -> None:
    """The rays that met this pane's face within it, slantwise, end behind it: at a place that is where it is for all of them."""
    mine = np.flatnonzero(hits.surface == pane.face)
    if mine.size:
        through = mine[pane.passes(rays.subset(mine), hits.closeness_1_m[mine], hits.cosine[mine])]
        hits.closeness_1_m[through] = _closeness(face, rays.subset(through), pane.depth_m)
        hits.surface[through] = index
