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
def within_kernel(
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    u: FloatArray,
    origin: FloatArray,
    cell_m: float,
    half: int,
    inside: BoolArray,
    keep: BoolArray,
) -> None:
    """Takes hits outside of their plane's cells out of keep (N,). inside: (P, rows, columns); the others as in cells_kernel."""
    for i in range(plane.shape[0]):
        if not keep[i]:
            continue
        j, k = plane[i], slice_index[i]
        row, column = origin[k, j, 0], origin[k, j, 1]
        for b in range(3):
            row += u[k, j, 0, b] * x_hit[i, b]
            column += u[k, j, 1, b] * x_hit[i, b]
        r = min(max(int(np.floor(row / cell_m)) + half, 0), 2 * half - 1)
        c = min(max(int(np.floor(column / cell_m)) + half, 0), 2 * half - 1)
        keep[i] = inside[j, r, c]


@numba.njit(cache=True, nogil=True)
def select_kernel(
    plane: IntArray,
    d: FloatArray,
    cosine: FloatArray,
    ambiguous_m: FloatArray,
    extra_of_plane_m: FloatArray,
    range_std_m: float,
    surface_std_m: float,
    sigmas: float,
    margin_m: float,
    robust_sigmas: float,
    extra_stds: float,
    keep: BoolArray,
    weight: FloatArray,
) -> None:
    """Fills keep and weight [1/m^2], (N,) each, of hits. extra_of_plane_m: (P,) room in the gates; below zero none is kept."""
    for i in range(plane.shape[0]):
        j = plane[i]
        keep[i] = False
        weight[i] = 0.0
        if j < 0:
            continue
        extra = extra_of_plane_m[j]
        variance = (range_std_m * cosine[i]) ** 2 + surface_std_m**2
        std = np.sqrt(variance)
        if extra < 0.0 or not abs(d[i]) < sigmas * std + extra or not ambiguous_m[i] > margin_m:
            continue
        keep[i] = True
        shortfall = max(1.0 - (d[i] / (robust_sigmas * std + extra)) ** 2, 0.0)
        weight[i] = shortfall**2 / (variance + (extra / extra_stds) ** 2)


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


@numba.njit(cache=True, nogil=True, inline="always")
def _cell(value_m: float, cell_m: float, width: int) -> int:
    """Row or column of an in-plane coordinate in a grid `width` cells wide about the origin; the rim takes what is beyond."""
    return min(max(int(np.floor(value_m / cell_m)) + width // 2, 0), width - 1)


@numba.njit(cache=True, nogil=True)
def _nearest(
    x_map: FloatArray,
    x2: float,
    y2: float,
    z2: float,
    n_lidar: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    reach: BoolArray,
    cell_m: float,
    outside_m: float,
) -> tuple[int, float, float, bool]:
    """The plane a point lies on, its signed distance, that with what being off the plane costs, whether it is not off."""
    width = reach.shape[1]
    best, distance, apart, within = -1, np.inf, np.inf, False
    for j in range(normals.shape[0]):
        if n_lidar[j, 0] * x2 + n_lidar[j, 1] * y2 + n_lidar[j, 2] * z2 > 0:
            continue
        value = offsets[j] + normals[j, 0] * x_map[0] + normals[j, 1] * x_map[1] + normals[j, 2] * x_map[2]
        if abs(value) >= apart:
            continue
        u = axes[j, 0, 0] * x_map[0] + axes[j, 0, 1] * x_map[1] + axes[j, 0, 2] * x_map[2]
        w = axes[j, 1, 0] * x_map[0] + axes[j, 1, 1] * x_map[1] + axes[j, 1, 2] * x_map[2]
        on = reach[j, _cell(u, cell_m, width), _cell(w, cell_m, width)]
        far = abs(value) if on else abs(value) + outside_m
        if far < apart:
            best, distance, apart, within = j, value, far, on
    return best, distance, apart, within


@numba.njit(cache=True, nogil=True)
def _unfold(sums: FloatArray, hessian: FloatArray) -> None:
    """Adds sums of w r r', w t r r', w t^2 r r' (3, 21), upper triangles, to the upper triangle of (12, 12) of [r, t r]."""
    place = 0
    for a in range(6):
        for b in range(a, 6):
            hessian[a, b] += sums[0, place]
            hessian[a, 6 + b] += sums[1, place]
            if a != b:
                hessian[b, 6 + a] += sums[1, place]
            hessian[6 + a, 6 + b] += sums[2, place]
            place += 1


@numba.njit(cache=True, nogil=True)
def _owner(x: FloatArray, normals: FloatArray, offsets: FloatArray, eye: FloatArray, near_m: float) -> int:
    """The plane nearest to a point, seen from its front, within near_m; -1 for none."""
    owner, nearest = -1, near_m
    for j in range(normals.shape[0]):
        value = offsets[j] + normals[j, 0] * x[0] + normals[j, 1] * x[1] + normals[j, 2] * x[2]
        eye_at = offsets[j] + normals[j, 0] * eye[0] + normals[j, 1] * eye[1] + normals[j, 2] * eye[2]
        if value < eye_at and abs(value) < nearest:
            nearest = abs(value)
            owner = j
    return owner


@numba.njit(cache=True, nogil=True)
def register_kernel(
    points: FloatArray,
    tau: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    reach: BoolArray,
    worth: FloatArray,
    cell_m: float,
    outside_m: float,
    R: FloatArray,
    p: FloatArray,
    omega: FloatArray,
    v: FloatArray,
    scale: float,
    hessian: FloatArray,
    gradient: FloatArray,
    d: FloatArray,
    plane: IntArray,
    inside: BoolArray,
) -> None:
    """Adds one scan's normal equations (12, 12), (12,) of point-to-plane distances under a constant-velocity sweep.

    axes: (P, 2, 3) within the planes, map.   reach: (P, W, W) cells of each plane; a point off them counts as outside_m
    further away, in the choice of its plane and in its weight.   worth: (P,) factors of the weights of planes.   Fills
    d (N,), plane (N,), -1 where a point is seen from behind every plane, and inside (N,). An empty hessian (0, 0)
    leaves the equations out. The rotation within the sweep is taken to second order.
    """
    n_lidar = normals @ R
    row = np.empty(6)
    sums = np.zeros((3, 21))
    x_map = np.empty(3)
    for i in range(points.shape[0]):
        t = tau[i]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        cx, cy, cz = omega[1] * z - omega[2] * y, omega[2] * x - omega[0] * z, omega[0] * y - omega[1] * x
        x2 = x + t * cx + 0.5 * t * t * (omega[1] * cz - omega[2] * cy)
        y2 = y + t * cy + 0.5 * t * t * (omega[2] * cx - omega[0] * cz)
        z2 = z + t * cz + 0.5 * t * t * (omega[0] * cy - omega[1] * cx)
        for a in range(3):
            x_map[a] = R[a, 0] * x2 + R[a, 1] * y2 + R[a, 2] * z2 + p[a] + t * v[a]
        best, distance, apart, within = _nearest(
            x_map, x2, y2, z2, n_lidar, normals, offsets, axes, reach, cell_m, outside_m
        )
        plane[i] = best
        d[i] = distance
        inside[i] = within
        if best < 0 or hessian.shape[0] == 0:
            continue
        weight = worth[best] / (1.0 + (apart / scale) ** 2) ** 2
        m0, m1, m2 = n_lidar[best, 0], n_lidar[best, 1], n_lidar[best, 2]
        row[0], row[1], row[2] = y2 * m2 - z2 * m1, z2 * m0 - x2 * m2, x2 * m1 - y2 * m0
        row[3], row[4], row[5] = normals[best, 0], normals[best, 1], normals[best, 2]
        # The rates' rows are the pose's times t: three 6 x 6 sums make the whole.
        place = 0
        for a in range(6):
            pull = weight * row[a]
            gradient[a] += pull * distance
            gradient[6 + a] += t * pull * distance
            for b in range(a, 6):
                product = pull * row[b]
                sums[0, place] += product
                sums[1, place] += t * product
                sums[2, place] += t * t * product
                place += 1
    if hessian.shape[0] > 0:
        _unfold(sums, hessian)


@numba.njit(cache=True, nogil=True)
def spread_kernel(
    x_map: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    reach: BoolArray,
    cell_m: float,
    near_m: float,
    eye: FloatArray,
    passes: int,
) -> None:
    """Lets planes reach on: a point near a plane, in a cell that it reaches, adds that cell's neighbours; in `passes` rounds.

    x_map: (N, 3) map.   eye: (3,) from where they were seen.   reach: (P, W, W), changed.   A point speaks for the plane
    nearest to it alone. Far away rings are wide apart: one more cell every 20 cells of range.
    """
    width = reach.shape[1]
    n = x_map.shape[0]
    near = np.empty(n, np.int64)
    owner = np.full(n, -1, np.int64)
    row = np.empty(n, np.int64)
    column = np.empty(n, np.int64)
    for i in range(n):
        x, y, z = x_map[i, 0], x_map[i, 1], x_map[i, 2]
        away = np.sqrt((x - eye[0]) ** 2 + (y - eye[1]) ** 2 + (z - eye[2]) ** 2)
        near[i] = 1 + int(away / (20.0 * cell_m))
        owner[i] = _owner(x_map[i], normals, offsets, eye, near_m + 0.003 * away)
        j = owner[i]
        if j >= 0:
            row[i] = _cell(axes[j, 0, 0] * x + axes[j, 0, 1] * y + axes[j, 0, 2] * z, cell_m, width)
            column[i] = _cell(axes[j, 1, 0] * x + axes[j, 1, 1] * y + axes[j, 1, 2] * z, cell_m, width)
    for _ in range(passes):
        changed = False
        for i in range(n):
            j = owner[i]
            if j < 0 or not reach[j, row[i], column[i]]:
                continue
            k = near[i]
            for r in range(max(row[i] - k, 0), min(row[i] + k + 1, width)):
                for c in range(max(column[i] - k, 0), min(column[i] + k + 1, width)):
                    if not reach[j, r, c]:
                        reach[j, r, c] = True
                        changed = True
            owner[i] = -1
        if not changed:
            break


@numba.njit(cache=True, nogil=True)
def straighten_kernel(
    points: FloatArray,
    tau: FloatArray,
    R: FloatArray,
    p: FloatArray,
    omega: FloatArray,
    v: FloatArray,
    x_map: FloatArray,
) -> None:
    """Fills x_map (N, 3) with a scan's points in the map frame, turned within the sweep to second order."""
    for i in range(points.shape[0]):
        t = tau[i]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        cx, cy, cz = omega[1] * z - omega[2] * y, omega[2] * x - omega[0] * z, omega[0] * y - omega[1] * x
        x2 = x + t * cx + 0.5 * t * t * (omega[1] * cz - omega[2] * cy)
        y2 = y + t * cy + 0.5 * t * t * (omega[2] * cx - omega[0] * cz)
        z2 = z + t * cz + 0.5 * t * t * (omega[0] * cy - omega[1] * cx)
        for a in range(3):
            x_map[i, a] = R[a, 0] * x2 + R[a, 1] * y2 + R[a, 2] * z2 + p[a] + t * v[a]
