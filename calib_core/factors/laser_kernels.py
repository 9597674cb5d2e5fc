"""Loops over points for the lidar's own parameters, and over their sums, compiled. Each has a NumPy twin in the tests."""

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
#: Where walls are bent a point has as many features more: its shares of the four heights that it lies between (patches.py). Each
#: makes products with the others of the above, and with the shares from its own on.
SHARES = 4
MORE_PRODUCTS = SHARES * len(OTHERS) + SHARES * (SHARES + 1) // 2
#: Columns of a cluster, the feature to whose coefficient each adds, and how much for a unit: the laser's offset, elevation,
#: azimuth and scale, everybody's offset, incidence, sine and cosine, grazing; the surface's heights about the points, which
#: shorten distances; last the plane's material, by the incidence.
HEIGHT = 9
MATERIALS = HEIGHT + SHARES
COLUMNS = MATERIALS + 1
OF_COLUMN = np.array([0, 1, 2, 3, 0, 4, 5, 6, 7, *range(FEATURES, FEATURES + SHARES), INCIDENCE])
SIGN = np.array([1.0] * HEIGHT + [-1.0] * SHARES + [1.0])


class LaserTable(NamedTuple):
    """Errors of lasers: laser_features.LaserErrors. Each (L,), but for eccentricity_rad (2,): sine and cosine, of all."""

    range_offset_m: FloatArray
    range_scale: FloatArray
    elevation_rad: FloatArray
    azimuth_rad: FloatArray
    eccentricity_rad: FloatArray


class Clusters(NamedTuple):
    """Moments of the lasers' points, as they were made, and where their hits are now: laser_features.LaserFactors.

    bins (B,) ascending, laser (B,), cross (B, F, 5).   pose: (B,) which of R (T, 3, 3), p (T, 3) moves their hits, x -> R x + p.
    A moved moment is m' = [R, p; 0, 1] m, and m' . a = m . ([R, p; 0, 1]' a): what multiplies is moved instead, once for all
    clusters of a bin that have a pose.
    """

    bins: IntArray
    laser: IntArray
    pose: IntArray
    cross: Float32Array
    R: FloatArray
    p: FloatArray


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


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_ones(S: FloatArray, m: int, d: float, weight: float, b: int, row: int, cross: FloatArray) -> None:
    """Adds weight y' of the m-th hit of a block to a row of cluster b. S: after `places_block`."""
    cross[b, row, 0] += weight * S[PLACE + m]
    cross[b, row, 1] += weight * S[PLACE + BLOCK + m]
    cross[b, row, 2] += weight * S[PLACE + 2 * BLOCK + m]
    cross[b, row, 3] += weight
    cross[b, row, 4] += weight * d


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
    add_ones(S, m, d, weight, b, INCIDENCE, cross)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_shares(
    S: FloatArray, m: int, d: float, weight: float, share: FloatArray, b: int, cross: FloatArray, more: FloatArray
) -> None:
    """Adds to the sums of cluster b the m-th hit of a block by its shares (4,). S: after `features_block`.

    cross (B, 12, 5): weight share y', in the last four rows.   more (B, 38): weight share f' of the seven features and weight
    share share' from its own on, one share after the other.
    """
    y0, y1, y2 = S[PLACE + m], S[PLACE + BLOCK + m], S[PLACE + 2 * BLOCK + m]
    place = 0
    for r in range(SHARES):
        w = weight * share[r]
        cross[b, FEATURES + r, 0] += w * y0
        cross[b, FEATURES + r, 1] += w * y1
        cross[b, FEATURES + r, 2] += w * y2
        cross[b, FEATURES + r, 3] += w
        cross[b, FEATURES + r, 4] += w * d
        for f in range(7):
            more[b, place] += w * S[FEATURE + f * BLOCK + m]
            place += 1
        for c in range(r, SHARES):
            more[b, place] += w * share[c]
            place += 1


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def product_at(f: int, e: int, features: int) -> int:
    """Where the product of features f <= e is among those of so many: an upper triangle, row by row."""
    return f * features - (f * (f - 1)) // 2 + e - f


@numba.njit(cache=True, nogil=True, error_model="numpy")
def share_products_kernel(cross_sums: FloatArray, more_sums: FloatArray, some: IntArray, gram: Float32Array) -> None:
    """Fills the rest of the products (B, 78) from `some` (B,) of the sums of `add_shares`."""
    every = FEATURES + SHARES
    for b in range(some.shape[0]):
        s, place = some[b], 0
        for r in range(FEATURES, every):
            first = more_sums[s, place]
            for m in range(OTHERS.shape[0]):
                gram[b, product_at(OTHERS[m], r, every)] = more_sums[s, place]
                place += 1
            gram[b, product_at(INCIDENCE, r, every)] = cross_sums[s, r, 3] - first
            for c in range(r, every):
                gram[b, product_at(r, c, every)] = more_sums[s, place]
                place += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_kernel(
    cross_sums: FloatArray, gram_sums: FloatArray, some: IntArray, cross: Float32Array, gram: Float32Array
) -> None:
    """Fills moments (B, F, 5), (B, F (F + 1) / 2) from `some` (B,) of the sums of `add_features`: of 1 - f what the one's leaves.

    F: 8, or 12 with shares, whose products are not filled here.
    """
    every = cross.shape[1]
    for b in range(some.shape[0]):
        s, place = some[b], 0
        for c in range(5):
            for m in range(every):
                cross[b, m, c] = cross_sums[s, m, c]
            cross[b, INCIDENCE, c] = cross_sums[s, INCIDENCE, c] - cross_sums[s, 0, c]
        for m in range(OTHERS.shape[0]):
            row = OTHERS[m]
            low, high = min(row, INCIDENCE), max(row, INCIDENCE)
            gram[b, product_at(low, high, every)] = cross_sums[s, row, 3] - gram_sums[s, m]
            for c in range(m, OTHERS.shape[0]):
                gram[b, product_at(row, OTHERS[c], every)] = gram_sums[s, place]
                place += 1
        one, first = cross_sums[s, INCIDENCE, 3], cross_sums[s, 0, 3]
        gram[b, product_at(INCIDENCE, INCIDENCE, every)] = one - 2.0 * first + gram_sums[s, 0]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def collapse_features_kernel(
    keep: BoolArray,
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    weight: FloatArray,
    cluster: IntArray,
    n_lidar: FloatArray,
    R: FloatArray,
    p: FloatArray,
    cross: FloatArray,
    gram: FloatArray,
    share: FloatArray,
    more: FloatArray,
) -> None:
    """Adds kept hits to the sums of their clusters (N,): `add_features`, `add_shares`.

    cross: (C, 8, 5).   gram: (C, 28).   n_lidar: (S, P, 3) planes as each slice sees them.   R (S, 3, 3), p (S, 3) take its hits
    to the middle of its group.   share: (N, 4), (0, 4) where walls are flat; else cross is (C, 12, 5), and more (C, 38).
    """
    points = keep.shape[0]
    S, at, i = new_block(0), np.empty(BLOCK, np.int64), 0
    while i < points:
        s, n = slice_index[i], 0
        while i < points and n < BLOCK and slice_index[i] == s:
            if keep[i]:
                j = plane[i]
                S[X + n], S[Y + n], S[Z + n], S[COSINE + n] = x_hit[i, 0], x_hit[i, 1], x_hit[i, 2], cosine[i]
                S[NORMAL_X + n], S[NORMAL_Y + n], S[NORMAL_Z + n] = n_lidar[s, j, 0], n_lidar[s, j, 1], n_lidar[s, j, 2]
                at[n] = i
                n += 1
            i += 1
        features_block(S, n, s, R, p)
        for m in range(n):
            of = at[m]
            add_features(S, m, d[of], weight[of], cluster[of], cross, gram)
            if share.shape[0] > 0:
                add_shares(S, m, d[of], weight[of], share[of], cluster[of], cross, more)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def vector_before(c: Clusters, t: int, after: FloatArray, before: FloatArray) -> None:
    """Fills before (5,) with what gives of moments as they are what `after` (5,) gives of them moved by pose t."""
    R, p = c.R, c.p
    for i in range(3):
        before[i] = R[t, 0, i] * after[0] + R[t, 1, i] * after[1] + R[t, 2, i] * after[2]
    before[3] = p[t, 0] * after[0] + p[t, 1] * after[1] + p[t, 2] * after[2] + after[3]
    before[4] = after[4]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def rows_before(c: Clusters, t: int, after: FloatArray, before: FloatArray) -> None:
    """The same of the first four of a moment's five: (4, N) rows."""
    R, p = c.R, c.p
    for s in range(after.shape[1]):
        x, y, z = after[0, s], after[1, s], after[2, s]
        for i in range(3):
            before[i, s] = R[t, 0, i] * x + R[t, 1, i] * y + R[t, 2, i] * z
        before[3, s] = p[t, 0] * x + p[t, 1] * y + p[t, 2] * z + after[3, s]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_moved(c: Clusters, t: int, moment: FloatArray, total: FloatArray) -> None:
    """Adds the first four of a moment (4,), moved by pose t, to total (4,)."""
    R, p = c.R, c.p
    x, y, z, one = moment[0], moment[1], moment[2], moment[3]
    for i in range(3):
        total[i] += R[t, i, 0] * x + R[t, i, 1] * y + R[t, i, 2] * z + p[t, i] * one
    total[3] += one


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_ones_kernel(c: Clusters, total: FloatArray) -> None:
    """Adds to each bin's total (Q, 4) the moments of the points themselves, moved: c + (1 - c) = 1."""
    ones = np.empty(4)
    for b in range(c.bins.shape[0]):
        for i in range(4):
            ones[i] = np.float64(c.cross[b, 0, i]) + c.cross[b, INCIDENCE, i]
        add_moved(c, c.pose[b], ones, total[c.bins[b]])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sum_grams_kernel(gram: Float32Array, place: IntArray, grams: FloatArray) -> None:
    """Adds products (U, F (F + 1) / 2) to the sums at their places (U,), both ways round: grams (G, F, F)."""
    for u in range(gram.shape[0]):
        g, c = place[u], 0
        for f in range(grams.shape[1]):
            for e in range(f, grams.shape[1]):
                grams[g, f, e] += gram[u, c]
                c += 1
    for g in range(grams.shape[0]):
        for f in range(grams.shape[1]):
            for e in range(f):
                grams[g, f, e] = grams[g, e, f]
