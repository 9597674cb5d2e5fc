"""Loops over single points, compiled. Each has a plain NumPy twin in the tests and does nothing that the twin does not.

Why compiled: a minute of recording is seventeen million points, and a handful of multiplications on each is all there
is to do. Compiled code is kept beside this file, so that only a machine's first run pays for the compiler.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray

#: A plane seen at a smaller cosine is taken to be seen at this one, where it is asked how far a hit is from it.
GRAZING = 0.25
#: A ray that is parallel to a face but for this never meets it.
FLAT = 1e-9
#: Of the normal law, and of the error function.
DENSITY, HALF_ROOT = 1.0 / np.sqrt(2.0 * np.pi), np.sqrt(0.5)
#: A cell that leaves a return less than this share of its variance leaves nothing to learn from it.
TOLD_SHARE = 1e-3
#: Over the last quarter of a standard deviation before the gate, and of the margin, weights fall to zero: with a step
#: there, a point that comes or goes moves the answer, which lets another one go, and so on for ever.
RAMP = 0.25


class SeenPlanes(NamedTuple):
    """The planes as the lidar sees them from the middles of slices, its rates there, and which rays are looked at.

    slice_s: how long a slice is.   n_lidar (S, P, 3), w_lidar (S, P).   omega, v: (S, 3), lidar axes.   usable: (S,).
    min_cosine: of the incidence.   min_azimuth_cosine: of the azimuth's cosine, -2 for all.
    """

    slice_s: float
    n_lidar: FloatArray
    w_lidar: FloatArray
    omega: FloatArray
    v: FloatArray
    usable: BoolArray
    min_cosine: float
    min_azimuth_cosine: float


class Weighing(NamedTuple):
    """What a hit's weight depends on beside itself: lidar_plane.LidarNoise and Gate.

    extra_stds: the extra width of a gate in standard deviations of what it makes room for.   farthest_m: no range beyond.
    sieve_m: edge of the cells of which each left one point, 0 for none.
    """

    range_std_m: float
    surface_std_m: float
    sigmas: float
    margin_m: float
    robust_sigmas: float
    extra_stds: float
    farthest_m: float
    sieve_m: float


@numba.njit(cache=True, nogil=True, inline="always")
def looked_at(x: float, y: float, z: float, min_azimuth_cosine: float) -> bool:
    """Whether a point is a return, and within the field of view. min_azimuth_cosine: -2 for all."""
    if x * x + y * y + z * z < 1e-6:
        return False
    return min_azimuth_cosine <= -1.5 or x >= min_azimuth_cosine * np.sqrt(x * x + y * y)


@numba.njit(cache=True, nogil=True)
def meet(
    x: float,
    y: float,
    z: float,
    t: float,
    k: int,
    n_lidar: FloatArray,
    w_lidar: FloatArray,
    omega: FloatArray,
    v: FloatArray,
    min_cosine: float,
    D: FloatArray,
    along: FloatArray,
    hit: FloatArray,
) -> int:
    """The plane that a ray most plausibly ended on, -1 for none, and what is said of it: hit (6,) x_hit, d, cosine, beside.

    t: after the middle of its slice k, of all slices' planes n_lidar (S, P, 3), w_lidar (S, P) and rates omega, v (S, 3): a
    slice of an array is an object, and counting who holds it costs a third of the rest.   D, along: (P,) room to work.   Range
    errors D / cosine are compared without dividing.
    """
    n_planes = n_lidar.shape[1]
    tx = x + t * (omega[k, 1] * z - omega[k, 2] * y)
    ty = y + t * (omega[k, 2] * x - omega[k, 0] * z)
    tz = z + t * (omega[k, 0] * y - omega[k, 1] * x)
    r = np.sqrt(x * x + y * y + z * z)
    best = -1
    for j in range(n_planes):
        nx, ny, nz = n_lidar[k, j, 0], n_lidar[k, j, 1], n_lidar[k, j, 2]
        along[j] = nx * tx + ny * ty + nz * tz
        D[j] = along[j] + t * (nx * v[k, 0] + ny * v[k, 1] + nz * v[k, 2]) + w_lidar[k, j]
        if along[j] < -min_cosine * r and (best < 0 or abs(D[j]) * along[best] > abs(D[best]) * along[j]):
            best = j
    if best < 0:
        return best
    error = D[best] / along[best]
    hit[0] = tx + t * v[k, 0] - error * tx
    hit[1] = ty + t * v[k, 1] - error * ty
    hit[2] = tz + t * v[k, 2] - error * tz
    hit[3] = D[best]
    hit[4] = along[best] / r
    gap, slant = np.inf, 1.0
    for j in range(n_planes):
        if j != best:
            other, across = abs(D[j] - error * along[j]), max(abs(along[j]), GRAZING * r)
            if other * slant < gap * across:
                gap, slant = other, across
    hit[5] = gap * r / slant
    return best


@numba.njit(cache=True, nogil=True)
def hits_kernel(
    xyz: Float32Array,
    offset_s: FloatArray,
    first_slice: IntArray,
    seen: SeenPlanes,
    plane: IntArray,
    slice_index: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    beside: FloatArray,
) -> None:
    """Fills plane (-1: none), slice_index, x_hit (N, 3), d, cosine, beside (N,) for points xyz (N, 3) at offset_s (N,).

    beside: distance along the ray to the nearest other plane, as seen at a cosine of GRAZING at least.   first_slice: (N,)
    that of each point's scan; offset_s counts from its beginning.
    """
    slice_s, n_lidar, w_lidar, omega, v, usable, min_cosine, min_azimuth_cosine = seen
    n_planes = n_lidar.shape[1]
    D, along, hit = np.empty(n_planes), np.empty(n_planes), np.empty(6)
    for i in range(xyz.shape[0]):
        x, y, z = np.float64(xyz[i, 0]), np.float64(xyz[i, 1]), np.float64(xyz[i, 2])
        local = int(offset_s[i] / slice_s)
        k = first_slice[i] + local
        plane[i] = -1
        slice_index[i] = k
        if not usable[k] or not looked_at(x, y, z, min_azimuth_cosine):
            continue
        t = offset_s[i] - (local + 0.5) * slice_s
        best = meet(x, y, z, t, k, n_lidar, w_lidar, omega, v, min_cosine, D, along, hit)
        if best < 0:
            continue
        plane[i] = best
        x_hit[i, 0], x_hit[i, 1], x_hit[i, 2] = hit[0], hit[1], hit[2]
        d[i], cosine[i], beside[i] = hit[3], hit[4], hit[5]


@numba.njit(cache=True, nogil=True)
def cut_off(x: float, y: float, z: float, long_m: float, std_m: float, sieve_m: float) -> tuple[float, float]:
    """Mean [m] and variance, as a share of std_m^2, that a return's range error has in the cell in which it lies.

    x, y, z: the return as published, which reads long_m too far.   std_m: of its range.   sieve_m: edge of the cells, of a grid
    through the origin. The law is the normal one between the two faces that the ray passes.
    """
    r = np.sqrt(x * x + y * y + z * z)
    near, far = -np.inf, np.inf
    for value in (x, y, z):
        if abs(value) > FLAT * r:
            face, step = np.floor(value / sieve_m) * sieve_m * r / value, sieve_m * r / abs(value)
            begin = face if value > 0.0 else face - step
            near, far = max(near, begin), min(far, begin + step)
    a, b = (near - r + long_m) / std_m, (far - r + long_m) / std_m
    inside = 0.5 * (math.erf(b * HALF_ROOT) - math.erf(a * HALF_ROOT))
    if not inside > 0.0:
        return 0.0, 0.0
    at_a, at_b = DENSITY * np.exp(-0.5 * a * a) / inside, DENSITY * np.exp(-0.5 * b * b) / inside
    mean = at_a - at_b
    return mean * std_m, max(1.0 + a * at_a - b * at_b - mean * mean, 0.0)


@numba.njit(cache=True, nogil=True)
def weight_of(
    x: float,
    y: float,
    z: float,
    d: float,
    cosine: float,
    ambiguous_m: float,
    extra_m: float,
    weighing: Weighing,
) -> float:
    """Weight [1/m^2] of a hit at x, y, z, below zero where it does not count.

    extra_m: room in its plane's gate, below zero for none.   Where the ray meets the plane no nearer to the farthest range
    than noise reaches, of returns only those that read short are there: none is taken.
    """
    range_std_m, surface_std_m, sigmas, margin_m, robust_sigmas, extra_stds, farthest_m, _ = weighing
    variance = (range_std_m * cosine) ** 2 + surface_std_m**2
    std = np.sqrt(variance)
    room = sigmas * std + extra_m - abs(d)
    clear = ambiguous_m - (1.0 - RAMP) * margin_m
    range_m2, most_m = x * x + y * y + z * z, max(farthest_m - sigmas * range_std_m, 0.0)
    if extra_m < 0.0 or not room > 0.0 or not clear > 0.0 or not range_m2 < most_m * most_m:
        return -1.0
    shortfall = max(1.0 - (d / (robust_sigmas * std + extra_m)) ** 2, 0.0)
    edge = min(room / (RAMP * std), 1.0)
    if margin_m > 0.0:
        edge *= min(clear / (RAMP * margin_m), 1.0)
    if range_m2 > (most_m - RAMP * range_std_m) ** 2:
        edge *= min((most_m - np.sqrt(range_m2)) / (RAMP * range_std_m), 1.0)
    return edge * shortfall**2 / (variance + (extra_m / extra_stds) ** 2)


@numba.njit(cache=True, nogil=True)
def select_kernel(
    plane: IntArray,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    ambiguous_m: FloatArray,
    extra_of_plane_m: FloatArray,
    weighing: Weighing,
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
        x, y, z = x_hit[i, 0], x_hit[i, 1], x_hit[i, 2]
        worth = weight_of(x, y, z, d[i], cosine[i], ambiguous_m[i], extra_of_plane_m[j], weighing)
        if worth >= 0.0:
            keep[i] = True
            weight[i] = worth


@numba.njit(cache=True, nogil=True)
def as_sieved(
    hit: FloatArray, d: float, published_m: Float32Array, extra_m: float, weighing: Weighing
) -> tuple[float, float]:
    """The distance [m] and weight [1/m^2] to count a return with that somebody left in its cell; weight below zero for none.

    Its score is (e - mean) / std^2 and its information variance / std^4 (`cut_off`); a weight times the square of a distance has
    the same. Nothing else of its weight may depend on the noise: no robust one, which leans to where the cell is open.   hit:
    (6,) of `meet`, and d what is left of its distance.   published_m: (3,).
    """
    variance = (weighing.range_std_m * hit[4]) ** 2 + weighing.surface_std_m**2
    std_m = np.sqrt(variance) / abs(hit[4])
    mean_m, share = cut_off(published_m[0], published_m[1], published_m[2], d / hit[4], std_m, weighing.sieve_m)
    if share < TOLD_SHARE:
        return d, -1.0
    weight = weight_of(hit[0], hit[1], hit[2], 0.0, hit[4], hit[5], extra_m, weighing)
    return (d - mean_m * hit[4]) / share, weight * share


@numba.njit(cache=True, nogil=True, inline="always")
def is_sieved(weight: float, extra_m: float, cosine: float, weighing: Weighing) -> bool:
    """Whether a return counts that a grid left, and the motion is surer than its range: else it counts as it came."""
    variance = (weighing.range_std_m * cosine) ** 2 + weighing.surface_std_m**2
    return weighing.sieve_m > 0.0 and weight >= 0.0 and (extra_m / weighing.extra_stds) ** 2 <= variance


@numba.njit(cache=True, nogil=True)
def sieve_kernel(
    plane: IntArray,
    published_m: Float32Array,
    x_hit: FloatArray,
    d: FloatArray,
    cosine: FloatArray,
    ambiguous_m: FloatArray,
    extra_of_plane_m: FloatArray,
    weighing: Weighing,
    keep: BoolArray,
    weight: FloatArray,
) -> None:
    """`as_sieved` of the kept hits: changes d (N,), keep and weight."""
    hit = np.empty(6)
    for i in range(plane.shape[0]):
        extra_m = extra_of_plane_m[plane[i]]
        if keep[i] and is_sieved(weight[i], extra_m, cosine[i], weighing):
            hit[:3], hit[3], hit[4], hit[5] = x_hit[i], d[i], cosine[i], ambiguous_m[i]
            d[i], weight[i] = as_sieved(hit, d[i], published_m[i], extra_m, weighing)
            keep[i] = weight[i] >= 0.0


@numba.njit(cache=True, nogil=True)
def add_moments(x: float, y: float, z: float, d: float, weight: float, scatter: FloatArray, b: int) -> None:
    """Adds weight h h', h = [x, y, z, 1, d], upper triangle row by row, to row b of scatter (B, 15)."""
    wx, wy, wz = weight * x, weight * y, weight * z
    scatter[b, 0] += wx * x
    scatter[b, 1] += wx * y
    scatter[b, 2] += wx * z
    scatter[b, 3] += wx
    scatter[b, 4] += wx * d
    scatter[b, 5] += wy * y
    scatter[b, 6] += wy * z
    scatter[b, 7] += wy
    scatter[b, 8] += wy * d
    scatter[b, 9] += wz * z
    scatter[b, 10] += wz
    scatter[b, 11] += wz * d
    scatter[b, 12] += weight
    scatter[b, 13] += weight * d
    scatter[b, 14] += weight * d * d


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
    for i in range(keep.shape[0]):
        if keep[i]:
            b = slice_index[i] * n_planes + plane[i]
            add_moments(x_hit[i, 0], x_hit[i, 1], x_hit[i, 2], d[i], weight[i], scatter, b)
            count[b] += 1


@numba.njit(cache=True, nogil=True)
def move_and_sum_kernel(
    scatter: FloatArray, R: FloatArray, p: FloatArray, pose: IntArray, place: IntArray, total: FloatArray
) -> None:
    """Adds A M A', A = diag([R p; 0 1], 1) of its pose, of every packed M (B, 15) to total (K, 5, 5) at its place (B,)."""
    M, A, half = np.empty((5, 5)), np.empty((3, 4)), np.empty((5, 5))
    for b in range(scatter.shape[0]):
        packed = 0
        for r in range(5):
            for c in range(r, 5):
                M[r, c] = M[c, r] = scatter[b, packed]
                packed += 1
        for r in range(3):
            for c in range(3):
                A[r, c] = R[pose[b], r, c]
            A[r, 3] = p[pose[b], r]
        for r in range(5):
            for c in range(5):
                half[r, c] = M[r, c]
                if r < 3:
                    half[r, c] = A[r, 0] * M[0, c] + A[r, 1] * M[1, c] + A[r, 2] * M[2, c] + A[r, 3] * M[3, c]
        for r in range(5):
            for c in range(3):
                total[place[b], r, c] += (
                    half[r, 0] * A[c, 0] + half[r, 1] * A[c, 1] + half[r, 2] * A[c, 2] + half[r, 3] * A[c, 3]
                )
            for c in range(3, 5):
                total[place[b], r, c] += half[r, c]
