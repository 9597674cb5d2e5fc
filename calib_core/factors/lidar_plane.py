"""All points at the price of a few: the lidar factors of one time slice and plane collapse into a 5x5 scatter matrix.

Residual. A lidar measures range along a known ray, so the maximum-likelihood distance of a point x to its plane is its
range error e = d / c, with d = n . x + w and c = n . ray, whose gradient is that of d / c at the place x - e ray where
the ray meets the plane, not at the noisy x: taken at x, the rotation is pulled by the variance of the range itself. So

    d(new pose) = d + n' . (R' x_hit + p') + w',       x_hit = x - e ray,       weight 1 / (range_std^2 c^2 + ...)

where the second term vanishes at the pose of association. With a = [n_lidar, w_lidar, 1], the plane seen from the lidar at
the slice's centre, and y = [x_hit, 1, d], the residual is a . y: affine in the plane as seen by one pose, hence

    sum of weighted squares = a' M a,       M = sum weight y y'       (5 x 5, over the slice's points on the plane)

exactly, for any number of points. Moving the slice rigidly to another instant is M -> A M A' with A = diag(T, 1).
Points reach their slice's centre with the rates of the motion estimate; slices are short (2 ms), so what a later
estimate would change in that is far below any uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.factors.blocks import SeenPlanes, Weighing
from calib_core.factors.cell_kernels import Grids, cells_kernel, near_kernel, within_kernel
from calib_core.factors.kernels import (
    collapse_kernel,
    faces_kernel,
    hits_kernel,
    move_and_sum_kernel,
    seen_from_kernel,
    select_kernel,
    sieve_kernel,
)
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.geometry import plane_axes
from calib_core.paged import heed_pages, paged
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray

SLICE_S = 0.002
#: A gate's extra width in standard deviations of what it makes room for.
GATE_STDS = 4.0
#: How far apart two points of a cell of edge 1 may be.
DIAGONAL = 3.0**0.5
#: Scatter matrices that are moved at a time: some megabytes of them.
_AT_ONCE = 65536


@dataclass(frozen=True, slots=True)
class LidarNoise:
    """Standard deviation of a point-to-plane distance: range_std_m along the ray, surface_std_m across the plane.

    std^2 = range_std_m^2 c^2 + surface_std_m^2, c the cosine between ray and normal.   farthest_m: the longest range that
    was recorded. Of the returns from just beyond it those that read long are missing, so what is left there lies.   nearest_m:
    the shortest, where those that read short are missing; 0 where nothing is known to cut them off.   sieve_m: edge of the
    cells of which somebody left one point each, 0 for none. Near their faces what is there lies as well.
    """

    range_std_m: float
    surface_std_m: float
    farthest_m: float = float("inf")
    sieve_m: float = 0.0
    nearest_m: float = 0.0

    def distance_std_m(self, cosine: FloatArray) -> FloatArray:
        """Of points seen under the given cosines."""
        return np.sqrt((self.range_std_m * cosine) ** 2 + self.surface_std_m**2)


@dataclass(frozen=True, slots=True)
class Gate:
    """Which points count. sigmas: of the distance noise; extra_m: added for the uncertainty of the poses.

    margin_m: points whose ray meets another plane so near its hit are ambiguous.   robust_sigmas: scale of the
    redescending weight.   min_cosine: of the incidence at which a ray meets a plane at all, and least_cosine: at which that
    counts. At 78 deg a beam's spot is five times as deep as wide, and what a range is off by beyond follows no law that all
    lidars share (up to 20 cm: Laconte et al., arXiv 1810.01619).   extra_of_plane_m: (P,) instead of extra_m; below zero a
    plane takes no points.
    """

    sigmas: float = 4.0
    extra_m: float = 0.0
    margin_m: float = 0.08
    robust_sigmas: float = 8.0
    min_cosine: float = 0.1
    least_cosine: float = 0.2
    extra_of_plane_m: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class SlicePoses:
    """The lidar at the centres of slices, of one scan or of several in a row.

    R: (S, 3, 3), p: (S, 3) map <- lidar; omega (S, 3), v (S, 3) lidar axes.   usable: (S,) False where the motion is not known.
    """

    R: FloatArray
    p: FloatArray
    omega_rad_s: FloatArray
    v_m_s: FloatArray
    usable: BoolArray

    @staticmethod
    def joined(parts: Sequence[SlicePoses]) -> SlicePoses:
        """Those of several scans in a row."""
        if len(parts) == 1:
            return parts[0]
        return SlicePoses(
            np.concatenate([part.R for part in parts]),
            np.concatenate([part.p for part in parts]),
            np.concatenate([part.omega_rad_s for part in parts]),
            np.concatenate([part.v_m_s for part in parts]),
            np.concatenate([part.usable for part in parts]),
        )

    def seen_from(self, others: SlicePoses, which: IntArray) -> tuple[FloatArray, FloatArray]:
        """Each as one of the others sees it, which (S,): R (S, 3, 3), p (S, 3)."""
        R, p = np.empty((len(which), 3, 3)), np.empty((len(which), 3))
        seen_from_kernel(self.R, self.p, others.R, others.p, which, R, p)
        return R, p


@dataclass(frozen=True, slots=True)
class Hits:
    """Where the points of a scan, or of several, meet the planes (N points, P planes).

    plane: (N,), -1 where none is seen face on.   x_hit: (N, 3) lidar frame at the slice's centre.   d [m], cosine: (N,).
    ambiguous_m: (N,) distance along the ray from the hit to the nearest other plane (`hits_kernel`).   slice_index: (N,).
    published_m: (N, 3) the points themselves, lidar frame at their own times.
    """

    plane: IntArray
    slice_index: IntArray
    x_hit: FloatArray
    d: FloatArray
    cosine: FloatArray
    ambiguous_m: FloatArray
    published_m: Float32Array
    poses: SlicePoses


@dataclass(frozen=True)
class MicroBins:
    """Scatter matrices by slice and plane. slice_index, plane: (B,). scatter: (B, 15) upper triangle. count: (B,)."""

    slice_index: IntArray
    plane: IntArray
    scatter: FloatArray
    count: IntArray

    def together(self, R: FloatArray, p: FloatArray, group: IntArray, middle: IntArray) -> MicroBins:
        """Slices of one group as one, with the hits moved to where the lidar is at the slice in its middle.

        R (S, 3, 3), p (S, 3): of each slice, to its group's middle.   group: (S,).   middle: (G,) slices.
        """
        planes = int(self.plane.max(initial=0)) + 1
        key = group[self.slice_index] * planes + self.plane
        keys, scatter = move_and_sum(self.scatter, R, p, self.slice_index, key)
        count = np.bincount(np.searchsorted(keys, key), self.count, len(keys)).astype(np.int64)
        return MicroBins(middle[keys // planes], keys % planes, scatter[:, *np.triu_indices(5)], count)


def find_hits(
    points_m: Float32Array,
    offset_s: FloatArray,
    poses: SlicePoses,
    normals: FloatArray,
    offsets_m: FloatArray,
    gate: Gate,
    *,
    first_slice: IntArray | None = None,
    field_of_view_deg: float | None = None,
    published_m: Float32Array | None = None,
) -> Hits:
    """The plane each ray most plausibly ended on, and where the ray meets it.

    points_m: (N, 3) lidar frame at each point's time.   offset_s: (N,) after the scan's first point, any order.   normals
    (P, 3), offsets_m (P,): map frame, normals towards where the plane was seen from.   first_slice: (N,) of each point's
    scan in the poses, where they are of several.   field_of_view_deg: keep azimuths within +-.   published_m: (N, 3) as they
    came, where points_m are corrected.
    """
    n = len(points_m)
    seen = seen_planes(poses, normals, offsets_m, gate, field_of_view_deg)
    plane, index = np.empty(n, np.int64), np.empty(n, np.int64)
    x_hit = np.zeros((n, 3))
    d, cosine, beside = np.zeros(n), np.zeros(n), np.zeros(n)
    first = np.zeros(n, np.int64) if first_slice is None else first_slice
    # A copy in order: the loop was compiled for a field of records and for an array of its own, to be written to or not.
    in_order = np.array(points_m, order="C")
    hits_kernel(in_order, offset_s, first, seen, plane, index, x_hit, d, cosine, beside)
    return Hits(plane, index, x_hit, d, cosine, beside, points_m if published_m is None else published_m, poses)


def seen_planes(
    poses: SlicePoses, normals: FloatArray, offsets_m: FloatArray, gate: Gate, field_of_view_deg: float | None
) -> SeenPlanes:
    """The planes (P, 3), (P,) of the map frame from the lidar's poses."""
    azimuth = -2.0 if field_of_view_deg is None else float(np.cos(np.radians(field_of_view_deg)))
    n_lidar, w_lidar = normals @ poses.R, poses.p @ normals.T + offsets_m
    return SeenPlanes(SLICE_S, n_lidar, w_lidar, poses.omega_rad_s, poses.v_m_s, poses.usable, gate.min_cosine, azimuth)


def cells_of(hits: Hits, extents_normals: FloatArray) -> IntArray:
    """Row and column of every hit in its plane's grid, (N, 2), -1 where there is no plane. extents_normals: (P, 3)."""
    cell = np.empty((len(hits.plane), 2), np.int64)
    cells_kernel(hits.plane, hits.slice_index, hits.x_hit, grids(hits.poses, extents_normals), cell)
    return cell


@dataclass(frozen=True, slots=True)
class NearHits:
    """Hits near their planes: plane (M,), cell (M, 2), whether on it (M,), and how far off, in units of what is too far (M,)."""

    plane: IntArray
    cell: IntArray
    on_plane: BoolArray
    off: FloatArray


def near_hits(
    hits: Hits,
    normals: FloatArray,
    noise: LidarNoise,
    *,
    near_m: float,
    on: tuple[float, float],
    off: tuple[float, float],
) -> NearHits:
    """Those within near_m of their planes. on, off: so many standard deviations and so much more, as near_kernel has them."""
    n = len(hits.plane)
    plane, cell, on_plane, away = np.empty(n, np.int64), np.empty((n, 2), np.int64), np.empty(n, np.bool_), np.empty(n)
    count = near_kernel(
        hits.plane, hits.slice_index, hits.x_hit, hits.d, hits.cosine, grids(hits.poses, normals), near_m,
        (noise.range_std_m, noise.surface_std_m), on, off, plane, cell, on_plane, away,
    )  # fmt: skip
    return NearHits(plane[:count], cell[:count], on_plane[:count], away[:count])


def grids(poses: SlicePoses, normals: FloatArray) -> Grids:
    """The planes' cells from the lidar's poses. normals: (P, 3)."""
    planes, slices = len(normals), len(poses.p)
    axes = plane_axes(normals).reshape(2 * planes, 3)
    u, origin = (axes @ poses.R).reshape(slices, planes, 2, 3), (poses.p @ axes.T).reshape(slices, planes, 2)
    return Grids(u, origin, CELL_M, HALF_CELLS)


def weighing_of(noise: LidarNoise, gate: Gate) -> Weighing:
    """What weights depend on.

    What widens the gate is an error of the motion, and counts as noise: a clutter point at grazing incidence, let in by it,
    would otherwise outweigh a wall. Where a cell's points were averaged, one that two planes pass through holds none of either.
    """
    return Weighing(
        noise.range_std_m,
        noise.surface_std_m,
        gate.sigmas,
        max(gate.margin_m, DIAGONAL * noise.sieve_m),
        gate.robust_sigmas,
        GATE_STDS,
        noise.farthest_m,
        noise.sieve_m,
        gate.least_cosine,
        noise.nearest_m,
    )


def select(hits: Hits, noise: LidarNoise, gate: Gate, extents: PlaneExtents | None) -> tuple[BoolArray, FloatArray]:
    """Which points count and with what weight [1/m^2]: (N,), (N,)."""
    n = len(hits.plane)
    keep, weight = np.empty(n, np.bool_), np.empty(n)
    extra = gate.extra_of_plane_m
    if extra is None:
        extra = np.full(int(hits.plane.max(initial=0)) + 1, gate.extra_m)
    select_kernel(
        hits.plane, hits.x_hit, hits.d, hits.cosine, hits.ambiguous_m, extra, weighing_of(noise, gate), keep, weight
    )
    if extents is not None:
        cells = grids(hits.poses, extents.normals)
        within_kernel(hits.plane, hits.slice_index, hits.x_hit, cells, extents.inside, keep)
    return keep, weight


def as_sieved(
    hits: Hits, noise: LidarNoise, gate: Gate, keep: BoolArray, weight: FloatArray
) -> tuple[Hits, BoolArray, FloatArray]:
    """What `select` kept of a cloud that a grid thinned, as it is to be counted (`kernels.as_sieved`)."""
    if noise.sieve_m <= 0.0:
        return hits, keep, weight
    extra = gate.extra_of_plane_m
    if extra is None:
        extra = np.full(int(hits.plane.max(initial=0)) + 1, gate.extra_m)
    d, keep, weight = hits.d.copy(), keep.copy(), weight.copy()
    sieve_kernel(
        hits.plane, hits.published_m, hits.x_hit, d, hits.cosine, hits.ambiguous_m, extra, weighing_of(noise, gate), keep, weight
    )  # fmt: skip
    return replace(hits, d=d), keep, weight


def cells_across(hits: Hits, sieve_m: float) -> FloatArray:
    """(N, 2) between which distances [m] along the normal, positive where a return reads long, its cell keeps each of its hits'
    errors. sieve_m: edge of the cells; 0 for none, which keep all.
    """
    faces_m = np.full((len(hits.d), 2), [-np.inf, np.inf])
    if sieve_m > 0.0:
        faces_kernel(hits.published_m, sieve_m, faces_m)
    return np.asarray(np.abs(hits.cosine)[:, None] * faces_m + long_across(hits)[:, None])


def long_across(hits: Hits) -> FloatArray:
    """(N,) how far [m] along the normal each return lies from its plane, positive where it reads long."""
    return np.asarray(hits.d * np.sign(hits.cosine))


def collapse(hits: Hits, keep: BoolArray, weight: FloatArray, n_planes: int) -> MicroBins:
    """The kept points' scatter matrices by (slice, plane)."""
    bins = len(hits.poses.p) * n_planes
    scatter, count = np.zeros((bins, 15)), np.zeros(bins, np.int64)
    collapse_kernel(keep, hits.plane, hits.slice_index, hits.x_hit, hits.d, weight, n_planes, scatter, count)
    filled = np.flatnonzero(count)
    return MicroBins(filled // n_planes, filled % n_planes, scatter[filled], count[filled])


def move_and_sum(
    scatter: FloatArray, R: FloatArray, p: FloatArray, pose: IntArray, key: IntArray, rows: IntArray | None = None
) -> tuple[IntArray, FloatArray]:
    """Scatter matrices with their hits moved rigidly, x -> R x + p, and summed over equal keys.

    scatter: (A, 15).   rows: (B,) which of them; None for all, B = A.   R: (S, 3, 3), p: (S, 3).   pose: (B,) which of these.
    key: (B,).   Returns the keys in order (K,) and the sums (K, 5, 5).
    """
    keys, place = distinct(key)
    (total,) = paged((len(keys), 5, 5))
    for first in range(0, len(key), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        part = scatter[some] if rows is None else scatter[rows[some]]
        heed_pages(2 * part.nbytes)
        move_and_sum_kernel(part, R, p, pose[some], place[some], total)
    return keys, total


def distinct(key: IntArray) -> tuple[IntArray, IntArray]:
    """The different ones in order (K,), and which of them each is (B,): quick where they hardly ever fall, as in time's order."""
    order = np.argsort(key, kind="stable")
    ordered = key[order]
    begins = np.append(True, ordered[1:] != ordered[:-1])[: len(key)]
    place = np.empty(len(key), np.int64)
    place[order] = np.cumsum(begins) - 1
    return ordered[begins], place
