"""Loops over points and clusters for the lidar's own parameters, compiled. Each has a NumPy twin in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray, LaserArray

#: Of a point: by its range, elevation, azimuth, its range's scale, its incidence, its azimuth as the encoder's eccentricity
#: moves it, sine and cosine (factors/laser_features.py).
FEATURES = 7
#: Columns of a cluster, and each one's feature: the laser's offset, elevation, azimuth and scale, everybody's offset, incidence,
#: sine and cosine.
COLUMNS = 8
OF_COLUMN = np.array([0, 1, 2, 3, 0, 4, 5, 6])


@numba.njit(cache=True, nogil=True)
def correct_kernel(
    xyz: Float32Array,
    laser: LaserArray,
    range_offset_m: FloatArray,
    range_scale: FloatArray,
    elevation_rad: FloatArray,
    azimuth_rad: FloatArray,
    eccentricity_rad: FloatArray,
    out: Float32Array,
) -> None:
    """Fills out (N, 3) with points as they would be without their laser's errors. Per laser: (L,); others stay as they are.

    eccentricity_rad: (2,) of sine and cosine of the published azimuth, of every laser.
    """
    lasers = range_offset_m.shape[0]
    sine, cosine = np.sin(elevation_rad), np.cos(elevation_rad)
    for i in range(xyz.shape[0]):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        j = laser[i]
        level2 = x * x + y * y
        r = np.sqrt(level2 + z * z)
        if j < 0 or j >= lasers or r < 1e-3:
            out[i, 0], out[i, 1], out[i, 2] = x, y, z
            continue
        factor = (r - range_offset_m[j]) / ((1.0 + range_scale[j]) * r)
        level = np.sqrt(level2)
        along = 1.0 if level < 1e-9 else (level * cosine[j] - z * sine[j]) / level
        turned = azimuth_rad[j]
        if level > 1e-9:
            turned += (eccentricity_rad[0] * y + eccentricity_rad[1] * x) / level
        aside, ahead = np.sin(turned), np.cos(turned)
        out[i, 0] = (x * ahead - y * aside) * along * factor
        out[i, 1] = (x * aside + y * ahead) * along * factor
        out[i, 2] = (z * cosine[j] + level * sine[j]) * factor


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
) -> None:
    """Adds weight f y' to cross and weight f f' to gram of (group, plane, laser), f the features, y = [x_hit, 1, d].

    cross: (G P L, 7, 5).   gram: (G P L, 7, 7).   count: (G P L,).   n_lidar: (S, P, 3) planes as each slice sees them.
    group: (S,) of each slice; R (S, 3, 3), p (S, 3) take its hits to the group's middle.   laser: (N,), from 0.
    """
    n_planes = n_lidar.shape[1]
    f, y = np.empty(FEATURES), np.empty(5)
    y[3] = 1.0
    for i in range(keep.shape[0]):
        if not keep[i] or laser[i] >= lasers:
            continue
        s, j = slice_index[i], plane[i]
        x0, x1, x2 = x_hit[i, 0], x_hit[i, 1], x_hit[i, 2]
        level = np.sqrt(x0 * x0 + x1 * x1)
        rise = 0.0 if level < 1e-9 else -x2 / level
        seen = -cosine[i]
        f[0] = seen
        f[1] = rise * (n_lidar[s, j, 0] * x0 + n_lidar[s, j, 1] * x1) + level * n_lidar[s, j, 2]
        f[2] = n_lidar[s, j, 1] * x0 - n_lidar[s, j, 0] * x1
        f[3] = seen * np.sqrt(level * level + x2 * x2)
        f[4] = 1.0 - seen
        f[5], f[6] = 0.0, 0.0
        if level > 1e-9:
            f[5], f[6] = f[2] * x1 / level, f[2] * x0 / level
        for c in range(3):
            y[c] = R[s, c, 0] * x0 + R[s, c, 1] * x1 + R[s, c, 2] * x2 + p[s, c]
        y[4] = d[i]
        b = (group[s] * n_planes + j) * lasers + laser[i]
        for m in range(FEATURES):
            w = weight[i] * f[m]
            for c in range(5):
                cross[b, m, c] += w * y[c]
            for c in range(FEATURES):
                gram[b, m, c] += w * f[c]
        count[b] += 1


@numba.njit(cache=True, nogil=True)
def add_features_kernel(
    pair: IntArray,
    knot: IntArray,
    plane: IntArray,
    laser: IntArray,
    J: FloatArray,
    a: FloatArray,
    cross: FloatArray,
    gram: FloatArray,
    column_of: IntArray,
    change: FloatArray,
    planes_start: int,
    clock_column: int,
    gradient: FloatArray,
    border: FloatArray,
    corner: FloatArray,
    gradient_shared: FloatArray,
) -> None:
    """Adds what the lidar's parameters share with everything to an arrow system, cluster by cluster.

    pair, laser: (B,).   knot, plane: (Q,) of the pairs.   J: (Q, 4, 19 or 20), a: (Q, 5) of the pairs.   cross: (B, 7, 5),
    gram: (B, 7, 7).   column_of: (L, 8) shared columns, -1 for none.   change: (L, 7) of the features' coefficients since
    the clusters were made.   gradient: (K, 9).
    """
    shared = J.shape[2] - 9
    place = np.empty(shared, np.int64)
    moved = np.empty(FEATURES)
    pull = np.empty(4)
    for b in range(pair.shape[0]):
        q, j = pair[b], laser[b]
        k = knot[q]
        for c in range(7):
            place[c] = c
        for c in range(3):
            place[7 + c] = planes_start + 3 * plane[q] + c
        if shared > 10:
            place[10] = clock_column
        for f in range(FEATURES):
            moved[f] = change[j, f]
        for m in range(4):
            pull[m] = 0.0
            for f in range(FEATURES):
                pull[m] += cross[b, f, m] * moved[f]
        for m in range(4):
            for i in range(9):
                gradient[k, i] += J[q, m, i] * pull[m]
            for c in range(shared):
                gradient_shared[place[c]] += J[q, m, 9 + c] * pull[m]
        for c in range(COLUMNS):
            column, f = column_of[j, c], OF_COLUMN[c]
            if column < 0:
                continue
            for m in range(5):
                gradient_shared[column] += cross[b, f, m] * a[q, m]
            for e in range(FEATURES):
                gradient_shared[column] += gram[b, f, e] * moved[e]
            for m in range(4):
                value = cross[b, f, m]
                for i in range(9):
                    border[k, i, column] += J[q, m, i] * value
                for e in range(shared):
                    corner[column, place[e]] += J[q, m, 9 + e] * value
                    corner[place[e], column] += J[q, m, 9 + e] * value
            for e in range(COLUMNS):
                other = column_of[j, e]
                if other >= 0:
                    corner[column, other] += gram[b, f, OF_COLUMN[e]]
