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

from dataclasses import dataclass

import numpy as np

from calib_core.planes.extent import PlaneExtents
from calib_core.types import BoolArray, FloatArray, IntArray

SLICE_S = 0.002
_UPPER = np.triu_indices(5)


@dataclass(frozen=True, slots=True)
class LidarNoise:
    """Standard deviation of a point-to-plane distance: range_std_m along the ray, surface_std_m across the plane.

    std^2 = range_std_m^2 c^2 + surface_std_m^2, c the cosine between ray and normal.
    """

    range_std_m: float
    surface_std_m: float

    def distance_std_m(self, cosine: FloatArray) -> FloatArray:
        """Of points seen under the given cosines."""
        return np.sqrt((self.range_std_m * cosine) ** 2 + self.surface_std_m**2)


@dataclass(frozen=True, slots=True)
class Gate:
    """Which points count. sigmas: of the distance noise; extra_m: added for the uncertainty of the poses.

    margin_m: points whose hit is this near another plane are ambiguous.   robust_sigmas: scale of the redescending weight.
    """

    sigmas: float = 4.0
    extra_m: float = 0.0
    margin_m: float = 0.08
    robust_sigmas: float = 8.0
    min_cosine: float = 0.05


@dataclass(frozen=True, slots=True)
class SlicePoses:
    """The lidar at the centres of one scan's slices. R: (S, 3, 3), p: (S, 3) map <- lidar; omega (S, 3), v (S, 3) lidar axes.

    usable: (S,) False where the motion is not known.
    """

    R: FloatArray
    p: FloatArray
    omega_rad_s: FloatArray
    v_m_s: FloatArray
    usable: BoolArray


@dataclass(frozen=True, slots=True)
class Hits:
    """Where a scan's points meet the planes (N points, P planes). `plane` is -1 where no plane is seen face on.

    x_hit, ray: (N, 3) lidar frame at the slice's centre.   hit_map: (N, 3).   d, cosine, range_error: (N,).
    ambiguous_m: (N,) distance of the hit to the nearest other plane.
    """

    plane: IntArray
    x_hit: FloatArray
    hit_map: FloatArray
    d: FloatArray
    cosine: FloatArray
    ambiguous_m: FloatArray


@dataclass(frozen=True)
class MicroBins:
    """Scatter matrices by slice and plane. slice_index, plane: (B,). scatter: (B, 15) upper triangle. count: (B,)."""

    slice_index: IntArray
    plane: IntArray
    scatter: FloatArray
    count: IntArray


def slice_indices(offset_s: FloatArray) -> IntArray:
    """The slice of each point of a scan, from its time after the scan's first point. (N,)."""
    return np.maximum(offset_s / SLICE_S, 0.0).astype(np.int64)


def find_hits(
    points_m: FloatArray, offset_s: FloatArray, poses: SlicePoses, normals: FloatArray, offsets_m: FloatArray, gate: Gate
) -> Hits:
    """The plane each ray most plausibly ended on, and where the ray meets it.

    points_m: (N, 3) lidar frame at each point's time.   offset_s: (N,).   normals (P, 3), offsets_m (P,): map frame,
    normals towards where the plane was seen from.
    """
    index = slice_indices(offset_s)
    tau = (offset_s - (index + 0.5) * SLICE_S)[:, None]
    turned = points_m + tau * np.cross(poses.omega_rad_s[index], points_m)
    centred = turned + tau * poses.v_m_s[index]
    ray = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    R = poses.R[index]
    x_map = (R @ centred[:, :, None])[:, :, 0] + poses.p[index]
    ray_map = (R @ ray[:, :, None])[:, :, 0]
    D = x_map @ normals.T + offsets_m
    C = ray_map @ normals.T
    facing = -gate.min_cosine > C
    error = np.where(facing, D / np.where(facing, C, 1.0), np.inf)
    rows = np.arange(len(points_m))
    plane = np.argmin(np.abs(error), axis=1)
    e = error[rows, plane]
    seen = np.isfinite(e) & poses.usable[index]
    e = np.where(seen, e, 0.0)
    beside = np.abs(D - e[:, None] * C)
    beside[rows, plane] = np.inf
    return Hits(
        plane=np.where(seen, plane, -1),
        x_hit=centred - e[:, None] * ray,
        hit_map=x_map - e[:, None] * ray_map,
        d=D[rows, plane],
        cosine=C[rows, plane],
        ambiguous_m=beside.min(axis=1, initial=np.inf),
    )


def select(hits: Hits, noise: LidarNoise, gate: Gate, extents: PlaneExtents | None) -> tuple[BoolArray, FloatArray]:
    """Which points count and with what weight [1/m^2]: (N,), (N,)."""
    std = noise.distance_std_m(hits.cosine)
    keep = (hits.plane >= 0) & (np.abs(hits.d) < gate.sigmas * std + gate.extra_m) & (hits.ambiguous_m > gate.margin_m)
    if extents is not None:
        keep[keep] = extents.contain(hits.plane[keep], hits.hit_map[keep])
    scale = gate.robust_sigmas * std + gate.extra_m
    robust = np.maximum(1.0 - (hits.d / scale) ** 2, 0.0) ** 2
    return keep, robust / std**2


def collapse(hits: Hits, index: IntArray, keep: BoolArray, weight: FloatArray, n_planes: int) -> MicroBins:
    """The kept points' scatter matrices by (slice, plane). index: (N,) slice of each point."""
    chosen = np.flatnonzero(keep)
    key = index[chosen] * n_planes + hits.plane[chosen]
    order = np.argsort(key, kind="stable")
    chosen, key = chosen[order], key[order]
    if len(chosen) == 0:
        return MicroBins(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 15)), np.zeros(0, np.int64))
    starts = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    y = np.empty((len(chosen), 5))
    y[:, :3] = hits.x_hit[chosen]
    y[:, 3] = 1.0
    y[:, 4] = hits.d[chosen]
    products = weight[chosen, None] * y[:, _UPPER[0]] * y[:, _UPPER[1]]
    return MicroBins(
        slice_index=key[starts] // n_planes,
        plane=key[starts] % n_planes,
        scatter=np.add.reduceat(products, starts, axis=0),
        count=np.diff(np.append(starts, len(chosen))),
    )


def unpack(scatter: FloatArray) -> FloatArray:
    """Full symmetric matrices from upper triangles. scatter: (B, 15). Returns (B, 5, 5)."""
    full = np.empty((len(scatter), 5, 5))
    full[:, _UPPER[0], _UPPER[1]] = scatter
    full[:, _UPPER[1], _UPPER[0]] = scatter
    return full


def move(scatter: FloatArray, R: FloatArray, p: FloatArray) -> FloatArray:
    """Scatter matrices with their hits moved rigidly: x -> R x + p. scatter: (B, 5, 5), R: (B, 3, 3), p: (B, 3)."""
    A = np.zeros((len(scatter), 5, 5))
    A[:, :3, :3] = R
    A[:, :3, 3] = p
    A[:, 3, 3] = A[:, 4, 4] = 1.0
    return A @ scatter @ np.swapaxes(A, 1, 2)


def sum_by_key(key: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Distinct keys in order and the sums of their rows. key: (B,), values: (B, ...)."""
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    starts = np.flatnonzero(np.concatenate([[True], sorted_key[1:] != sorted_key[:-1]]))
    return sorted_key[starts], np.add.reduceat(values[order], starts, axis=0)
