"""Loops over single points, compiled. Each has a plain NumPy twin in the tests and does nothing that the twin does not.

Why compiled: a minute of recording is seventeen million points, and a handful of multiplications on each is all there
is to do. Compiled code is kept beside this file, so that only a machine's first run pays for the compiler.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from calib_core.factors.blocks import (
    BESIDE,
    BLOCK,
    COSINE,
    DISTANCE,
    HIT_X,
    HIT_Y,
    HIT_Z,
    PLANE,
    SeenPlanes,
    T,
    Weighing,
    X,
    Y,
    Z,
    meet_block,
    new_block,
    weight_of,
)
from calib_core.geometry.compiled import transposed_by_into
from calib_core.types import BoolArray, Float32Array, FloatArray, IntArray

#: A ray that is parallel to a face but for this never meets it.
FLAT = 1e-9
#: Of the normal law, and of the error function.
DENSITY, HALF_ROOT = 1.0 / np.sqrt(2.0 * np.pi), np.sqrt(0.5)
#: A cell that leaves a return less than this share of its variance leaves nothing to learn from it.
TOLD_SHARE = 1e-3


@numba.njit(cache=True, nogil=True, error_model="numpy")
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

    As `meet_block` has it.   first_slice: (N,) that of each point's scan; offset_s counts from its beginning.
    """
    points, none = xyz.shape[0], np.zeros(0)
    S, i = new_block(seen.n_lidar.shape[1]), 0
    while i < points:
        k, begin, n = first_slice[i] + int(offset_s[i] / seen.slice_s), i, 0
        while i < points and n < BLOCK:
            local = int(offset_s[i] / seen.slice_s)
            if first_slice[i] + local != k:
                break
            S[X + n], S[Y + n], S[Z + n] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
            S[T + n] = offset_s[i] - (local + 0.5) * seen.slice_s
            plane[i], slice_index[i] = -1, k
            i, n = i + 1, n + 1
        if not seen.usable[k]:
            continue
        meet_block(S, n, k, seen, none)
        for m in range(n):
            best = int(S[PLANE + m])
            if best >= 0:
                at = begin + m
                plane[at] = best
                x_hit[at, 0], x_hit[at, 1], x_hit[at, 2] = S[HIT_X + m], S[HIT_Y + m], S[HIT_Z + m]
                d[at], cosine[at], beside[at] = S[DISTANCE + m], S[COSINE + m], S[BESIDE + m]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def seen_from_kernel(
    R: FloatArray,
    p: FloatArray,
    from_R: FloatArray,
    from_p: FloatArray,
    which: IntArray,
    out_R: FloatArray,
    out_p: FloatArray,
) -> None:
    """Fills out_R (S, 3, 3), out_p (S, 3): poses R, p as others see them, from_R (K, 3, 3), from_p (K, 3), which (S,)."""
    for i in range(which.shape[0]):
        k = which[i]
        transposed_by_into(from_R[k], R[i], out_R[i])
        x, y, z = p[i, 0] - from_p[k, 0], p[i, 1] - from_p[k, 1], p[i, 2] - from_p[k, 2]
        for c in range(3):
            out_p[i, c] = from_R[k, 0, c] * x + from_R[k, 1, c] * y + from_R[k, 2, c] * z


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def faces_along(x: float, y: float, z: float, sieve_m: float) -> tuple[float, float]:
    """How much nearer and how much farther than a return its ray passes the two faces of its cell [m].

    x, y, z: the return as published.   sieve_m: edge of the cells, of a grid through the origin.
    """
    r = np.sqrt(x * x + y * y + z * z)
    near, far = -np.inf, np.inf
    for value in (x, y, z):
        if abs(value) > FLAT * r:
            face, step = np.floor(value / sieve_m) * sieve_m * r / value, sieve_m * r / abs(value)
            begin = face if value > 0.0 else face - step
            near, far = max(near, begin), min(far, begin + step)
    return near - r, far - r


@numba.njit(cache=True, nogil=True, error_model="numpy")
def faces_kernel(published_m: Float32Array, sieve_m: float, faces_m: FloatArray) -> None:
    """Fills faces_m (N, 2) with `faces_along` of returns (N, 3)."""
    for i in range(published_m.shape[0]):
        x, y, z = np.float64(published_m[i, 0]), np.float64(published_m[i, 1]), np.float64(published_m[i, 2])
        # One by one: for a row from a pair the compiler also makes words that say how they do not fit, in four seconds.
        faces_m[i, 0], faces_m[i, 1] = faces_along(x, y, z, sieve_m)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def tapered_sums_kernel(
    d: FloatArray, cells_m: FloatArray, std_m: float, ends: float, weights: FloatArray, squares: FloatArray
) -> tuple[float, float]:
    """Sums of w u^2, and of w times the mean of it that each one's cell keeps, of errors d (N,) in units of std_m.

    cells_m: (N, 2) between which each cell keeps them.   w = (1 - (u / ends)^2)^2.   weights, squares: integrals of w and of
    w u^2 under the normal law up to numbers from -ends to ends, evenly apart.
    """
    last = weights.shape[0] - 1
    per_unit, total, kept = last / (2.0 * ends), 0.0, 0.0
    for i in range(d.shape[0]):
        u = d[i] / std_m
        if abs(u) >= ends:
            continue
        w = (1.0 - (u / ends) ** 2) ** 2
        at_near = (min(max(cells_m[i, 0] / std_m, -ends), ends) + ends) * per_unit
        at_far = (min(max(cells_m[i, 1] / std_m, -ends), ends) + ends) * per_unit
        near, far = min(int(at_near), last - 1), min(int(at_far), last - 1)
        f, g = at_near - near, at_far - far
        of_weight = (
            weights[far]
            + g * (weights[far + 1] - weights[far])
            - weights[near]
            - f * (weights[near + 1] - weights[near])
        )
        of_square = (
            squares[far]
            + g * (squares[far + 1] - squares[far])
            - squares[near]
            - f * (squares[near + 1] - squares[near])
        )
        # Between faces as good as the same, the error is what it is.
        total += w * u * u
        kept += w * (of_square / of_weight if of_weight > 0.0 else u * u)
    return total, kept


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cut_off(x: float, y: float, z: float, long_m: float, std_m: float, sieve_m: float) -> tuple[float, float]:
    """Mean [m] and variance, as a share of std_m^2, that a return's range error has in the cell in which it lies.

    x, y, z: the return as published, which reads long_m too far.   std_m: of its range.   sieve_m: edge of the cells, of a grid
    through the origin. The law is the normal one between the two faces that the ray passes.
    """
    near_m, far_m = faces_along(x, y, z, sieve_m)
    a, b = (near_m + long_m) / std_m, (far_m + long_m) / std_m
    inside = 0.5 * (math.erf(b * HALF_ROOT) - math.erf(a * HALF_ROOT))
    if not inside > 0.0:
        return 0.0, 0.0
    at_a, at_b = DENSITY * np.exp(-0.5 * a * a) / inside, DENSITY * np.exp(-0.5 * b * b) / inside
    mean = at_a - at_b
    return mean * std_m, max(1.0 + a * at_a - b * at_b - mean * mean, 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def as_sieved(
    x: float,
    y: float,
    z: float,
    d: float,
    cosine: float,
    beside_m: float,
    published_m: Float32Array,
    extra_m: float,
    weighing: Weighing,
) -> tuple[float, float]:
    """The distance [m] and weight [1/m^2] to count a return with that somebody left in its cell; weight below zero for none.

    Its score is (e - mean) / std^2 and its information variance / std^4 (`cut_off`); a weight times the square of a distance has
    the same. Nothing else of its weight may depend on the noise: no robust one, which leans to where the cell is open.   x, y, z
    to beside_m: the hit, as in `meet_block`.   published_m: (3,).
    """
    variance = (weighing.range_std_m * cosine) ** 2 + weighing.surface_std_m**2
    std_m = np.sqrt(variance) / abs(cosine)
    mean_m, share = cut_off(published_m[0], published_m[1], published_m[2], d / cosine, std_m, weighing.sieve_m)
    if share < TOLD_SHARE:
        return d, -1.0
    weight = weight_of(x, y, z, 0.0, cosine, beside_m, extra_m, weighing)
    return (d - mean_m * cosine) / share, weight * share


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def is_sieved(weight: float, extra_m: float, cosine: float, weighing: Weighing) -> bool:
    """Whether a return counts that a grid left, and the motion is surer than its range: else it counts as it came."""
    variance = (weighing.range_std_m * cosine) ** 2 + weighing.surface_std_m**2
    return weighing.sieve_m > 0.0 and weight >= 0.0 and (extra_m / weighing.extra_stds) ** 2 <= variance


@numba.njit(cache=True, nogil=True, error_model="numpy")
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
    for i in range(plane.shape[0]):
        extra_m = extra_of_plane_m[plane[i]]
        if keep[i] and is_sieved(weight[i], extra_m, cosine[i], weighing):
            d[i], weight[i] = as_sieved(
                x_hit[i, 0],
                x_hit[i, 1],
                x_hit[i, 2],
                d[i],
                cosine[i],
                ambiguous_m[i],
                published_m[i],
                extra_m,
                weighing,
            )
            keep[i] = weight[i] >= 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
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
