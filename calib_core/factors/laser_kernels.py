"""Loops over points and clusters for the lidar's own parameters, compiled. Each has a NumPy twin in the tests."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from calib_core.factors.blocks import (
    BLOCK,
    COSINE,
    FEATURE,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    OFFSET,
    PLACE,
    X,
    Y,
    Z,
    correct_block,
    features_block,
    new_block,
)
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray, LaserArray

#: Of a point: by its range, elevation, azimuth, its range's scale, its incidence, its azimuth as the encoder's eccentricity
#: moves it, sine and cosine, the depth of its spot (factors/laser_features.py).
FEATURES = 8
#: Where the incidence stands among them, which is one less the first: its moments follow from those of the others and of a one.
INCIDENCE = 4
#: The others, and how many products two of them make.
OTHERS = np.array([0, 1, 2, 3, 5, 6, 7])
PRODUCTS = len(OTHERS) * (len(OTHERS) + 1) // 2
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def table_of(errors: LaserTable) -> FloatArray:
    """(L + 1, 6) what `correct_block` is told of a point of each laser, OFFSET to KNOWN; the last row is any other's."""
    lasers = errors.range_offset_m.shape[0]
    table = np.zeros((lasers + 1, 6))
    for j in range(lasers):
        table[j, 0], table[j, 1] = errors.range_offset_m[j], errors.range_scale[j]
        table[j, 2], table[j, 3] = np.sin(errors.elevation_rad[j]), np.cos(errors.elevation_rad[j])
        table[j, 4], table[j, 5] = errors.azimuth_rad[j], 1.0
    return table


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def tell_laser(S: FloatArray, n: int, table: FloatArray, laser: int) -> None:
    """Tells a block of which laser its n-th point is."""
    row = laser if laser < table.shape[0] else table.shape[0] - 1
    for c in range(6):
        S[OFFSET + c * BLOCK + n] = table[row, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def correct_kernel(
    xyz: Float32Array,
    laser: LaserArray,
    errors: LaserTable,
    out: Float32Array,
) -> None:
    """Fills out (N, 3) with points as they would be without their laser's errors; of other lasers they stay as they are."""
    table, S = table_of(errors), new_block(0)
    for begin in range(0, xyz.shape[0], BLOCK):
        n = min(BLOCK, xyz.shape[0] - begin)
        for m in range(n):
            S[X + m], S[Y + m], S[Z + m] = xyz[begin + m, 0], xyz[begin + m, 1], xyz[begin + m, 2]
            tell_laser(S, m, table, laser[begin + m])
        correct_block(S, n, errors.eccentricity_rad)
        for m in range(n):
            out[begin + m, 0], out[begin + m, 1], out[begin + m, 2] = S[X + m], S[Y + m], S[Z + m]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_features(S: FloatArray, m: int, d: float, weight: float, b: int, cross: FloatArray, gram: FloatArray) -> None:
    """Adds to the sums of cluster b the m-th hit of a block, of which `features_kernel` makes the moments.

    S: after `features_block`.   cross (B, 8, 5): weight f y', but in the incidence's row weight y'.   gram (B, 28): weight f f'
    of the other features, upper triangle row by row.
    """
    y0, y1, y2 = S[PLACE + m], S[PLACE + BLOCK + m], S[PLACE + 2 * BLOCK + m]
    f = (
        S[FEATURE + m], S[FEATURE + BLOCK + m], S[FEATURE + 2 * BLOCK + m], S[FEATURE + 3 * BLOCK + m],
        S[FEATURE + 4 * BLOCK + m], S[FEATURE + 5 * BLOCK + m], S[FEATURE + 6 * BLOCK + m],
    )  # fmt: skip
    place = 0
    for r in range(7):
        row = r if r < INCIDENCE else r + 1
        w = weight * f[r]
        cross[b, row, 0] += w * y0
        cross[b, row, 1] += w * y1
        cross[b, row, 2] += w * y2
        cross[b, row, 3] += w
        cross[b, row, 4] += w * d
        for c in range(r, 7):
            gram[b, place] += w * f[c]
            place += 1
    cross[b, INCIDENCE, 0] += weight * y0
    cross[b, INCIDENCE, 1] += weight * y1
    cross[b, INCIDENCE, 2] += weight * y2
    cross[b, INCIDENCE, 3] += weight
    cross[b, INCIDENCE, 4] += weight * d


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_kernel(
    cross_sums: FloatArray, gram_sums: FloatArray, some: IntArray, cross: Float32Array, gram: Float32Array
) -> None:
    """Fills moments (B, 8, 5), (B, 8, 8) from `some` (B,) of the sums of `add_features`: of 1 - f what is left of the one's."""
    for b in range(some.shape[0]):
        s, place = some[b], 0
        for c in range(5):
            for m in range(FEATURES):
                cross[b, m, c] = cross_sums[s, m, c]
            cross[b, INCIDENCE, c] = cross_sums[s, INCIDENCE, c] - cross_sums[s, 0, c]
        for m in range(OTHERS.shape[0]):
            row = OTHERS[m]
            gram[b, INCIDENCE, row] = gram[b, row, INCIDENCE] = cross_sums[s, row, 3] - gram_sums[s, m]
            for c in range(m, OTHERS.shape[0]):
                gram[b, row, OTHERS[c]] = gram[b, OTHERS[c], row] = gram_sums[s, place]
                place += 1
        one, first = cross_sums[s, INCIDENCE, 3], cross_sums[s, 0, 3]
        gram[b, INCIDENCE, INCIDENCE] = one - 2.0 * first + gram_sums[s, 0]


@numba.njit(cache=True, nogil=True, error_model="numpy")
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
    """Adds kept hits to the sums of their (group, plane, laser): `add_features`.

    cross: (G P L, 8, 5).   gram: (G P L, 28).   count: (G P L,).   n_lidar: (S, P, 3) planes as each slice sees them.
    group: (S,) of each slice; R (S, 3, 3), p (S, 3) take its hits to the group's middle.   laser: (N,), from 0.   cluster:
    (N,) where each point's moments go, if not to those of its group, plane and laser; else empty.
    """
    n_planes, points = n_lidar.shape[1], keep.shape[0]
    S, at, i = new_block(0), np.empty(BLOCK, np.int64), 0
    while i < points:
        s, n = slice_index[i], 0
        while i < points and n < BLOCK and slice_index[i] == s:
            if keep[i] and laser[i] < lasers:
                j = plane[i]
                S[X + n], S[Y + n], S[Z + n], S[COSINE + n] = x_hit[i, 0], x_hit[i, 1], x_hit[i, 2], cosine[i]
                S[NORMAL_X + n], S[NORMAL_Y + n], S[NORMAL_Z + n] = n_lidar[s, j, 0], n_lidar[s, j, 1], n_lidar[s, j, 2]
                at[n] = i
                n += 1
            i += 1
        features_block(S, n, s, R, p)
        for m in range(n):
            of = at[m]
            b = cluster[of] if cluster.shape[0] > 0 else (group[s] * n_planes + plane[of]) * lasers + laser[of]
            add_features(S, m, d[of], weight[of], b, cross, gram)
            count[b] += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gather_features_kernel(
    cross: Float32Array,
    use: IntArray,
    R: FloatArray,
    p: FloatArray,
    pose: IntArray,
    place: IntArray,
    total_cross: FloatArray,
) -> None:
    """Adds moments (B, 8, 5) to those at their places, with their hits moved by x -> R x + p of their pose.

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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sum_grams_kernel(gram: Float32Array, plane: IntArray, laser: IntArray, grams: FloatArray) -> None:
    """Adds gram (U, 8, 8) to the sums of their plane and laser (U,): grams (P, L, 8, 8)."""
    for u in range(gram.shape[0]):
        for f in range(FEATURES):
            for e in range(FEATURES):
                grams[plane[u], laser[u], f, e] += gram[u, f, e]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_crossed_kernel(
    bins: IntArray, laser: IntArray, a: FloatArray, cross: FloatArray, change: FloatArray, crossed: FloatArray
) -> None:
    """Fills crossed (B,) with sum w (f . change) (y . a) of each cluster. a: (Q, 5) of the bins.   change: (L, 8)."""
    for b in range(bins.shape[0]):
        q, j = bins[b], laser[b]
        total = 0.0
        for f in range(FEATURES):
            moved = change[j, f]
            if moved != 0.0:
                value = 0.0
                for c in range(5):
                    value += cross[b, f, c] * a[q, c]
                total += moved * value
        crossed[b] = total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_features_kernel(
    bins: IntArray,
    knot: IntArray,
    plane: IntArray,
    laser: IntArray,
    J: FloatArray,
    a: FloatArray,
    cross: FloatArray,
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

    bins, laser: (B,).   knot, plane: (Q,) of the bins.   J: (Q, 4, 19 or 20), a: (Q, 5) of the bins.   cross: (B, 8, 5).
    column_of: (L, 10) shared columns, -1 for none.   change: (L, 8) of the features' coefficients since
    the clusters were made.   gradient: (K, 9).   squeezed: by so much these columns come earlier in a knot's border.
    """
    width = J.shape[2]
    lasers, size = column_of.shape[0], corner.shape[0]
    by, pull = np.empty((FEATURES, width)), np.empty(width)
    # What depends on the laser alone is summed up by lasers, and put in place once.
    force = np.zeros((lasers, FEATURES))
    common, mixed = np.zeros((lasers, FEATURES, width - 9)), np.zeros((size, size))
    for b in range(first, last):
        q, j = bins[b], laser[b]
        k, at_plane = knot[q], planes_start + 3 * plane[q]
        pull[:] = 0.0
        for f in range(FEATURES):
            w0, w1, w2, w3 = (
                np.float64(cross[b, f, 0]), np.float64(cross[b, f, 1]), np.float64(cross[b, f, 2]), np.float64(cross[b, f, 3]),
            )  # fmt: skip
            for i in range(width):
                by[f, i] = J[q, 0, i] * w0 + J[q, 1, i] * w1 + J[q, 2, i] * w2 + J[q, 3, i] * w3
            force[j, f] += w0 * a[q, 0] + w1 * a[q, 1] + w2 * a[q, 2] + w3 * a[q, 3] + cross[b, f, 4] * a[q, 4]
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
    for r in range(size):
        for c in range(size):
            corner[r, c] += mixed[r, c] + mixed[c, r]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_grams_kernel(
    grams: FloatArray, column_of: IntArray, change: FloatArray, corner: FloatArray, gradient_shared: FloatArray
) -> None:
    """Adds what the lidar's parameters share with one another. grams: (L, 8, 8) of all planes; others: add_features_kernel."""
    for j in range(grams.shape[0]):
        for t in range(TERMS):
            column, f, sign = column_of[j, TERM_COLUMN[t]], TERM_FEATURE[t], TERM_SIGN[t]
            if column < 0:
                continue
            for e in range(FEATURES):
                gradient_shared[column] += sign * grams[j, f, e] * change[j, e]
            for o in range(TERMS):
                other = column_of[j, TERM_COLUMN[o]]
                if other >= 0:
                    corner[column, other] += sign * TERM_SIGN[o] * grams[j, f, TERM_FEATURE[o]]
