"""Planes of one cloud by sequential RANSAC (paper section II-E), made for sparse rings.

A spinning lidar's nearest neighbours all lie on one ring, so normals are not estimated point by point. Hypotheses are
drawn locally instead (a point and two of its neighbours), scored on a subsample, and refitted by weighted least squares.
Three checks keep out what is not a surface:

* seen face on: a plane through the sensor collects whole rings; its points are seen edge on and do not count;
* dominance: around a surface, the slab next to it is nearly empty, whereas an imaginary cut through other surfaces has
  as many points beside it as in it;
* breadth: the points spread in two directions, those of one piece by themselves: two poles are no wall.

A normal points to the side from which the plane was seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from calib_core.geometry import plane_axes
from calib_core.planes.kernels import band_kernel, support_kernel
from calib_core.planes.same_plane import same_place
from calib_core.planes.sample import evenly_spread
from calib_core.planes.settings import SegmentSettings
from calib_core.types import BoolArray, FloatArray

#: A prime beyond all cells of a side: a row and a column are one number.
_ROW_KEY = 1_000_003
#: Standard deviation of a normal law over its median absolute deviation.
_NORMAL_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """A plane n . x + w = 0 and the points that carry it. normal: (3,) towards the viewpoint. inliers: (N,) bool."""

    normal: FloatArray
    offset_m: float
    inliers: BoolArray
    rms_m: float


def fit_plane(points_m: FloatArray, weights: FloatArray | None = None) -> tuple[FloatArray, float, FloatArray]:
    """The least-squares plane of points: unit normal, offset, and the three standard deviations of the scatter.

    points_m: (N, 3).   weights: (N,) or None.   Returns normal (3,), offset_m, std_m (3,) ascending: the first is the
    thickness, the other two the spread within the plane.
    """
    w, whole = (1.0, len(points_m)) if weights is None else (weights[:, None], weights.sum())
    weighted = points_m if weights is None else w * points_m
    centre = weighted.sum(axis=0) / whole
    centred = points_m - centre
    values, vectors = np.linalg.eigh((centred * w).T @ centred / whole)
    normal = vectors[:, 0]
    return normal, -float(normal @ centre), np.sqrt(np.maximum(values, 0.0))


def segment_planes(
    points_m: FloatArray,
    *,
    viewpoint_m: FloatArray | None = None,
    seed: int = 0,
    settings: SegmentSettings | None = None,
) -> list[PlaneFit]:
    """The planes of a cloud, largest first.

    points_m: (N, 3), any frame.   viewpoint_m: (3,) the sensor's place in that frame, default the origin.
    Deterministic for a given seed. An empty list where nothing planar is found.
    """
    s = settings or SegmentSettings()
    rng = np.random.default_rng(seed)
    view = np.zeros(3) if viewpoint_m is None else viewpoint_m
    points = np.asarray(points_m, dtype=np.float64) - view
    if len(points) < s.min_points:
        return []
    ranges = np.linalg.norm(points, axis=1)
    tolerance = s.distance_m + s.distance_per_range * ranges
    free = np.ones(len(points), dtype=bool)
    least = max(s.min_points, int(s.min_share * len(points)))
    fits: list[PlaneFit] = []
    failures = 0
    while len(fits) < s.max_planes and failures < s.failures and free.sum() >= least:
        candidate = _best_hypothesis(points, ranges, tolerance, free, rng, s)
        if candidate is None:
            break
        fit = _refine(points, ranges, tolerance, free, candidate, s)
        if fit is None or fit.inliers.sum() < least:
            failures += 1
            if fit is not None:
                free &= ~fit.inliers
            continue
        near = np.abs(points @ fit.normal + fit.offset_m) < tolerance
        if _is_surface(points, fit, free, near, tolerance, s):
            fits.append(fit)
        else:
            failures += 1
        free &= ~near
    smooth = _without_rough(points, _merge(points, fits, s), s)
    moved = [PlaneFit(f.normal, f.offset_m - float(f.normal @ view), f.inliers, f.rms_m) for f in smooth]
    return sorted(moved, key=lambda f: -int(f.inliers.sum()))


def _without_rough(points: FloatArray, fits: list[PlaneFit], s: SegmentSettings) -> list[PlaneFit]:
    """The fits without those much rougher than the best carried: the noise is the sensor's, more than that is clutter.

    Range noise shows across a plane by the cosine of incidence: a floor seen at a slant looks smoother than a wall.
    """
    if not fits:
        return []
    weight = np.array([float(f.inliers.sum()) for f in fits])
    noise = np.array([f.rms_m / max(_incidence(points[f.inliers], f.normal), s.least_cosine) for f in fits])
    order = np.argsort(noise)
    typical = noise[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())]
    limit = max(s.roughness * typical, typical + s.bend_m)
    return [f for f, n in zip(fits, noise, strict=True) if n <= limit]


def _incidence(points: FloatArray, normal: FloatArray) -> float:
    """Root mean square cosine between rays from the viewpoint (the origin) and the normal."""
    cosine = (points @ normal) / np.maximum(np.linalg.norm(points, axis=1), 1e-9)
    return float(np.sqrt(np.mean(cosine**2)))


def _best_hypothesis(
    points: FloatArray,
    ranges: FloatArray,
    tolerance: FloatArray,
    free: BoolArray,
    rng: np.random.Generator,
    s: SegmentSettings,
) -> tuple[FloatArray, float] | None:
    """The plane through three neighbouring free points that collects most free points seen face on."""
    pool = np.flatnonzero(free)
    pick = pool if len(pool) <= s.subsample else np.sort(rng.choice(pool, s.subsample, replace=False))
    cloud, tol, rho = points[pick], tolerance[pick], ranges[pick]
    if len(pick) < s.fewest_neighbours:
        return None
    first = rng.integers(len(pick), size=s.hypotheses)
    # The k-th nearest of all is about the nearest of every k-th, and much sooner found; drawn, as a stride may fall on one ring.
    thinned = min(1.0, s.sought / min(len(pick), s.neighbours))
    among = cloud[rng.choice(len(pick), round(thinned * len(pick)), replace=False)]
    neighbours = min(len(among), s.sought)
    _, near = scipy.spatial.cKDTree(among).query(cloud[first], k=neighbours)
    column = rng.integers(neighbours // 4, neighbours, size=(s.hypotheses, 2))
    each = np.arange(s.hypotheses)
    a, b, c = cloud[first], among[near[each, column[:, 0]]], among[near[each, column[:, 1]]]
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    spread = np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1)
    good = area > s.least_sine * np.maximum(spread, 1e-12)
    if not good.any():
        return None
    normal, a = normal[good] / area[good, None], a[good]
    offset = -np.einsum("ij,ij->i", normal, a)
    best = int(np.argmax(support_kernel(cloud, tol, s.min_incidence * rho, normal, offset)))
    return normal[best], float(offset[best])


def _refine(
    points: FloatArray,
    ranges: FloatArray,
    tolerance: FloatArray,
    free: BoolArray,
    start: tuple[FloatArray, float],
    s: SegmentSettings,
) -> PlaneFit | None:
    """Least squares on the inliers, the band shrinking to three robust sigmas of what it holds."""
    normal, offset = start
    least_along, narrow_m = s.min_incidence * ranges, np.inf
    inliers, before = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
    for _ in range(s.refits):
        inliers, before = before, inliers
        mine = band_kernel(points, least_along, tolerance, free, normal, offset, narrow_m, s.least_band, inliers)
        if len(mine) < s.min_points // 2:
            return None
        if np.array_equal(inliers, before):
            break
        sigma = _NORMAL_MAD * np.median(np.abs(mine - np.median(mine)))
        normal, offset, _ = fit_plane(points[inliers])
        narrow_m = s.band_sigmas * sigma
    if offset < 0:  # the viewpoint is the origin here: its signed distance is the offset, made positive
        normal, offset = -normal, -offset
    residual = points[inliers] @ normal + offset
    return PlaneFit(normal, offset, inliers, float(np.sqrt(np.mean(residual**2))))


def _is_surface(
    points: FloatArray, fit: PlaneFit, free: BoolArray, near: BoolArray, tolerance: FloatArray, s: SegmentSettings
) -> bool:
    """Broad, and dominant over its neighbourhood: most free points of its cells within five bands belong to it."""
    inside = points[fit.inliers]
    _, _, std = fit_plane(inside)
    if std[1] < s.min_breadth_m:
        return False
    e1, e2 = plane_axes(fit.normal)
    distance = points @ fit.normal + fit.offset_m
    slab = free & (np.abs(distance) < s.slab_bands * tolerance)
    index = np.floor(np.stack([points @ e1, points @ e2], axis=1) / s.cell_m).astype(np.int64)
    key = index[:, 0] * _ROW_KEY + index[:, 1]
    mine, mine_count = np.unique(key[slab & near], return_counts=True)
    every, every_count = np.unique(key[slab], return_counts=True)
    if len(mine) < s.fewest_cells:
        return False
    nearby = every_count[np.searchsorted(every, mine)]
    # A cut through fog fills its band evenly and holds a fifth of the slab; a surface has a narrow band and most of it.
    narrow = fit.rms_m < s.narrowness * float(np.mean(tolerance[fit.inliers]))
    if not narrow or mine_count.sum() < s.slab_share * nearby.sum():
        return False
    share = mine_count / nearby
    # Weighted by points: the share of this plane's points that lie in cells it dominates.
    if float(mine_count[share > s.dominance].sum() / mine_count.sum()) <= s.dominated_share:
        return False
    return _breadth_of_a_piece_m(inside, s) >= s.piece_breadth_m


def _breadth_of_a_piece_m(points: FloatArray, s: SegmentSettings) -> float:
    """The narrower spread of the largest piece of a plane's points (N, 3): what is seen without a gap, from the origin."""
    some = points[evenly_spread(len(points), s.pieced)] if len(points) > s.pieced else points
    rays = some / np.maximum(np.linalg.norm(some, axis=1), 1e-9)[:, None]
    # Pairs of cells of the view, as pairs of points would be a million where these lie close together.
    cells, cell = np.unique(np.floor(rays * (s.gap_cells / s.gap_rad)).astype(np.int64), axis=0, return_inverse=True)
    near = scipy.spatial.cKDTree(cells).query_pairs(s.gap_cells, output_type="ndarray")
    links = scipy.sparse.coo_array((np.ones(len(near), np.bool_), tuple(near.T)), shape=(len(cells), len(cells)))
    _, piece_of = scipy.sparse.csgraph.connected_components(links, directed=False)
    piece = piece_of[cell.reshape(-1)]
    return float(fit_plane(some[piece == np.argmax(np.bincount(piece))])[2][1])


def _merge(points: FloatArray, fits: list[PlaneFit], s: SegmentSettings) -> list[PlaneFit]:
    """Planes with the same equation made one."""
    merged: list[PlaneFit] = []
    for fit in fits:
        centre = points[fit.inliers].mean(axis=0)
        normals, offsets = np.array([f.normal for f in merged]).reshape(-1, 3), np.array([f.offset_m for f in merged])
        known = same_place(normals, offsets, fit.normal, centre, within_deg=s.same_deg, within_m=s.same_m)
        if not known.any():
            merged.append(fit)
            continue
        first = int(np.argmax(known))
        both = fit.inliers | merged[first].inliers
        normal, offset, std = fit_plane(points[both])
        sign = np.sign(offset) if offset != 0 else 1.0
        merged[first] = PlaneFit(normal * sign, offset * sign, both, float(std[0]))
    return merged


def determinacy(normals: FloatArray, open_ways: int = 0) -> float:
    """Smallest eigenvalue of the mean of n n^T but for so many: 0 where some other translation is not seen. normals: (P, 3)."""
    if len(normals) == 0:
        return 0.0
    return float(np.linalg.eigvalsh(normals.T @ normals / len(normals))[open_ways])
