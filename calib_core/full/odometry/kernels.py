"""Loops of the lidar-only tracker over a scan's points, compiled: one registration from end to end. Twins in the tests."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from calib_core.factors.cell_kernels import cell_of
from calib_core.geometry.compiled import exp_into, log_into
from calib_core.types import BoolArray, FloatArray, IntArray

#: Points whose products are laid in rows before these are added up: all of it stays in the nearest cache.
BLOCK = 32
#: Numbers of a row that holds an upper triangle of (6, 6), 21 of them: whole registers.
_ROW = 24


class Surfaces(NamedTuple):
    """Planes n . x + w = 0 in the map with the cells of them that are known.

    normals: (P, 3).   offsets: (P,).   axes: (P, 2, 3) within the planes.   reach: (P, W, W).   outside_m: a point off the
    known cells counts as so much further away, in the choice of its plane and in its weight.
    """

    normals: FloatArray
    offsets: FloatArray
    axes: FloatArray
    reach: BoolArray
    cell_m: float
    outside_m: float


class Motion(NamedTuple):
    """R (3, 3), p (3,): map <- lidar at the scan's start.   omega: (3,) lidar axes.   v: (3,) map axes."""

    R: FloatArray
    p: FloatArray
    omega: FloatArray
    v: FloatArray


class Seen(NamedTuple):
    """What points are seen as. plane: (N,), -1 where a point is seen from behind every plane.   d: (N,) signed distance.

    far: (N,) that with what being off the plane's cells costs.   inside: (N,) whether it is not off.   turned: (N, 3) lidar
    axes at the scan's start.   x_map: (N, 3).
    """

    plane: IntArray
    d: FloatArray
    far: FloatArray
    inside: BoolArray
    turned: FloatArray
    x_map: FloatArray


class Counting(NamedTuple):
    """What points count for. points: that take part in the least squares.   plane, sure: points that a plane counts for at
    the most, in the least squares and in the judgement.   least: fewer than so many on a plane do not count; in the judgement,
    twice as many.   inlier_m: as near a point lies on its plane.
    """

    points: int
    plane: float
    sure: float
    least: int
    inlier_m: float


def room(n: int) -> Seen:
    """To see so many points in."""
    plane, inside = np.empty(n, np.int64), np.empty(n, np.bool_)
    return Seen(plane, np.empty(n), np.empty(n), inside, np.empty((n, 3)), np.empty((n, 3)))


#: The same for compiled loops. None may hand a record back to Python: making it there calls its class, in which a signal may be
#: answered, and the compiled side does not look whether that went well.
room_for = numba.njit(cache=True, nogil=True, error_model="numpy")(room)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _value(j: int, x: float, y: float, z: float, s: Surfaces) -> float:
    """Signed distance of a point from a plane."""
    return s.offsets[j] + s.normals[j, 0] * x + s.normals[j, 1] * y + s.normals[j, 2] * z


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _reaches(j: int, x: float, y: float, z: float, s: Surfaces) -> bool:
    """Whether a plane's known cells hold a point."""
    width = s.reach.shape[1]
    u = s.axes[j, 0, 0] * x + s.axes[j, 0, 1] * y + s.axes[j, 0, 2] * z
    w = s.axes[j, 1, 0] * x + s.axes[j, 1, 1] * y + s.axes[j, 1, 2] * z
    return s.reach[j, cell_of(u, s.cell_m, width), cell_of(w, s.cell_m, width)]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _behind(j: int, x: float, y: float, z: float, n_lidar: FloatArray) -> bool:
    """Whether a ray comes upon a plane from behind."""
    return n_lidar[j, 0] * x + n_lidar[j, 1] * y + n_lidar[j, 2] * z > 0


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _nearest(
    x: float, y: float, z: float, x2: float, y2: float, z2: float, s: Surfaces, n_lidar: FloatArray
) -> tuple[int, float, float, bool]:
    """The plane of a point (x, y, z), on the ray (x2, y2, z2): the first of those for which it is the least far."""
    best, distance, apart, within = -1, np.inf, np.inf, False
    for j in range(s.normals.shape[0]):
        value = _value(j, x, y, z, s)
        if not abs(value) < apart or _behind(j, x2, y2, z2, n_lidar):
            continue
        on = _reaches(j, x, y, z, s)
        far = abs(value) if on else abs(value) + s.outside_m
        if far < apart:
            best, distance, apart, within = j, value, far, on
    return best, distance, apart, within


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _turned_within(x: float, y: float, z: float, t: float, omega: FloatArray) -> tuple[float, float, float]:
    """A point seen so long after its sweep's begin, in the lidar's axes at the begin, to second order of the turn."""
    cx, cy, cz = omega[1] * z - omega[2] * y, omega[2] * x - omega[0] * z, omega[0] * y - omega[1] * x
    return (
        x + t * cx + 0.5 * t * t * (omega[1] * cz - omega[2] * cy),
        y + t * cy + 0.5 * t * t * (omega[2] * cx - omega[0] * cz),
        z + t * cz + 0.5 * t * t * (omega[0] * cy - omega[1] * cx),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _in_map(
    x: float, y: float, z: float, t: float, R: FloatArray, p: FloatArray, v: FloatArray
) -> tuple[float, float, float]:
    """The same point in the map."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + p[0] + t * v[0],
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + p[1] + t * v[1],
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + p[2] + t * v[2],
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def straighten_kernel(points: FloatArray, tau: FloatArray, at: Motion, x_map: FloatArray) -> None:
    """Fills x_map (N, 3) with a scan's points in the map frame, turned within the sweep to second order."""
    R, p, omega, v = at
    for i in range(points.shape[0]):
        x, y, z = _turned_within(points[i, 0], points[i, 1], points[i, 2], tau[i], omega)
        x_map[i, 0], x_map[i, 1], x_map[i, 2] = _in_map(x, y, z, tau[i], R, p, v)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _simply_nearest(
    x: FloatArray, y: FloatArray, z: FloatArray, held: int, s: Surfaces, least: FloatArray, which: FloatArray
) -> None:
    """Fills least and which (held,) with how far the nearest plane's equation is, wherever it is known, and its number.

    Plain sums over points in rows, numbers as floats: the machine does several at once.
    """
    for k in range(held):
        least[k], which[k] = np.inf, -1.0
    for j in range(s.normals.shape[0]):
        n0, n1, n2, w, number = s.normals[j, 0], s.normals[j, 1], s.normals[j, 2], s.offsets[j], float(j)
        for k in range(held):
            away = abs(w + n0 * x[k] + n1 * y[k] + n2 * z[k])
            before = least[k]
            less = away < before
            which[k] = number if less else which[k]
            least[k] = away if less else before


@numba.njit(cache=True, nogil=True, error_model="numpy")
def look_kernel(points: FloatArray, tau: FloatArray, s: Surfaces, at: Motion, seen: Seen) -> None:
    """Fills `seen` (N,) with what points (N, 3), seen at tau (N,) after the scan's start, are under a motion."""
    R, p, omega, v = at
    n_lidar = s.normals @ R
    xs, ys, zs, least, likely = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for first in range(0, points.shape[0], BLOCK):
        held = min(BLOCK, points.shape[0] - first)
        for k in range(held):
            i = first + k
            t = tau[i]
            x2, y2, z2 = _turned_within(points[i, 0], points[i, 1], points[i, 2], t, omega)
            seen.turned[i, 0], seen.turned[i, 1], seen.turned[i, 2] = x2, y2, z2
            xs[k], ys[k], zs[k] = _in_map(x2, y2, z2, t, R, p, v)
            seen.x_map[i, 0], seen.x_map[i, 1], seen.x_map[i, 2] = xs[k], ys[k], zs[k]
        _simply_nearest(xs, ys, zs, held, s, least, likely)
        for k in range(held):
            i, j = first + k, int(likely[k])
            x2, y2, z2 = seen.turned[i, 0], seen.turned[i, 1], seen.turned[i, 2]
            if j >= 0 and not _behind(j, x2, y2, z2, n_lidar) and _reaches(j, xs[k], ys[k], zs[k], s):
                # No other one can be less far, as none is even nearer.
                value = _value(j, xs[k], ys[k], zs[k], s)
                seen.plane[i], seen.d[i], seen.far[i], seen.inside[i] = j, value, abs(value), True
            else:
                seen.plane[i], seen.d[i], seen.far[i], seen.inside[i] = _nearest(
                    xs[k], ys[k], zs[k], x2, y2, z2, s, n_lidar
                )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def equations_kernel(
    tau: FloatArray,
    normals: FloatArray,
    n_lidar: FloatArray,
    worth: FloatArray,
    scale: float,
    seen: Seen,
    sums: FloatArray,
    gradient: FloatArray,
) -> None:
    """Fills sums (3, 24) with w r r', w t r r', w t^2 r r', upper triangles, and gradient (12,) with w d [r, t r].

    With r (6,) of a point-to-plane distance after turn and place; the rates' rows are these times t.   n_lidar: (P, 3) in the
    lidar's axes.   worth: (P,) factors of the weights of planes.   scale: [m] of the redescending weight.
    """
    row, product, time = np.empty(6), np.zeros((BLOCK, _ROW)), np.empty((BLOCK, 2))
    sums[:], gradient[:] = 0.0, 0.0
    held, width, n = 0, product.shape[1], tau.shape[0]
    for i in range(n):
        best = seen.plane[i]
        if best >= 0:
            t, distance = tau[i], seen.d[i]
            x, y, z = seen.turned[i, 0], seen.turned[i, 1], seen.turned[i, 2]
            weight = worth[best] / (1.0 + (seen.far[i] / scale) ** 2) ** 2
            m0, m1, m2 = n_lidar[best, 0], n_lidar[best, 1], n_lidar[best, 2]
            row[0], row[1], row[2] = y * m2 - z * m1, z * m0 - x * m2, x * m1 - y * m0
            row[3], row[4], row[5] = normals[best, 0], normals[best, 1], normals[best, 2]
            place = 0
            for a in range(6):
                pull = weight * row[a]
                gradient[a] += pull * distance
                gradient[6 + a] += t * pull * distance
                for b in range(a, 6):
                    product[held, place] = pull * row[b]
                    place += 1
            time[held, 0], time[held, 1] = t, t * t
            held += 1
        # Added point by point, as one by one would be: in rows, so that the machine adds several numbers at once.
        if held == BLOCK or i == n - 1:
            for k in range(held):
                t, tt = time[k, 0], time[k, 1]
                for c in range(width):
                    sums[0, c] += product[k, c]
                    sums[1, c] += t * product[k, c]
                    sums[2, c] += tt * product[k, c]
            held = 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _unfold(sums: FloatArray, hessian: FloatArray) -> None:
    """Fills (12, 12) of [r, t r] from the upper triangles of w r r', w t r r', w t^2 r r'."""
    place = 0
    for a in range(6):
        for b in range(a, 6):
            for r, c, power in ((a, b, 0), (a, 6 + b, 1), (b, 6 + a, 1), (6 + a, 6 + b, 2)):
                hessian[r, c] = hessian[c, r] = sums[power, place]
            place += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _weigh(seen: Seen, within_m: float, most: float, least: int, worth: FloatArray) -> None:
    """Fills worth (P,): factors that let no plane count for more than so many points, its own error stays however many it has.

    Fewer than `least` points on a plane may be anything that happens to be there: they do not count at all.
    """
    worth[:] = 0.0
    for i in range(seen.plane.shape[0]):
        if seen.plane[i] >= 0 and seen.inside[i] and abs(seen.d[i]) < within_m:
            worth[seen.plane[i]] += 1.0
    for j in range(worth.shape[0]):
        worth[j] = 0.0 if worth[j] < least else 1.0 / (1.0 + worth[j] / most)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def descend_kernel(
    points: FloatArray,
    tau: FloatArray,
    s: Surfaces,
    scales_m: FloatArray,
    tie: FloatArray,
    counting: Counting,
    at: Motion,
    seen: Seen,
) -> None:
    """Moves a predicted motion to where the points want it: one damped step a scale.

    seen: of the points under the predicted motion; of a later one afterwards.   tie: (12,) weight of the prediction,
    rotation, position, rate, velocity.   A plane counts with `least` points within twice the scale.
    """
    R, p, omega, v = at
    R0, p0, omega0, v0 = R.copy(), p.copy(), omega.copy(), v.copy()
    worth, sums = np.ones(s.normals.shape[0]), np.empty((3, _ROW))
    hessian, gradient, away, turn = np.empty((12, 12)), np.empty(12), np.empty(12), np.empty((3, 3))
    for k in range(scales_m.shape[0]):
        if k > 0:
            look_kernel(points, tau, s, at, seen)
        equations_kernel(tau, s.normals, s.normals @ R, worth, scales_m[k], seen, sums, gradient)
        _unfold(sums, hessian)
        _weigh(seen, 2.0 * scales_m[k], counting.plane, counting.least, worth)
        log_into(R0.T @ R, away)
        away[3:6], away[6:9], away[9:] = p - p0, omega - omega0, v - v0
        for a in range(12):
            hessian[a, a] += tie[a]
            gradient[a] += tie[a] * away[a]
        step = -np.linalg.solve(hessian, gradient)
        exp_into(step[0], step[1], step[2], turn)
        R[:] = R @ turn
        p += step[3:6]
        omega += step[6:9]
        v += step[9:]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def balanced_kernel(seen: Seen, near_m: float, planes: int, count: int) -> IntArray:
    """About `count` of the points (N,) with the planes as equal as they can be, spread evenly over each; in order.

    Points farther than near_m from their plane are as one plane more.
    """
    n = seen.plane.shape[0]
    if n <= count:
        return np.arange(n)
    group, size = np.zeros(n, np.int64), np.zeros(planes + 1, np.int64)
    for i in range(n):
        if abs(seen.d[i]) < near_m:
            group[i] = seen.plane[i] + 1
        size[group[i]] += 1
    filled = np.sort(size[size > 0])
    most = left = count
    for rank in range(filled.shape[0]):
        most = left // (filled.shape[0] - rank)
        if filled[rank] > most:
            break
        left -= filled[rank]
    # The k-th of a group that is taken is its member number k size / taken.
    passed, taken, coming = np.zeros_like(size), np.zeros_like(size), np.zeros_like(size)
    few, at = np.empty(n, np.int64), 0
    for i in range(n):
        g = group[i]
        if passed[g] == coming[g]:
            few[at] = i
            at += 1
            taken[g] += 1
            mine = min(size[g], most)
            coming[g] = taken[g] * size[g] // mine if taken[g] < mine else n
        passed[g] += 1
    return few[:at]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _some_of(seen: Seen, few: IntArray) -> Seen:
    """What some of the points are seen as, but for where they are in the map."""
    some = room_for(few.shape[0])
    for i in range(few.shape[0]):
        k = few[i]
        some.plane[i], some.d[i], some.far[i], some.inside[i] = seen.plane[k], seen.d[k], seen.far[k], seen.inside[k]
        for a in range(3):
            some.turned[i, a] = seen.turned[k, a]
    return some


@numba.njit(cache=True, nogil=True, error_model="numpy")
def register_kernel(
    points: FloatArray,
    tau: FloatArray,
    s: Surfaces,
    scales_m: FloatArray,
    tie: FloatArray,
    counting: Counting,
    at: Motion,
    seen: Seen,
) -> FloatArray:
    """Moves a predicted motion to where some of the points (N, 3) want it; `seen` is how all of them are seen then.

    Returns (6, 6): what these tell of turn and place, under the last scale, with no plane counting for more than it is sure.
    """
    look_kernel(points, tau, s, at, seen)
    few = balanced_kernel(seen, scales_m[0], s.normals.shape[0], counting.points)
    some_m, some_s = points[few, :], tau[few]
    descend_kernel(some_m, some_s, s, scales_m, tie, counting, at, _some_of(seen, few))
    look_kernel(points, tau, s, at, seen)
    some = _some_of(seen, few)
    worth, sums, gradient = np.empty(s.normals.shape[0]), np.empty((3, _ROW)), np.empty(12)
    _weigh(some, counting.inlier_m, counting.sure, 2 * counting.least, worth)
    equations_kernel(some_s, s.normals, s.normals @ at.R, worth, scales_m[-1], some, sums, gradient)
    sure, place = np.empty((6, 6)), 0
    for a in range(6):
        for b in range(a, 6):
            sure[a, b] = sure[b, a] = sums[0, place]
            place += 1
    return sure
