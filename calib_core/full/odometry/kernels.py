"""Loops of the lidar-only tracker over a scan's points, compiled, and its iterated least squares. Twins in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.factors.cell_kernels import cell_of
from calib_core.geometry.compiled import exp_into, log_of
from calib_core.types import BoolArray, FloatArray, IntArray


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
        on = reach[j, cell_of(u, cell_m, width), cell_of(w, cell_m, width)]
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
def _turned_within(x: float, y: float, z: float, t: float, omega: FloatArray) -> tuple[float, float, float]:
    """A point seen so long after its sweep's begin, in the lidar's axes at the begin, to second order of the turn."""
    cx, cy, cz = omega[1] * z - omega[2] * y, omega[2] * x - omega[0] * z, omega[0] * y - omega[1] * x
    return (
        x + t * cx + 0.5 * t * t * (omega[1] * cz - omega[2] * cy),
        y + t * cy + 0.5 * t * t * (omega[2] * cx - omega[0] * cz),
        z + t * cz + 0.5 * t * t * (omega[0] * cy - omega[1] * cx),
    )


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
        x2, y2, z2 = _turned_within(x, y, z, t, omega)
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
def descend_kernel(
    points: FloatArray,
    tau: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    reach: BoolArray,
    cell_m: float,
    outside_m: float,
    scales_m: FloatArray,
    tie: FloatArray,
    most: float,
    least: int,
    R: FloatArray,
    p: FloatArray,
    omega: FloatArray,
    v: FloatArray,
) -> None:
    """Moves R, p, omega, v from a predicted motion to where the points want them: one damped step a scale.

    tie: (12,) weight of the prediction, rotation, position, rate, velocity.   most: points that a plane counts for at the
    most, and none with fewer than `least` within twice the scale.   Others: register_kernel.
    """
    n, planes = points.shape[0], normals.shape[0]
    R0, p0, omega0, v0 = R.copy(), p.copy(), omega.copy(), v.copy()
    d, plane, inside = np.empty(n), np.empty(n, np.int64), np.empty(n, np.bool_)
    worth, count = np.ones(planes), np.empty(planes)
    away, turn = np.empty(12), np.empty((3, 3))
    for scale in scales_m:
        hessian, gradient = np.zeros((12, 12)), np.zeros(12)
        register_kernel(
            points, tau, normals, offsets, axes, reach, worth, cell_m, outside_m, R, p, omega, v, scale, hessian, gradient,
            d, plane, inside,
        )  # fmt: skip
        count[:] = 0.0
        for i in range(n):
            if plane[i] >= 0 and inside[i] and abs(d[i]) < 2.0 * scale:
                count[plane[i]] += 1.0
        for j in range(planes):
            worth[j] = 0.0 if count[j] < least else 1.0 / (1.0 + count[j] / most)
        away[:3] = log_of(R0.T @ R)  # a prediction is never wrong by half a turn
        away[3:6], away[6:9], away[9:] = p - p0, omega - omega0, v - v0
        for a in range(12):
            for b in range(a):
                hessian[a, b] = hessian[b, a]
            hessian[a, a] += tie[a]
            gradient[a] += tie[a] * away[a]
        step = -np.linalg.solve(hessian, gradient)
        exp_into(step[0], step[1], step[2], turn)
        R[:] = R @ turn
        p += step[3:6]
        omega += step[6:9]
        v += step[9:]


@numba.njit(cache=True, nogil=True)
def spread_kernel(
    x_map: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    reach: BoolArray,
    cell_m: float,
    near_m: float,
    near_per_m: float,
    widen_cells: float,
    eye: FloatArray,
    passes: int,
) -> None:
    """Lets planes reach on: a point near a plane, in a cell that it reaches, adds that cell's neighbours; in `passes` rounds.

    x_map: (N, 3) map.   eye: (3,) from where they were seen.   reach: (P, W, W), changed.   A point speaks for the plane
    nearest to it alone. Far away rings are wide apart: one more cell every `widen_cells` cells of range.
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
        near[i] = 1 + int(away / (widen_cells * cell_m))
        owner[i] = _owner(x_map[i], normals, offsets, eye, near_m + near_per_m * away)
        j = owner[i]
        if j >= 0:
            row[i] = cell_of(axes[j, 0, 0] * x + axes[j, 0, 1] * y + axes[j, 0, 2] * z, cell_m, width)
            column[i] = cell_of(axes[j, 1, 0] * x + axes[j, 1, 1] * y + axes[j, 1, 2] * z, cell_m, width)
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
        x2, y2, z2 = _turned_within(x, y, z, t, omega)
        for a in range(3):
            x_map[i, a] = R[a, 0] * x2 + R[a, 1] * y2 + R[a, 2] * z2 + p[a] + t * v[a]
