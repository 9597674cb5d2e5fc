"""Loops over points and clusters for the lidar's own parameters, compiled. Each has a NumPy twin in the tests."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray, LaserArray

#: Of a point: by its range, elevation, azimuth, its range's scale, its incidence, its azimuth as the encoder's eccentricity
#: moves it, sine and cosine, the depth of its spot (factors/laser_features.py).
FEATURES = 8
#: Columns of a cluster, and what a unit of each adds to the features' coefficients: the laser's offset, elevation, azimuth and
#: scale, everybody's offset, incidence, sine and cosine, grazing; last the surface's height where the points lie, towards the
#: lidar, which shortens every distance alike: minus the cosine and minus one less the cosine.
COLUMNS = 10
HEIGHT = COLUMNS - 1
OF_COLUMN = np.array([0, 1, 2, 3, 0, 4, 5, 6, 7])
#: The same as a list of terms: a column, the feature that it adds to, and by how much for a unit.
TERM_COLUMN = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, HEIGHT, HEIGHT])
TERM_FEATURE = np.append(OF_COLUMN, [0, 4])
TERM_SIGN = np.array([1.0] * 9 + [-1.0, -1.0])
TERMS = len(TERM_COLUMN)
#: Columns of a bin's Jacobian but for the clocks' rate (factors/planes_seen.py).
COLUMNS_SEEN = 19


class LaserTable(NamedTuple):
    """Errors of lasers: laser_features.LaserErrors. Each (L,), but for eccentricity_rad (2,): sine and cosine, of all."""

    range_offset_m: FloatArray
    range_scale: FloatArray
    elevation_rad: FloatArray
    azimuth_rad: FloatArray
    eccentricity_rad: FloatArray


@numba.njit(cache=True, nogil=True)
def correct_point(
    x: float,
    y: float,
    z: float,
    range_offset_m: float,
    range_scale: float,
    sine: float,
    cosine: float,
    azimuth_rad: float,
    eccentricity_rad: FloatArray,
) -> tuple[float, float, float]:
    """Where a point of a laser with these errors lies without them. sine, cosine: of its elevation's error."""
    level2 = x * x + y * y
    r = np.sqrt(level2 + z * z)
    if r < 1e-3:
        return x, y, z
    factor = (r - range_offset_m) / ((1.0 + range_scale) * r)
    level = np.sqrt(level2)
    along = 1.0 if level < 1e-9 else (level * cosine - z * sine) / level
    turned = azimuth_rad
    if level > 1e-9:
        turned += (eccentricity_rad[0] * y + eccentricity_rad[1] * x) / level
    aside, ahead = np.sin(turned), np.cos(turned)
    return (
        (x * ahead - y * aside) * along * factor,
        (x * aside + y * ahead) * along * factor,
        (z * cosine + level * sine) * factor,
    )


@numba.njit(cache=True, nogil=True)
def correct_kernel(
    xyz: Float32Array,
    laser: LaserArray,
    errors: LaserTable,
    out: Float32Array,
) -> None:
    """Fills out (N, 3) with points as they would be without their laser's errors; of other lasers they stay as they are."""
    range_offset_m, range_scale, elevation_rad, azimuth_rad, eccentricity_rad = errors
    lasers = range_offset_m.shape[0]
    sine, cosine = np.sin(elevation_rad), np.cos(elevation_rad)
    for i in range(xyz.shape[0]):
        j = laser[i]
        if j < 0 or j >= lasers:
            out[i, 0], out[i, 1], out[i, 2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            continue
        out[i, 0], out[i, 1], out[i, 2] = correct_point(
            np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2]), range_offset_m[j], range_scale[j],
            sine[j], cosine[j], azimuth_rad[j], eccentricity_rad,
        )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def add_features(
    x0: float,
    x1: float,
    x2: float,
    d: float,
    cosine: float,
    weight: float,
    k: int,
    j: int,
    n_lidar: FloatArray,
    R: FloatArray,
    p: FloatArray,
    b: int,
    cross: FloatArray,
    gram: FloatArray,
    f: FloatArray,
    y: FloatArray,
) -> None:
    """Adds weight f y' to cross (B, 8, 5) and weight f f' to gram (B, 8, 8), at b, of one hit at x on plane j from slice k.

    n_lidar (S, P, 3), R (S, 3, 3), p (S, 3): of all slices.   f (8,), y (5,): room to work.
    """
    level = np.sqrt(x0 * x0 + x1 * x1)
    rise = 0.0 if level < 1e-9 else -x2 / level
    seen = -cosine
    f[0] = seen
    f[1] = rise * (n_lidar[k, j, 0] * x0 + n_lidar[k, j, 1] * x1) + level * n_lidar[k, j, 2]
    f[2] = n_lidar[k, j, 1] * x0 - n_lidar[k, j, 0] * x1
    r = np.sqrt(level * level + x2 * x2)
    f[3] = seen * r
    f[4] = 1.0 - seen
    f[5], f[6] = 0.0, 0.0
    if level > 1e-9:
        f[5], f[6] = f[2] * x1 / level, f[2] * x0 / level
    f[7] = -r * np.sqrt(max(1.0 - seen * seen, 0.0))
    for c in range(3):
        y[c] = R[k, c, 0] * x0 + R[k, c, 1] * x1 + R[k, c, 2] * x2 + p[k, c]
    y[3] = 1.0
    y[4] = d
    for m in range(FEATURES):
        w = weight * f[m]
        for c in range(5):
            cross[b, m, c] += w * y[c]
        for c in range(FEATURES):
            gram[b, m, c] += w * f[c]


@numba.njit(cache=True, nogil=True)
def collapse_features_kernel(
    keep: BoolArray,
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    weight: FloatArray,
    laser: LaserArray,
    n_lidar: FloatArray,
    group: IntArray,
    R: FloatArray,
    p: FloatArray,
    lasers: int,
    cross: FloatArray,
    gram: FloatArray,
    count: IntArray,
    cluster: IntArray,
) -> None:
    """Adds weight f y' to cross and weight f f' to gram of (group, plane, laser), f the features, y = [x_hit, 1, d].

    cross: (G P L, 8, 5).   gram: (G P L, 8, 8).   count: (G P L,).   n_lidar: (S, P, 3) planes as each slice sees them.
    group: (S,) of each slice; R (S, 3, 3), p (S, 3) take its hits to the group's middle.   laser: (N,), from 0.   cluster:
    (N,) where each point's moments go, if not to those of its group, plane and laser; else empty.
    """
    n_planes = n_lidar.shape[1]
    f, y = np.empty(FEATURES), np.empty(5)
    for i in range(keep.shape[0]):
        if not keep[i] or laser[i] >= lasers:
            continue
        s, j = slice_index[i], plane[i]
        b = cluster[i] if cluster.shape[0] > 0 else (group[s] * n_planes + j) * lasers + laser[i]
        add_features(
            x_hit[i, 0], x_hit[i, 1], x_hit[i, 2], d[i], cosine[i], weight[i], s, j, n_lidar, R, p, b, cross, gram, f, y
        )  # fmt: skip
        count[b] += 1


@numba.njit(cache=True, nogil=True)
def gather_features_kernel(
    cross: Float32Array,
    gram: Float32Array,
    use: IntArray,
    R: FloatArray,
    p: FloatArray,
    pose: IntArray,
    place: IntArray,
    total_cross: FloatArray,
    total_gram: Float32Array,
) -> None:
    """Adds moments (B, 8, 5), (B, 8, 8) to those at their places, with their hits moved by x -> R x + p of their pose.

    use: (U,) which of them, pose, place: (U,) each one's pose and place.   R: (T, 3, 3), p: (T, 3).
    """
    for u in range(use.shape[0]):
        b, t, k = use[u], pose[u], place[u]
        for f in range(FEATURES):
            x0, x1, x2, one = cross[b, f, 0], cross[b, f, 1], cross[b, f, 2], cross[b, f, 3]
            for c in range(3):
                total_cross[k, f, c] += R[t, c, 0] * x0 + R[t, c, 1] * x1 + R[t, c, 2] * x2 + p[t, c] * one
            total_cross[k, f, 3] += one
            total_cross[k, f, 4] += cross[b, f, 4]
            for e in range(FEATURES):
                total_gram[k, f, e] += gram[b, f, e]


@numba.njit(cache=True, nogil=True)
def features_squares_kernel(
    pair: IntArray,
    laser: IntArray,
    a: FloatArray,
    cross: FloatArray,
    gram: Float32Array,
    change: FloatArray,
    squares: FloatArray,
) -> None:
    """Fills squares (B,) with what changed coefficients add to the sum of squares of each cluster. change: (L, 8)."""
    for b in range(pair.shape[0]):
        q, j = pair[b], laser[b]
        total = 0.0
        for f in range(FEATURES):
            moved = change[j, f]
            if moved != 0.0:
                value = 0.0
                for c in range(5):
                    value += 2.0 * cross[b, f, c] * a[q, c]
                for e in range(FEATURES):
                    value += gram[b, f, e] * change[j, e]
                total += moved * value
        squares[b] = total


@numba.njit(cache=True, nogil=True)
def add_features_kernel(
    pair: IntArray,
    knot: IntArray,
    plane: IntArray,
    laser: IntArray,
    J: FloatArray,
    a: FloatArray,
    cross: FloatArray,
    gram: Float32Array,
    column_of: IntArray,
    change: FloatArray,
    planes_start: int,
    clock_column: int,
    squeezed: int,
    gradient: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient_shared: FloatArray,
    first: int,
    last: int,
) -> None:
    """Adds what the lidar's parameters share with everything to an arrow system, cluster by cluster: first..last (exclusive).

    pair, laser: (B,).   knot, plane: (Q,) of the pairs.   J: (Q, 4, 19 or 20), a: (Q, 5) of the pairs.   cross: (B, 8, 5),
    gram: (B, 8, 8).   column_of: (L, 10) shared columns, -1 for none.   change: (L, 8) of the features' coefficients since
    the clusters were made.   gradient: (K, 9).   squeezed: by so much these columns come earlier in a knot's border.
    """
    width = J.shape[2]
    lasers, size = column_of.shape[0], corner.shape[0]
    by, pull = np.empty((FEATURES, width)), np.empty(width)
    # What depends on the laser alone is summed up by lasers, and put in place once.
    force, grams = np.zeros((lasers, FEATURES)), np.zeros((lasers, FEATURES, FEATURES))
    common, mixed = np.zeros((lasers, FEATURES, width - 9)), np.zeros((size, size))
    for b in range(first, last):
        q, j = pair[b], laser[b]
        k, at_plane = knot[q], planes_start + 3 * plane[q]
        pull[:] = 0.0
        for f in range(FEATURES):
            w0, w1, w2, w3 = (
                np.float64(cross[b, f, 0]), np.float64(cross[b, f, 1]), np.float64(cross[b, f, 2]), np.float64(cross[b, f, 3]),
            )  # fmt: skip
            for i in range(width):
                by[f, i] = J[q, 0, i] * w0 + J[q, 1, i] * w1 + J[q, 2, i] * w2 + J[q, 3, i] * w3
            own = w0 * a[q, 0] + w1 * a[q, 1] + w2 * a[q, 2] + w3 * a[q, 3] + cross[b, f, 4] * a[q, 4]
            for e in range(FEATURES):
                own += gram[b, f, e] * change[j, e]
                grams[j, f, e] += gram[b, f, e]
            force[j, f] += own
            for e in range(width - 9):
                common[j, f, e] += by[f, 9 + e]
            moved = change[j, f]
            if moved != 0.0:
                for i in range(width):
                    pull[i] += moved * by[f, i]
        for t in range(TERMS):
            column, f, sign = column_of[j, TERM_COLUMN[t]], TERM_FEATURE[t], TERM_SIGN[t]
            if column >= 0:
                for i in range(9):
                    border[k, i, column - squeezed] += sign * by[f, i]
                for e in range(3):
                    mixed[column, at_plane + e] += sign * by[f, 16 + e]
        for i in range(9):
            gradient[k, i] += pull[i]
        for e in range(7):
            gradient_shared[e] += pull[9 + e]
        for e in range(3):
            gradient_shared[at_plane + e] += pull[16 + e]
        if width > COLUMNS_SEEN:
            gradient_shared[clock_column] += pull[COLUMNS_SEEN]
    for j in range(lasers):
        for t in range(TERMS):
            column, f, sign = column_of[j, TERM_COLUMN[t]], TERM_FEATURE[t], TERM_SIGN[t]
            if column < 0:
                continue
            gradient_shared[column] += sign * force[j, f]
            for e in range(7):
                mixed[column, e] += sign * common[j, f, e]
            if width > COLUMNS_SEEN:
                mixed[column, clock_column] += sign * common[j, f, COLUMNS_SEEN - 9]
            for o in range(TERMS):
                other = column_of[j, TERM_COLUMN[o]]
                if other >= 0:
                    corner[column, other] += sign * TERM_SIGN[o] * grams[j, f, TERM_FEATURE[o]]
    for r in range(size):
        for c in range(size):
            corner[r, c] += mixed[r, c] + mixed[c, r]
