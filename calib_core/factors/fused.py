"""From a scan's points to moments in one compiled pass: corrected, met with planes, gated, weighed and summed, point by point.

What `find_hits`, `select`, `collapse` and `collapse_features` do one after the other, with nothing kept of a single point in
between: of whole scans, what is in between would be ten times what is read. Those four are its twin in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from calib_core.factors.blocks import (
    BESIDE,
    BLOCK,
    COSINE,
    DISTANCE,
    HIT_X,
    HIT_Y,
    HIT_Z,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    PLANE,
    WEIGHT,
    SeenPlanes,
    T,
    Weighing,
    X,
    Y,
    Z,
    correct_block,
    features_block,
    meet_block,
    new_block,
    places_block,
    weigh_block,
)
from calib_core.factors.cell_kernels import Grids, lies_within
from calib_core.factors.kernels import add_moments, as_sieved, is_sieved
from calib_core.factors.laser_features import LaserErrors, LaserSums, steps_to_middles
from calib_core.factors.laser_kernels import (
    FEATURES,
    PRODUCTS,
    LaserTable,
    add_features,
    add_ones,
    table_of,
    tell_laser,
)
from calib_core.factors.lidar_plane import Gate, LidarNoise, MicroBins, SlicePoses, grids, seen_planes, weighing_of
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.types import BoolArray, CountArray, Float32Array, FloatArray, IntArray, LaserArray, PointArray


@dataclass(frozen=True, slots=True)
class LaserGroups:
    """How the lidar's own parameters take the points: lasers told apart, or 1.   group: (S,) of each slice.   middle: (G,).

    first_only: of the moments only those of the points themselves are asked for, sum w [x, 1, d]': a single row, of ones.
    """

    lasers: int
    group: IntArray
    middle: IntArray
    first_only: bool = False


def scan_moments(
    points: PointArray,
    poses: SlicePoses,
    planes: tuple[FloatArray, FloatArray, int],
    noise: LidarNoise,
    gate: Gate,
    extents: PlaneExtents | None,
    *,
    errors: LaserErrors | None,
    told_apart: bool,
    groups: LaserGroups | None,
    field_of_view_deg: float | None,
) -> tuple[MicroBins, LaserSums | None]:
    """A whole scan's points, laid on planes and collapsed.

    planes: normals (P, 3), offsets (P,), of which so many take points; the others only stand in their way.   errors: None
    for an ideal lidar.   told_apart: whether lasers are.   groups: None where the lidar's parameters are not in play.
    """
    normals, offsets_m, n_planes = planes
    slices, none = len(poses.p), np.zeros(0)
    seen = seen_planes(poses, normals, offsets_m, gate, field_of_view_deg)
    extra = np.full(n_planes, gate.extra_m) if gate.extra_of_plane_m is None else gate.extra_of_plane_m
    cells, inside = (
        Grids(np.zeros((0, 0, 2, 3)), np.zeros((0, 0, 2)), CELL_M, HALF_CELLS),
        np.zeros((0, 0, 0), np.bool_),
    )
    if extents is not None:
        cells, inside = grids(poses, extents.normals), extents.inside
    off = LaserErrors(none, none, none, none, none) if errors is None or not errors.any() else errors
    group, R, p, clusters = np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)), 0
    if groups is not None:
        group, clusters = groups.group, len(groups.middle) * n_planes * groups.lasers
        R, p = steps_to_middles(poses, group, groups.middle)
    scatter, count = np.zeros((slices * n_planes, 15)), np.zeros(slices * n_planes, np.int64)
    features, products = (1, 0) if groups is not None and groups.first_only else (FEATURES, clusters)
    cross, gram = np.zeros((clusters, features, 5)), np.zeros((products, PRODUCTS))
    of_cluster = np.zeros(clusters, np.int64)
    # Planes that take no points, and no plane, the last, are met as if their material were nothing.
    slant = np.zeros(len(normals) + 2)
    if errors is not None:
        slant[0], slant[1 : 1 + n_planes] = errors.grazing_rad, errors.incidence_m
    moments_kernel(
        points["xyz"], points["offset_ns"], points["ring"], off.table(), slant, seen,
        extra, weighing_of(noise, gate), cells, inside, scatter, count, told_apart, group, R, p, cross, gram, of_cluster,
    )  # fmt: skip
    filled = np.flatnonzero(count)
    bins = MicroBins(filled // n_planes, filled % n_planes, scatter[filled], count[filled])
    if groups is None:
        return bins, None
    return bins, LaserSums.filled(cross, gram, of_cluster, n_planes, groups.lasers)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def moments_kernel(
    xyz: Float32Array,
    offset_ns: CountArray,
    laser: LaserArray,
    off: LaserTable,
    slant: FloatArray,
    seen: SeenPlanes,
    extra_of_plane_m: FloatArray,
    weighing: Weighing,
    cells: Grids,
    inside: BoolArray,
    scatter: FloatArray,
    count: IntArray,
    told_apart: bool,
    group: IntArray,
    R: FloatArray,
    p: FloatArray,
    cross: FloatArray,
    gram: FloatArray,
    of_cluster: IntArray,
) -> None:
    """Fills scatter (S Q, 15) and count (S Q,); with lasers in play cross (G Q L, 8, 5), gram (G Q L, 28), of_cluster (G Q L,).

    Of the seen planes the first Q = len(extra_of_plane_m) take points.   off: of no laser where nothing is to be corrected.
    gram (0, 28): only ones are summed, cross (G Q L, 1, 5).
    slant: (P + 2,) as `weigh_block` has it.   inside: (Q, rows, columns), (0, ..) for everywhere.   told_apart: by `laser` (N,);
    else all are laser 0.   group: (S,), (0,) where the lidar is taken for ideal; R, p as in collapse_features_kernel.
    """
    n_planes, points = extra_of_plane_m.shape[0], xyz.shape[0]
    table, S, at, i = table_of(off), new_block(seen.n_lidar.shape[1]), np.empty(BLOCK, np.int64), 0
    corrects = off.range_offset_m.shape[0] > 0
    lasers = of_cluster.shape[0] // max((group.max() + 1) * n_planes, 1) if group.shape[0] > 0 else 0
    while i < points:
        k, begin, n = int(offset_ns[i] * 1e-9 / seen.slice_s), i, 0
        while i < points and n < BLOCK:
            offset_s = offset_ns[i] * 1e-9
            if int(offset_s / seen.slice_s) != k:
                break
            S[X + n], S[Y + n], S[Z + n] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            S[T + n] = offset_s - (k + 0.5) * seen.slice_s
            if corrects:
                tell_laser(S, n, table, laser[i] if told_apart else 0)
            i, n = i + 1, n + 1
        if not seen.usable[k]:
            continue
        if corrects:
            correct_block(S, n, off.eccentricity_rad)
        meet_block(S, n, k, seen, extra_of_plane_m)
        weigh_block(S, n, slant, weighing)
        counted = _count_block(S, n, k, begin, xyz, extra_of_plane_m, weighing, cells, inside, scatter, count, at)
        if lasers > 0:
            _sort_in(
                S,
                counted,
                k,
                at,
                laser,
                told_apart,
                group[k] * n_planes,
                seen.n_lidar,
                R,
                p,
                lasers,
                cross,
                gram,
                of_cluster,
            )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _count_block(
    S: FloatArray,
    n: int,
    k: int,
    begin: int,
    xyz: Float32Array,
    extra_of_plane_m: FloatArray,
    weighing: Weighing,
    cells: Grids,
    inside: BoolArray,
    scatter: FloatArray,
    count: IntArray,
    at: IntArray,
) -> int:
    """Adds the hits of a block that count to the moments of their planes. Returns how many, moved to the block's beginning.

    Of those PLANE, DISTANCE, COSINE and WEIGHT, X, Y, Z where they hit, at (n,) which points they are.   begin: of the first.
    """
    u, origin, cell_m, half = cells
    n_planes, counted = extra_of_plane_m.shape[0], 0
    for m in range(n):
        weight = S[WEIGHT + m]
        if weight < 0.0:
            continue
        j, x, y, z, d = int(S[PLANE + m]), S[HIT_X + m], S[HIT_Y + m], S[HIT_Z + m], S[DISTANCE + m]
        if is_sieved(weight, extra_of_plane_m[j], S[COSINE + m], weighing):
            d, weight = as_sieved(
                x, y, z, d, S[COSINE + m], S[BESIDE + m], xyz[begin + m], extra_of_plane_m[j], weighing
            )
        if weight < 0.0 or (inside.shape[0] > 0 and not lies_within(x, y, z, k, j, u, origin, cell_m, half, inside)):
            continue
        add_moments(x, y, z, d, weight, scatter, k * n_planes + j)
        count[k * n_planes + j] += 1
        S[X + counted], S[Y + counted], S[Z + counted] = x, y, z
        S[PLANE + counted], S[DISTANCE + counted], S[WEIGHT + counted] = S[PLANE + m], d, weight
        S[COSINE + counted] = S[COSINE + m]
        at[counted] = begin + m
        counted += 1
    return counted


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _sort_in(
    S: FloatArray,
    n: int,
    k: int,
    at: IntArray,
    laser: LaserArray,
    told_apart: bool,
    first: int,
    n_lidar: FloatArray,
    R: FloatArray,
    p: FloatArray,
    lasers: int,
    cross: FloatArray,
    gram: FloatArray,
    of_cluster: IntArray,
) -> None:
    """Adds what `_count_block` has counted to the sums of (group, plane, laser). first: the group's first plane's place."""
    if gram.shape[0] == 0:
        places_block(S, n, k, R, p)
        for m in range(n):
            which = laser[at[m]] if told_apart else 0
            if which < lasers:
                c = (first + int(S[PLANE + m])) * lasers + which
                add_ones(S, m, S[DISTANCE + m], S[WEIGHT + m], c, 0, cross)
                of_cluster[c] += 1
        return
    for m in range(n):
        j = int(S[PLANE + m])
        S[NORMAL_X + m], S[NORMAL_Y + m], S[NORMAL_Z + m] = n_lidar[k, j, 0], n_lidar[k, j, 1], n_lidar[k, j, 2]
    features_block(S, n, k, R, p)
    for m in range(n):
        which = laser[at[m]] if told_apart else 0
        if which < lasers:
            c = (first + int(S[PLANE + m])) * lasers + which
            add_features(S, m, S[DISTANCE + m], S[WEIGHT + m], c, cross, gram)
            of_cluster[c] += 1
