"""Loops over single points, compiled. Each has a plain NumPy twin in the tests and does nothing that the twin does not.

Why compiled: a minute of recording is seventeen million points, and a handful of multiplications on each is all there
is to do. Compiled code is kept beside this file, so that only a machine's first run pays for the compiler.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray


@numba.njit(cache=True, nogil=True)
def hits_kernel(
    xyz: Float32Array,
    offset_s: FloatArray,
    slice_s: float,
    n_lidar: FloatArray,
    w_lidar: FloatArray,
    omega: FloatArray,
    v: FloatArray,
    usable: BoolArray,
    min_cosine: float,
    min_azimuth_cosine: float,
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    beside: FloatArray,
) -> None:
    """Fills plane (-1: none), slice_index, x_hit (N, 3), d, cosine, beside (N,) for points xyz (N, 3) at offset_s (N,).

    n_lidar: (S, P, 3), w_lidar: (S, P): the planes as seen by the lidar at each slice's centre.   omega, v: (S, 3), lidar
    axes.   min_azimuth_cosine: of the azimuth's cosine, -2 for all.
    """
    n_planes = n_lidar.shape[1]
    D = np.empty(n_planes)
    C = np.empty(n_planes)
    for i in range(xyz.shape[0]):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        k = int(offset_s[i] / slice_s)
        plane[i] = -1
        slice_index[i] = k
        r2 = x * x + y * y + z * z
        if r2 < 1e-6 or not usable[k]:
            continue
        if min_azimuth_cosine > -1.5 and x < min_azimuth_cosine * np.sqrt(x * x + y * y):
            continue
        t = offset_s[i] - (k + 0.5) * slice_s
        wx, wy, wz = omega[k, 0], omega[k, 1], omega[k, 2]
        tx = x + t * (wy * z - wz * y)
        ty = y + t * (wz * x - wx * z)
        tz = z + t * (wx * y - wy * x)
        r = np.sqrt(r2)
        best = -1
        error = np.inf
        for j in range(n_planes):
            nx, ny, nz = n_lidar[k, j, 0], n_lidar[k, j, 1], n_lidar[k, j, 2]
            along = nx * tx + ny * ty + nz * tz
            C[j] = along / r
            D[j] = along + t * (nx * v[k, 0] + ny * v[k, 1] + nz * v[k, 2]) + w_lidar[k, j]
            if C[j] < -min_cosine and abs(D[j] / C[j]) < abs(error):
                error = D[j] / C[j]
                best = j
        if best < 0:
            continue
        plane[i] = best
        d[i] = D[best]
        cosine[i] = C[best]
        x_hit[i, 0] = tx + t * v[k, 0] - error * tx / r
        x_hit[i, 1] = ty + t * v[k, 1] - error * ty / r
        x_hit[i, 2] = tz + t * v[k, 2] - error * tz / r
        nearest = np.inf
        for j in range(n_planes):
            if j != best:
                nearest = min(nearest, abs(D[j] - error * C[j]))
        beside[i] = nearest


@numba.njit(cache=True, nogil=True)
def cells_kernel(
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    u: FloatArray,
    origin: FloatArray,
    cell_m: float,
    half: int,
    cell: IntArray,
) -> None:
    """Fills cell (N, 2): row and column of each hit in its plane's grid, -1 where plane is -1.

    u: (S, P, 2, 3) the planes' in-plane axes seen from the lidar; origin: (S, P, 2) the lidar's in-plane coordinates.
    """
    for i in range(plane.shape[0]):
        j, k = plane[i], slice_index[i]
        cell[i, 0] = -1
        cell[i, 1] = -1
        if j < 0:
            continue
        for a in range(2):
            value = origin[k, j, a]
            for b in range(3):
                value += u[k, j, a, b] * x_hit[i, b]
            index = int(np.floor(value / cell_m)) + half
            cell[i, a] = min(max(index, 0), 2 * half - 1)


@numba.njit(cache=True, nogil=True)
def collapse_kernel(
    keep: BoolArray,
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    weight: FloatArray,
    n_planes: int,
    scatter: FloatArray,
    count: IntArray,
) -> None:
    """Adds weight y y', y = [x_hit, 1, d], upper triangle row by row, to scatter[(slice, plane)] (S P, 15), and counts."""
    y = np.empty(5)
    y[3] = 1.0
    for i in range(keep.shape[0]):
        if not keep[i]:
            continue
        y[0], y[1], y[2], y[4] = x_hit[i, 0], x_hit[i, 1], x_hit[i, 2], d[i]
        b = slice_index[i] * n_planes + plane[i]
        place = 0
        for row in range(5):
            for column in range(row, 5):
                scatter[b, place] += weight[i] * y[row] * y[column]
                place += 1
        count[b] += 1


@numba.njit(cache=True, nogil=True)
def register_kernel(
    points: FloatArray,
    tau: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    R: FloatArray,
    p: FloatArray,
    omega: FloatArray,
    v: FloatArray,
    scale: float,
    hessian: FloatArray,
    gradient: FloatArray,
    d: FloatArray,
    plane: IntArray,
) -> None:
    """Adds one scan's normal equations (12, 12), (12,) of point-to-plane distances under a constant-velocity sweep.

    Fills d (N,) and plane (N,), -1 where a point is seen from behind every plane. The rotation within the sweep is taken
    to second order.
    """
    n_lidar = normals @ R
    row = np.empty(12)
    for i in range(points.shape[0]):
        t = tau[i]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        cx, cy, cz = omega[1] * z - omega[2] * y, omega[2] * x - omega[0] * z, omega[0] * y - omega[1] * x
        x2 = x + t * cx + 0.5 * t * t * (omega[1] * cz - omega[2] * cy)
        y2 = y + t * cy + 0.5 * t * t * (omega[2] * cx - omega[0] * cz)
        z2 = z + t * cz + 0.5 * t * t * (omega[0] * cy - omega[1] * cx)
        best = -1
        distance = np.inf
        for j in range(normals.shape[0]):
            along = n_lidar[j, 0] * x2 + n_lidar[j, 1] * y2 + n_lidar[j, 2] * z2
            if along > 0:
                continue
            value = along + offsets[j]
            for a in range(3):
                value += normals[j, a] * (p[a] + t * v[a])
            if abs(value) < abs(distance):
                distance = value
                best = j
        plane[i] = best
        d[i] = distance
        if best < 0:
            continue
        weight = 1.0 / (1.0 + (distance / scale) ** 2) ** 2
        m0, m1, m2 = n_lidar[best, 0], n_lidar[best, 1], n_lidar[best, 2]
        row[0], row[1], row[2] = y2 * m2 - z2 * m1, z2 * m0 - x2 * m2, x2 * m1 - y2 * m0
        for a in range(3):
            row[3 + a] = normals[best, a]
            row[6 + a] = t * row[a]
            row[9 + a] = t * normals[best, a]
        for a in range(12):
            gradient[a] += weight * row[a] * distance
            for b in range(a, 12):
                hessian[a, b] += weight * row[a] * row[b]
