"""Surfaces that rays meet: rectangles and upright cylinders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib_core.types import FloatArray, IntArray

#: Nearer is the sensor's own housing.
_NEAREST_M = 0.05


@dataclass(frozen=True)
class Rectangle:
    """centre_m: (3,).   u_m, v_m: (3,), from the centre to the middle of two edges."""

    centre_m: FloatArray
    u_m: FloatArray
    v_m: FloatArray

    @property
    def normal(self) -> FloatArray:
        """(3,), of unit length."""
        across = np.cross(self.u_m, self.v_m)
        return np.asarray(across / np.linalg.norm(across))


@dataclass(frozen=True)
class Cylinder:
    """Upright. centre_m: (3,).   Without lids."""

    centre_m: FloatArray
    radius_m: float
    height_m: float


Shape = Rectangle | Cylinder


class Hits(NamedTuple):
    """Where rays end. range_m: (N,), infinite where nowhere.   shape: (N,), -1 there.   cosine: (N,) of the incidence."""

    range_m: FloatArray
    shape: IntArray
    cosine: FloatArray


def rectangle(centre_m: Sequence[float], u_m: Sequence[float], v_m: Sequence[float]) -> Rectangle:
    """From plain numbers."""
    return Rectangle(np.array(centre_m, float), np.array(u_m, float), np.array(v_m, float))


def cylinder(x_m: float, y_m: float, radius_m: float, height_m: float) -> Cylinder:
    """One that stands on the ground."""
    return Cylinder(np.array([x_m, y_m, 0.5 * height_m]), radius_m, height_m)


def box(centre_m: Sequence[float], size_m: Sequence[float], yaw_rad: float = 0.0) -> list[Shape]:
    """Its six faces."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) * (0.5 * np.array(size_m))[:, None]
    centre = np.array(centre_m, float)
    return [
        Rectangle(centre + sign * axes[k], axes[(k + 1) % 3], axes[(k + 2) % 3]) for k in range(3) for sign in (-1, 1)
    ]


def cast(shapes: Sequence[Shape], origins_m: FloatArray, directions: FloatArray) -> Hits:
    """Where rays first end. origins_m, directions: (N, 3), of unit length."""
    n = len(origins_m)
    hits = Hits(np.full(n, np.inf), np.full(n, -1), np.zeros(n))
    for index, shape in enumerate(shapes):
        if isinstance(shape, Rectangle):
            _meet_rectangle(shape, index, origins_m, directions, hits)
        else:
            _meet_cylinder(shape, index, origins_m, directions, hits)
    return hits


def _meet_rectangle(shape: Rectangle, index: int, origins_m: FloatArray, directions: FloatArray, hits: Hits) -> None:
    normal = shape.normal
    towards = directions @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = ((shape.centre_m - origins_m) @ normal) / towards
    near = np.flatnonzero((range_m > _NEAREST_M) & (range_m < hits.range_m))
    place = origins_m[near] + range_m[near, None] * directions[near] - shape.centre_m
    inside = np.all([np.abs(place @ edge) <= edge @ edge for edge in (shape.u_m, shape.v_m)], axis=0)
    met = near[inside]
    hits.range_m[met], hits.shape[met], hits.cosine[met] = range_m[met], index, np.abs(towards[met])


def _meet_cylinder(shape: Cylinder, index: int, origins_m: FloatArray, directions: FloatArray, hits: Hits) -> None:
    from_axis, across = origins_m[:, :2] - shape.centre_m[:2], directions[:, :2]
    a, b = np.sum(across**2, axis=1), np.sum(from_axis * across, axis=1)
    discriminant = b**2 - a * (np.sum(from_axis**2, axis=1) - shape.radius_m**2)
    for side in (-1.0, 1.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            range_m = (side * np.sqrt(discriminant) - b) / a
        height_m = origins_m[:, 2] + range_m * directions[:, 2] - shape.centre_m[2]
        met = np.flatnonzero(
            (range_m > _NEAREST_M) & (range_m < hits.range_m) & (np.abs(height_m) <= 0.5 * shape.height_m)
        )
        outward = (from_axis[met] + range_m[met, None] * across[met]) / shape.radius_m
        hits.range_m[met], hits.shape[met] = range_m[met], index
        hits.cosine[met] = np.abs(np.sum(outward * across[met], axis=1))
