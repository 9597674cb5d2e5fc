"""From a scan's points to moments in one compiled pass: corrected, met with planes, gated, weighed and summed, point by point.

What `find_hits`, `select`, `collapse` and `collapse_features` do one after the other, with nothing kept of a single point in
between: of whole scans, what is in between would be ten times what is read. Those four are its twin in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from calib_core.factors.cell_kernels import Grids, lies_within
from calib_core.factors.kernels import (
    SeenPlanes,
    Weighing,
    add_moments,
    as_sieved,
    is_sieved,
    looked_at,
    meet,
    weight_of,
)
from calib_core.factors.laser_features import LaserErrors, LaserSums, steps_to_middles
from calib_core.factors.laser_kernels import FEATURES, PRODUCTS, LaserTable, add_features, correct_point
from calib_core.factors.lidar_plane import Gate, LidarNoise, MicroBins, SlicePoses, grids, seen_planes, weighing_of
from calib_core.factors.support import CELL_M, HALF_CELLS, PlaneExtents
from calib_core.types import BoolArray, CountArray, Float32Array, FloatArray, IntArray, LaserArray, PointArray


@dataclass(frozen=True, slots=True)
class LaserGroups:
    """How the lidar's own parameters take the points: lasers told apart, or 1.   group: (S,) of each slice.   middle: (G,)."""

    lasers: int
    group: IntArray
    middle: IntArray


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
    off = LaserErrors(none, none, none, none, 0.0) if errors is None or not errors.any() else errors
    group, R, p, clusters = np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)), 0
    if groups is not None:
        group, clusters = groups.group, len(groups.middle) * n_planes * groups.lasers
        R, p = steps_to_middles(poses, group, groups.middle)
    scatter, count = np.zeros((slices * n_planes, 15)), np.zeros(slices * n_planes, np.int64)
    cross, gram = np.zeros((clusters, FEATURES, 5)), np.zeros((clusters, PRODUCTS))
    of_cluster = np.zeros(clusters, np.int64)
    slant = np.zeros(2) if errors is None else errors.slant()
    moments_kernel(
        points["xyz"], points["offset_ns"], points["ring"], off.table(), slant, seen,
        extra, weighing_of(noise, gate), cells, inside, scatter, count, told_apart, group, R, p, cross, gram, of_cluster,
    )  # fmt: skip
    filled = np.flatnonzero(count)
    bins = MicroBins(filled // n_planes, filled % n_planes, scatter[filled], count[filled])
    if groups is None:
        return bins, None
    return bins, LaserSums.filled(cross, gram, of_cluster, n_planes, groups.lasers)


@numba.njit(cache=True, nogil=True)
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
    slant: (2,) LaserErrors.slant.   inside: (Q, rows, columns), (0, ..) for everywhere.   told_apart: by `laser` (N,);
    else all are laser 0.   group: (S,), (0,) where the lidar is taken for ideal; R, p as in collapse_features_kernel.
    """
    range_offset_m, range_scale, elevation_rad, azimuth_rad, eccentricity_rad = off
    slice_s, n_lidar, w_lidar, omega, v, usable, min_cosine, min_azimuth_cosine = seen
    u, origin, cell_m, half = cells
    n_planes = extra_of_plane_m.shape[0]
    D, along, hit = np.empty(n_lidar.shape[1]), np.empty(n_lidar.shape[1]), np.empty(6)
    errors, sine, cosine = range_offset_m.shape[0], np.sin(elevation_rad), np.cos(elevation_rad)
    lasers = of_cluster.shape[0] // max((group.max() + 1) * n_planes, 1) if group.shape[0] > 0 else 0
    x0: float
    x1: float
    x2: float
    for i in range(xyz.shape[0]):
        which = laser[i] if told_apart else 0
        x0, x1, x2 = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        if which < errors:
            x0, x1, x2 = correct_point(
                x0, x1, x2, range_offset_m[which], range_scale[which], sine[which], cosine[which], azimuth_rad[which],
                eccentricity_rad,
            )  # fmt: skip
            x0, x1, x2 = np.float64(np.float32(x0)), np.float64(np.float32(x1)), np.float64(np.float32(x2))
        offset_s = offset_ns[i] * 1e-9
        k = int(offset_s / slice_s)
        if not usable[k] or not looked_at(x0, x1, x2, min_azimuth_cosine):
            continue
        t = offset_s - (k + 0.5) * slice_s
        j = meet(x0, x1, x2, t, k, n_lidar, w_lidar, omega, v, min_cosine, D, along, hit)
        if j < 0 or j >= n_planes:
            continue
        d = hit[3] + slant[0] * (1.0 + hit[4])
        if slant[1] != 0.0:
            range_m = np.sqrt(hit[0] * hit[0] + hit[1] * hit[1] + hit[2] * hit[2])
            d -= slant[1] * range_m * np.sqrt(max(1.0 - hit[4] * hit[4], 0.0))
        weight = weight_of(hit[0], hit[1], hit[2], d, hit[4], hit[5], extra_of_plane_m[j], weighing)
        if is_sieved(weight, extra_of_plane_m[j], hit[4], weighing):
            d, weight = as_sieved(hit, d, xyz[i], extra_of_plane_m[j], weighing)
        if weight < 0.0 or (
            inside.shape[0] > 0 and not lies_within(hit[0], hit[1], hit[2], k, j, u, origin, cell_m, half, inside)
        ):
            continue
        b = k * n_planes + j
        add_moments(hit[0], hit[1], hit[2], d, weight, scatter, b)
        count[b] += 1
        if which < lasers:
            c = (group[k] * n_planes + j) * lasers + which
            add_features(hit[0], hit[1], hit[2], d, hit[4], weight, k, j, n_lidar, R, p, c, cross, gram)
            of_cluster[c] += 1
