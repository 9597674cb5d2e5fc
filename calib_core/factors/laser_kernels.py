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
#: Where walls are bent a point has as many features more: its shares of the four heights that it lies between (patches.py). Each
#: makes products with the others of the above, and with the shares from its own on.
SHARES = 4
MORE_PRODUCTS = SHARES * len(OTHERS) + SHARES * (SHARES + 1) // 2
#: Columns of a cluster, the feature to whose coefficient each adds, and how much for a unit: the laser's offset, elevation,
#: azimuth and scale, everybody's offset, incidence, sine and cosine, grazing; last the surface's heights about the points, which
#: shorten distances.
HEIGHT = 9
COLUMNS = HEIGHT + SHARES
OF_COLUMN = np.array([0, 1, 2, 3, 0, 4, 5, 6, 7, *range(FEATURES, FEATURES + SHARES)])
SIGN = np.array([1.0] * HEIGHT + [-1.0] * SHARES)
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


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_ones(S: FloatArray, m: int, d: float, weight: float, b: int, cross: FloatArray) -> None:
    """Adds weight y' of the m-th hit of a block to the incidence's row of cluster b. S: after `places_block`."""
    cross[b, INCIDENCE, 0] += weight * S[PLACE + m]
    cross[b, INCIDENCE, 1] += weight * S[PLACE + BLOCK + m]
    cross[b, INCIDENCE, 2] += weight * S[PLACE + 2 * BLOCK + m]
    cross[b, INCIDENCE, 3] += weight
    cross[b, INCIDENCE, 4] += weight * d


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
    add_ones(S, m, d, weight, b, cross)


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
    """Adds moments (B, F, 5) to those at their places, with their hits moved by x -> R x + p of their pose.

    use: (U,) which of them, pose, place: (U,) each one's pose and place.   R: (T, 3, 3), p: (T, 3).
    """
    for u in range(use.shape[0]):
        b, t, k = use[u], pose[u], place[u]
        # Read once: what is written to the sums might be the pose, for all that a compiler knows.
        r00, r01, r02, p0 = R[t, 0, 0], R[t, 0, 1], R[t, 0, 2], p[t, 0]
        r10, r11, r12, p1 = R[t, 1, 0], R[t, 1, 1], R[t, 1, 2], p[t, 1]
        r20, r21, r22, p2 = R[t, 2, 0], R[t, 2, 1], R[t, 2, 2], p[t, 2]
        for f in range(cross.shape[1]):
            x0, x1, x2, one = cross[b, f, 0], cross[b, f, 1], cross[b, f, 2], cross[b, f, 3]
            total_cross[k, f, 0] += r00 * x0 + r01 * x1 + r02 * x2 + p0 * one
            total_cross[k, f, 1] += r10 * x0 + r11 * x1 + r12 * x2 + p1 * one
            total_cross[k, f, 2] += r20 * x0 + r21 * x1 + r22 * x2 + p2 * one
            total_cross[k, f, 3] += one
            total_cross[k, f, 4] += cross[b, f, 4]


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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_crossed_kernel(
    bins: IntArray, laser: IntArray, a: FloatArray, cross: FloatArray, change: FloatArray, crossed: FloatArray
) -> None:
    """Fills crossed (B,) with sum w (f . change) (y . a) of each cluster. a: (Q, 5) of the bins.   change: (L, F)."""
    for b in range(bins.shape[0]):
        q, j = bins[b], laser[b]
        total = 0.0
        for f in range(cross.shape[1]):
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

    bins, laser: (B,), clusters of one bin in a row.   knot, plane: (Q,) of the bins.   J: (Q, 4, 19 or 20), a: (Q, 5) of the
    bins.   cross: (B, F, 5).   column_of: (L, 13) shared columns, -1 for none.   change: (L, F) of the features' coefficients
    since the clusters were made.   gradient: (K, 9).   squeezed: by so much these columns come earlier in a knot's border.

    What all clusters of a bin say of one column is the same four numbers times the bin's J. They are laid side by side first, a
    row for each of the four: what is then multiplied runs along memory, through stretches of columns that any cluster touches.
    """
    width, size = J.shape[2], corner.shape[0]
    start, end = _between_columns(column_of, size)
    columns = end - start
    moments, touched = np.zeros((5, columns)), np.zeros(columns, np.bool_)
    begins, ends, u = np.empty(columns + 1, np.int64), np.empty(columns + 1, np.int64), np.empty(4)
    # What all bins, or those of a plane, say of shared columns is summed up by itself, and put in place once.
    common = np.zeros((COLUMNS_SEEN - 11, columns))
    by_plane = np.zeros((3 * (plane.max() + 1 if plane.shape[0] > 0 else 0), columns))
    force = np.zeros(columns)
    b = first
    while b < last:
        q = bins[b]
        k, at_plane = knot[q], 3 * plane[q]
        u[:] = 0.0
        while b < last and bins[b] == q:
            _lay_beside(cross, b, column_of, change, laser[b], start, moments, touched, u)
            b += 1
        for i in range(width):
            pull = J[q, 0, i] * u[0] + J[q, 1, i] * u[1] + J[q, 2, i] * u[2] + J[q, 3, i] * u[3]
            if i < 9:
                gradient[k, i] += pull
            elif i < 16:
                gradient_shared[i - 9] += pull
            else:
                gradient_shared[planes_start + at_plane + i - 16 if i < COLUMNS_SEEN else clock_column] += pull
        for s in range(_runs(touched, begins, ends)):
            begin, stop = begins[s], ends[s]
            m0, m1, m2, m3, m4 = (
                moments[0, begin:stop], moments[1, begin:stop], moments[2, begin:stop], moments[3, begin:stop],
                moments[4, begin:stop],
            )  # fmt: skip
            here = start - squeezed
            for i in range(width):
                if i < 9:
                    row = border[k, i, here + begin : here + stop]
                elif 16 <= i < COLUMNS_SEEN:
                    row = by_plane[at_plane + i - 16, begin:stop]
                else:
                    row = common[i - 9 if i < 16 else 7, begin:stop]
                _add_product(row, J[q, 0, i], J[q, 1, i], J[q, 2, i], J[q, 3, i], m0, m1, m2, m3)
            _add_product(force[begin:stop], a[q, 0], a[q, 1], a[q, 2], a[q, 3], m0, m1, m2, m3)
            _end_run(force[begin:stop], a[q, 4], m0, m1, m2, m3, m4, touched[begin:stop])
    for c in range(columns):
        gradient_shared[start + c] += force[c]
    for at in range(common.shape[0] if width > COLUMNS_SEEN else 7):
        _put_beside(at if at < 7 else clock_column, common, at, start, corner)
    for at in range(by_plane.shape[0]):
        _put_beside(planes_start + at, by_plane, at, start, corner)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _between_columns(column_of: IntArray, size: int) -> tuple[int, int]:
    """The first of the columns that any laser has, and one beyond the last. size: of all shared ones."""
    start, end = size, 0
    for j in range(column_of.shape[0]):
        for t in range(column_of.shape[1]):
            if column_of[j, t] >= 0:
                start, end = min(start, column_of[j, t]), max(end, column_of[j, t] + 1)
    return min(start, end), end


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _add_product(
    row: FloatArray,
    j0: float,
    j1: float,
    j2: float,
    j3: float,
    m0: FloatArray,
    m1: FloatArray,
    m2: FloatArray,
    m3: FloatArray,
) -> None:
    """Adds a combination of four rows (C,) to one. Each in memory by itself: then a processor does several at a time."""
    for c in range(row.shape[0]):
        row[c] += j0 * m0[c] + j1 * m1[c] + j2 * m2[c] + j3 * m3[c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _end_run(
    force: FloatArray,
    a4: float,
    m0: FloatArray,
    m1: FloatArray,
    m2: FloatArray,
    m3: FloatArray,
    m4: FloatArray,
    touched: BoolArray,
) -> None:
    """Adds a4 times the fifth row to force (C,), and makes room for the next bin."""
    for c in range(force.shape[0]):
        force[c] += a4 * m4[c]
        m0[c] = m1[c] = m2[c] = m3[c] = m4[c] = 0.0
        touched[c] = False


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _lay_beside(
    cross: FloatArray,
    b: int,
    column_of: IntArray,
    change: FloatArray,
    j: int,
    start: int,
    moments: FloatArray,
    touched: BoolArray,
    u: FloatArray,
) -> None:
    """Adds cluster b of laser j to moments (5, C) by column, counted from `start`, and to u (4,) as the lasers have changed."""
    for f in range(cross.shape[1]):
        moved = change[j, f]
        if moved != 0.0:
            for c in range(4):
                u[c] += moved * cross[b, f, c]
    for t in range(COLUMNS):
        column = column_of[j, t] - start
        if column >= 0:
            touched[column] = True
            f, sign = OF_COLUMN[t], SIGN[t]
            for c in range(5):
                moments[c, column] += sign * cross[b, f, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _runs(touched: BoolArray, begins: IntArray, ends: IntArray) -> int:
    """Fills begins and ends with the stretches of columns that are touched, and nothing between: others fill those meanwhile."""
    runs, before = 0, False
    for c in range(touched.shape[0]):
        if touched[c] and not before:
            begins[runs] = c
        if before and not touched[c]:
            ends[runs] = c
            runs += 1
        before = touched[c]
    if before:
        ends[runs] = touched.shape[0]
        runs += 1
    return runs


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_beside(row: int, sums: FloatArray, of: int, start: int, corner: FloatArray) -> None:
    """Adds one row of sums (R, C) to a row and a column of the corner, the columns counted from `start`."""
    for c in range(sums.shape[1]):
        corner[row, start + c] += sums[of, c]
        corner[start + c, row] += sums[of, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_grams_kernel(
    grams: FloatArray,
    laser: IntArray,
    column_of: IntArray,
    change: FloatArray,
    corner: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds what the lidar's parameters share with one another. grams: (G, F, F), laser: (G,); others: add_features_kernel."""
    for g in range(grams.shape[0]):
        j = laser[g]
        for t in range(COLUMNS):
            column, f, sign = column_of[j, t], OF_COLUMN[t], SIGN[t]
            if column < 0:
                continue
            for e in range(grams.shape[2]):
                gradient_shared[column] += sign * grams[g, f, e] * change[j, e]
            for o in range(COLUMNS):
                other = column_of[j, o]
                if other >= 0:
                    corner[column, other] += sign * SIGN[o] * grams[g, f, OF_COLUMN[o]]
