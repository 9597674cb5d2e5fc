"""What editing needs of geometry: one plane through several patches' points, which point is whose, determinacy.

All in the map frame; a plane is n . x + w = 0 with a unit normal n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.planes.state import EditedPatch, PlaneSet, Side
from calib_core.types import BoolArray, Float32Array, FloatArray, PlaneProposals

#: Confirmed normals closer than this are one direction: two parallel walls fix one direction of space, not two.
SAME_DIRECTION_COS = np.cos(np.radians(10.0))
#: Smallest eigenvalue below which a direction counts as free: normals within about 18 degrees of one plane.
LEAST_EIGENVALUE = 0.05
#: How thick a slab around a grown plane is: so many of its standard deviations, and never less than this.
SLAB_STDS = 3.0
SLAB_LEAST_M = 0.03
#: A part of an outline below this share of it is a line.
LEAST_LEFT = 1e-3
#: Points this far outside an outline still count: the corners are points themselves, in float32.
EDGE_M = 1e-3
#: A solve counts no point further than that from a plane's own origin, along the plane.
REACH_M = 100.0


@dataclass(frozen=True, slots=True)
class FittedPlane:
    """A least-squares plane and its extent. normal: (3,).   outline_m: (K, 3) convex, in order."""

    normal: FloatArray
    offset_m: float
    rms_m: float
    outline_m: FloatArray
    area_m2: float


def fit_plane(points_m: Float32Array) -> FittedPlane | None:
    """The least-squares plane of points (N, 3); None for fewer than three or points on a line."""
    if len(points_m) < 3:
        return None
    points = points_m.astype(np.float64)
    centroid_m = points.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((points - centroid_m).T, bias=True))
    if values[1] <= 1e-12 * max(values[2], 1e-12):
        return None
    normal: FloatArray = vectors[:, 0]
    offset_m = -float(normal @ centroid_m)
    if offset_m < 0:  # the sensor is on the normal's side, whichever way the eigenvector came out
        normal, offset_m = -normal, -offset_m
    in_plane = (points - centroid_m) @ vectors[:, 1:]
    corners = convex_hull(in_plane)
    x, y = corners[:, 0], corners[:, 1]
    area_m2 = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    outline_m: FloatArray = centroid_m + corners @ vectors[:, 1:].T
    return FittedPlane(normal, offset_m, float(np.sqrt(max(values[0], 0.0))), outline_m, area_m2)


def convex_hull(points: FloatArray) -> FloatArray:
    """(K, 2) corners of the convex hull of points (N, 2), counter-clockwise (Andrew's monotone chain)."""
    order = np.unique(_without_inner(points.round(4)), axis=0)
    if len(order) < 3:
        return order
    chains: list[list[FloatArray]] = []
    for ordered in (order, order[::-1]):
        chain: list[FloatArray] = []
        for point in ordered:
            while len(chain) >= 2 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _without_inner(points: FloatArray) -> FloatArray:
    """The points (N, 2) without those well inside, which are nearly all: the chain below is a plain loop."""
    angles = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    extreme = np.argmax(points @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)
    corners = points[extreme]  # counter-clockwise by their directions, all on the hull
    outside = np.zeros(len(points), dtype=np.bool_)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if np.array_equal(a, b):  # one corner is the farthest in two neighbouring directions
            continue
        outside |= (b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0]) <= 0.0
    left: FloatArray = points[outside]
    return left


def _turn(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def labels(proposals: PlaneProposals, planes: PlaneSet) -> NDArray[np.int16]:
    """(N,) which patch of the set each point of the cloud belongs to, -1 for none. Regions leave out what is outside."""
    owner = np.full(len(proposals.patches) + 1, -1, dtype=np.int16)  # the last entry serves the label -1
    for place, patch in enumerate(planes.patches):
        owner[list(patch.members)] = place
    found: NDArray[np.int16] = owner[proposals.cloud_patch]
    # What a box has taken from a detected patch may belong to one that was grown there: first the detected ones.
    for place, patch in sorted(enumerate(planes.patches), key=lambda one: not one[1].members):
        if not patch.members:
            found[(found == -1) & within_patch(proposals.cloud_m, patch)] = place
        if patch.region:
            mine = np.flatnonzero(found == place)
            found[mine[~within_region(proposals.cloud_m[mine], patch.region)]] = -1
    if planes.region:
        found[~within_region(proposals.cloud_m, planes.region)] = -1
    return found


def within_region(points_m: Float32Array, region: Sequence[Side]) -> BoolArray:
    """(N,) whether points (N, 3) lie on the inner side of every half-space."""
    inside = np.ones(len(points_m), dtype=np.bool_)
    for *normal, offset_m in region:
        inside &= points_m @ np.array(normal) + offset_m >= 0.0
    return inside


def within_patch(points_m: Float32Array, patch: EditedPatch) -> BoolArray:
    """(N,) whether points (N, 3) lie in the patch's slab and inside its convex outline."""
    normal = np.array(patch.normal)
    inside: BoolArray = np.abs(points_m @ normal + patch.offset_m) <= max(SLAB_STDS * patch.rms_m, SLAB_LEAST_M)
    candidates = np.flatnonzero(inside)
    inside[candidates] = within_outline(points_m[candidates], normal, np.array(patch.outline_m).reshape(-1, 3))
    return inside


def within_outline(points_m: Float32Array, normal: FloatArray, corners_m: FloatArray) -> BoolArray:
    """(N,) whether points (N, 3), seen along the normal (3,), lie in a convex outline (K, 3); none where it has no area."""
    if len(corners_m) < 3:
        return np.zeros(len(points_m), dtype=np.bool_)
    centre = corners_m.mean(axis=0)
    inside = np.ones(len(points_m), dtype=np.bool_)
    for a, b in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        outward = np.cross(b - a, normal)
        if outward @ (centre - a) > 0:
            outward = -outward
        inside &= (points_m - a) @ outward <= EDGE_M * np.linalg.norm(outward)
    return inside


def solved_outline(patch: EditedPatch, region: Sequence[Side]) -> FloatArray | None:
    """Corners (K, 3) of the part of a patch's plane that its boxes and the set's leave, map frame; None where all of it.

    region: of the set.   A solve looks no further than REACH_M along the plane, so that the part is always bounded.
    """
    sides = (*region, *patch.region)
    normal = np.array(patch.normal)
    along = np.linalg.svd(normal[None])[2][1:]
    square = REACH_M * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) @ along - patch.offset_m * normal
    corners = square
    for *side, offset_m in sides:
        corners = _cut(corners, corners @ np.array(side) + offset_m)
    if corners is square:
        return None
    # A box may miss the fitted plane where the patch's points scatter about it: then what was seen of it has to do.
    return corners if len(corners) >= 3 else np.array(patch.outline_m).reshape(-1, 3)


def left_of(corners_m: FloatArray, sides: Sequence[Side]) -> FloatArray | None:
    """What half-spaces leave of a convex outline (K, 3); None where that is all of it, no corners where it is next to nothing."""
    left = corners_m
    for *side, offset_m in sides:
        left = _cut(left, left @ np.array(side) + offset_m)
    if left is corners_m:
        return None
    return left if area_m2(left) > LEAST_LEFT * area_m2(corners_m) else np.zeros((0, 3))


def area_m2(corners_m: FloatArray) -> float:
    """Of a convex outline (K, 3); 0 where it is none."""
    arms = corners_m[1:] - corners_m[:1]
    return 0.5 * float(np.linalg.norm(np.cross(arms[:-1], arms[1:]), axis=1).sum()) if len(corners_m) >= 3 else 0.0


def _cut(corners_m: FloatArray, height_m: FloatArray) -> FloatArray:
    """A convex outline (K, 3) cut where the heights (K,) of its corners pass through zero; what is below goes."""
    if (height_m >= 0.0).all():
        return corners_m
    kept: list[FloatArray] = []
    ahead = zip(np.roll(corners_m, -1, axis=0), np.roll(height_m, -1), strict=True)
    for corner, height, (next_corner, next_height) in zip(corners_m, height_m, ahead, strict=True):
        if height >= 0.0:
            kept.append(corner)
        if (height >= 0.0) != (next_height >= 0.0):
            kept.append(corner + (next_corner - corner) * (height / (height - next_height)))
    return np.array(kept).reshape(-1, 3)


def spread_of_directions(normals: FloatArray) -> tuple[float, FloatArray]:
    """Smallest eigenvalue of the mean of n n^T over distinct directions, and the direction it belongs to.

    normals: (K, 3), unit. 1/3 for three orthogonal directions; 0 where the returned direction is free.
    """
    distinct: list[FloatArray] = []
    for normal in normals:
        if all(abs(float(normal @ other)) < SAME_DIRECTION_COS for other in distinct):
            distinct.append(normal)
    if not distinct:
        return 0.0, np.array([0.0, 0.0, 1.0])
    scatter = np.mean([np.outer(normal, normal) for normal in distinct], axis=0)
    values, vectors = np.linalg.eigh(scatter)
    free: FloatArray = vectors[:, 0]
    return max(float(values[0]), 0.0), free
