"""Points by the block: the arithmetic that is the same for each, in loops that a processor does several turns of at a time.

A block is some neighbours of one slice of a sweep. Whatever is known of them lies in one array, column after column, each `BLOCK`
long and named by where it begins: S[X + i]. So the compiler sees that no column overlaps another. Nothing in these loops
branches, no division is looked at before it is done, and no sum runs over points: every lane gives what it would give alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from calib_core.types import BoolArray, FloatArray

#: Points of a block: some turns of the widest lanes, and all columns in the nearest cache.
BLOCK = 64
#: As published, then corrected, in lidar axes; when, after the middle of the slice; of those that count, where they hit.
X, Y, Z, T = 0 * BLOCK, 1 * BLOCK, 2 * BLOCK, 3 * BLOCK
#: Of each point's laser: errors of its range [m], of its scale, sine and cosine of that of its elevation, of its azimuth [rad]; 1
#: where it is known.
OFFSET, SCALE, LASER_SINE, LASER_COSINE, AZIMUTH, KNOWN = (
    4 * BLOCK,
    5 * BLOCK,
    6 * BLOCK,
    7 * BLOCK,
    8 * BLOCK,
    9 * BLOCK,
)
#: Range; the hit; the plane, -1 for none; distance from it, cosine of the incidence, distance from the next one along the ray.
RANGE, HIT_X, HIT_Y, HIT_Z = 10 * BLOCK, 11 * BLOCK, 12 * BLOCK, 13 * BLOCK
PLANE, DISTANCE, COSINE, BESIDE = 14 * BLOCK, 15 * BLOCK, 16 * BLOCK, 17 * BLOCK
#: Room in the plane's gate; the weight, below zero where a point does not count.
EXTRA, WEIGHT = 18 * BLOCK, 19 * BLOCK
#: What a loop hands on to the next.
A, B, C, D, E, F = 20 * BLOCK, 21 * BLOCK, 22 * BLOCK, 23 * BLOCK, 24 * BLOCK, 25 * BLOCK
#: The plane's normal, lidar axes; seven features and where the point lies from the middle of its group (laser_kernels.py).
NORMAL_X, NORMAL_Y, NORMAL_Z, FEATURE, PLACE = 26 * BLOCK, 27 * BLOCK, 28 * BLOCK, 29 * BLOCK, 36 * BLOCK
#: From here on two columns a plane: what a ray gains on its normal, and the point's distance.
SEEN = 39 * BLOCK

#: A plane seen at a smaller cosine is taken to be seen at this one, where it is asked how far a hit is from it.
GRAZING = 0.25
#: Over the last quarter of a standard deviation before the gate, and of the margin, weights fall to zero: with a step
#: there, a point that comes or goes moves the answer, which lets another one go, and so on for ever.
RAMP = 0.25
#: Below this [rad] sine and cosine are five terms of their series, to the last digit: 0.05^10 / 10! is 3e-20.
SMALL_RAD = 0.05
#: No range comes near it, squared.
_FAR = 1e300


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

    extra_stds: the extra width of a gate in standard deviations of what it makes room for.   farthest_m: no range beyond, and
    none nearer than nearest_m, 0 where there is no such limit.
    sieve_m: edge of the cells of which each left one point, 0 for none.   least_cosine: of the incidence at which one counts.
    """

    range_std_m: float
    surface_std_m: float
    sigmas: float
    margin_m: float
    robust_sigmas: float
    extra_stds: float
    farthest_m: float
    sieve_m: float
    least_cosine: float
    nearest_m: float


@numba.njit(cache=True, nogil=True, error_model="numpy")
def new_block(planes: int) -> FloatArray:
    """Room for a block that meets so many planes."""
    return np.zeros(SEEN + 2 * planes * BLOCK)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def sine_and_cosine(angle_rad: float) -> tuple[float, float]:
    """Of an angle below SMALL_RAD."""
    s = angle_rad * angle_rad
    return (
        angle_rad * (1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0)))),
        1.0 - s / 2.0 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0))),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def correct_block(S: FloatArray, n: int, eccentricity_rad: FloatArray) -> None:
    """X, Y, Z of n points become where they would be without their lasers' errors, in single precision as they were published.

    OFFSET to KNOWN: as told.   eccentricity_rad: (2,) sine and cosine, of all lasers.
    """
    by_sine, by_cosine = eccentricity_rad[0], eccentricity_rad[1]
    most = 0.0
    for i in range(n):
        x, y, z = S[X + i], S[Y + i], S[Z + i]
        level2 = x * x + y * y
        r, level = math.sqrt(level2 + z * z), math.sqrt(level2)
        upright = level < 1e-9
        S[A + i] = (r - S[OFFSET + i]) / ((1.0 + S[SCALE + i]) * r)
        S[B + i] = 1.0 if upright else (level * S[LASER_COSINE + i] - z * S[LASER_SINE + i]) / level
        turned = (by_sine * y + by_cosine * x) / level
        S[C + i] = S[AZIMUTH + i] + (0.0 if upright else turned)
        S[D + i] = level
        S[RANGE + i] = r
        most = max(most, abs(S[C + i]))
    if most <= SMALL_RAD:
        for i in range(n):
            S[E + i], S[F + i] = sine_and_cosine(S[C + i])
    else:
        for i in range(n):
            S[E + i], S[F + i] = math.sin(S[C + i]), math.cos(S[C + i])
    for i in range(n):
        x, y, z = S[X + i], S[Y + i], S[Z + i]
        aside, ahead, factor, along = S[E + i], S[F + i], S[A + i], S[B + i]
        told = (S[KNOWN + i] > 0.0) & (S[RANGE + i] >= 1e-3)
        new_x = np.float64(np.float32((x * ahead - y * aside) * along * factor))
        new_y = np.float64(np.float32((x * aside + y * ahead) * along * factor))
        new_z = np.float64(np.float32((z * S[LASER_COSINE + i] + S[D + i] * S[LASER_SINE + i]) * factor))
        S[X + i] = new_x if told else x
        S[Y + i] = new_y if told else y
        S[Z + i] = new_z if told else z


@numba.njit(cache=True, nogil=True, error_model="numpy")
def meet_block(S: FloatArray, n: int, k: int, seen: SeenPlanes, extra_of_plane_m: FloatArray) -> None:
    """The plane that each ray most plausibly ended on, and what is said of it: HIT, PLANE, DISTANCE, COSINE, BESIDE, EXTRA.

    X, Y, Z, T of n points of slice k.   extra_of_plane_m: of the planes that take points, the first ones; EXTRA is below zero for
    the others. Range errors DISTANCE / along are compared without dividing. BESIDE: distance along the ray to the nearest other
    plane, as seen at a cosine of GRAZING at least.
    """
    _, n_lidar, w_lidar, omega, v, _, min_cosine, min_azimuth_cosine = seen
    turn_x, turn_y, turn_z = omega[k, 0], omega[k, 1], omega[k, 2]
    v_x, v_y, v_z = v[k, 0], v[k, 1], v[k, 2]
    planes, taking = n_lidar.shape[1], extra_of_plane_m.shape[0]
    everywhere = min_azimuth_cosine <= -1.5
    for i in range(n):
        x, y, z, t = S[X + i], S[Y + i], S[Z + i], S[T + i]
        range2 = x * x + y * y + z * z
        looked_at = (range2 >= 1e-6) & (everywhere | (x >= min_azimuth_cosine * math.sqrt(x * x + y * y)))
        # No plane is met slantwise enough by what is no return, or not looked at.
        S[RANGE + i] = math.sqrt(range2) if looked_at else np.inf
        S[HIT_X + i] = x + t * (turn_y * z - turn_z * y)
        S[HIT_Y + i] = y + t * (turn_z * x - turn_x * z)
        S[HIT_Z + i] = z + t * (turn_x * y - turn_y * x)
        S[A + i], S[B + i], S[PLANE + i], S[EXTRA + i] = -1.0, _FAR, -1.0, -1.0
    for j in range(planes):
        n_x, n_y, n_z, w = n_lidar[k, j, 0], n_lidar[k, j, 1], n_lidar[k, j, 2], w_lidar[k, j]
        nearing, extra_m = n_x * v_x + n_y * v_y + n_z * v_z, extra_of_plane_m[j] if j < taking else -1.0
        number, here = float(j), SEEN + 2 * j * BLOCK
        for i in range(n):
            along = n_x * S[HIT_X + i] + n_y * S[HIT_Y + i] + n_z * S[HIT_Z + i]
            away = along + S[T + i] * nearing + w
            S[here + i], S[here + BLOCK + i] = along, away
            best = (along < -min_cosine * S[RANGE + i]) & (abs(away) * S[A + i] > abs(S[B + i]) * along)
            S[A + i] = along if best else S[A + i]
            S[B + i] = away if best else S[B + i]
            S[PLANE + i] = number if best else S[PLANE + i]
            S[EXTRA + i] = extra_m if best else S[EXTRA + i]
    for i in range(n):
        x, y, z, t, error = S[HIT_X + i], S[HIT_Y + i], S[HIT_Z + i], S[T + i], S[B + i] / S[A + i]
        S[HIT_X + i] = x + t * v_x - error * x
        S[HIT_Y + i] = y + t * v_y - error * y
        S[HIT_Z + i] = z + t * v_z - error * z
        S[DISTANCE + i], S[COSINE + i] = S[B + i], S[A + i] / S[RANGE + i]
        S[B + i], S[C + i], S[D + i] = error, np.inf, 1.0
    for j in range(planes):
        number, here = float(j), SEEN + 2 * j * BLOCK
        for i in range(n):
            other = abs(S[here + BLOCK + i] - S[B + i] * S[here + i])
            across = max(abs(S[here + i]), GRAZING * S[RANGE + i])
            nearer = (S[PLANE + i] != number) & (other * S[D + i] < S[C + i] * across)
            S[C + i] = other if nearer else S[C + i]
            S[D + i] = across if nearer else S[D + i]
    for i in range(n):
        S[BESIDE + i] = S[C + i] * S[RANGE + i] / S[D + i]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def weight_of(
    x: float, y: float, z: float, d: float, cosine: float, ambiguous_m: float, extra_m: float, weighing: Weighing
) -> float:
    """Weight [1/m^2] of a hit at x, y, z, below zero where it does not count.

    extra_m: room in its plane's gate, below zero for none.   Where the ray meets the plane nearer to the farthest range than
    noise reaches, of returns only those that read short are there, and by the nearest only those that read long: none is taken.
    """
    range_std_m, surface_std_m, sigmas, margin_m, robust_sigmas, extra_stds, farthest_m, _, least_cosine, nearest_m = (
        weighing
    )
    variance = (range_std_m * cosine) ** 2 + surface_std_m**2
    std = math.sqrt(variance)
    room = sigmas * std + extra_m - abs(d)
    clear = ambiguous_m - (1.0 - RAMP) * margin_m
    range_m2, most_m = x * x + y * y + z * z, max(farthest_m - sigmas * range_std_m, 0.0)
    least_m = nearest_m + sigmas * range_std_m if nearest_m > 0.0 else 0.0
    facing = -cosine - least_cosine
    within = (range_m2 < most_m * most_m) & (range_m2 >= least_m * least_m)
    counts = (extra_m >= 0.0) & (room > 0.0) & (clear > 0.0) & within & (facing > 0.0)
    shortfall = max(1.0 - (d / (robust_sigmas * std + extra_m)) ** 2, 0.0)
    edge = min(room / (RAMP * std), 1.0)
    edge *= min(facing / (RAMP * least_cosine), 1.0)
    if margin_m > 0.0:
        edge *= min(clear / (RAMP * margin_m), 1.0)
    far = min((most_m - math.sqrt(range_m2)) / (RAMP * range_std_m), 1.0)
    edge = edge * far if range_m2 > (most_m - RAMP * range_std_m) ** 2 else edge
    near = min((math.sqrt(range_m2) - least_m) / (RAMP * range_std_m), 1.0)
    edge = edge * near if range_m2 < (least_m + RAMP * range_std_m) ** 2 else edge
    weight = edge * shortfall**2 / (variance + (extra_m / extra_stds) ** 2)
    return weight if counts else -1.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def weigh_block(S: FloatArray, n: int, slant: FloatArray, weighing: Weighing) -> None:
    """WEIGHT of n hits, whose DISTANCE becomes what it would be without the surface's slant.

    slant: (P + 2,) of grazing [rad], and of the incidence of each seen plane and of none [m].
    """
    grazing_rad = slant[0]
    for i in range(n):
        x, y, z, cosine = S[HIT_X + i], S[HIT_Y + i], S[HIT_Z + i], S[COSINE + i]
        d = S[DISTANCE + i] + slant[1 + int(S[PLANE + i])] * (1.0 + cosine)
        if grazing_rad != 0.0:
            d -= grazing_rad * math.sqrt(x * x + y * y + z * z) * math.sqrt(max(1.0 - cosine * cosine, 0.0))
        S[DISTANCE + i] = d
        S[WEIGHT + i] = weight_of(x, y, z, d, cosine, S[BESIDE + i], S[EXTRA + i], weighing)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def features_block(S: FloatArray, n: int, k: int, R: FloatArray, p: FloatArray) -> None:
    """Seven FEATUREs of n hits of slice k, the incidence's left out (laser_kernels.py), and their PLACEs: R x + p.

    X, Y, Z: the hits.   COSINE, NORMAL.   R (S, 3, 3), p (S, 3): to the middles of groups.
    """
    for i in range(n):
        x, y, z, seen = S[X + i], S[Y + i], S[Z + i], -S[COSINE + i]
        n_x, n_y, n_z = S[NORMAL_X + i], S[NORMAL_Y + i], S[NORMAL_Z + i]
        level = math.sqrt(x * x + y * y)
        r = math.sqrt(level * level + z * z)
        outward, aside = n_x * x + n_y * y, n_y * x - n_x * y
        upright = level <= 1e-9
        rise, around = z / level * outward, aside / level
        rise, around = 0.0 if upright else rise, 0.0 if upright else around
        S[FEATURE + i] = seen
        S[FEATURE + BLOCK + i] = level * n_z - rise
        S[FEATURE + 2 * BLOCK + i] = aside
        S[FEATURE + 3 * BLOCK + i] = seen * r
        S[FEATURE + 4 * BLOCK + i] = around * y
        S[FEATURE + 5 * BLOCK + i] = around * x
        S[FEATURE + 6 * BLOCK + i] = -r * math.sqrt(max(1.0 - seen * seen, 0.0))
    places_block(S, n, k, R, p)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def places_block(S: FloatArray, n: int, k: int, R: FloatArray, p: FloatArray) -> None:
    """PLACEs of n hits X, Y, Z of slice k: R x + p, to the middle of its group. R: (S, 3, 3), p: (S, 3)."""
    for a in range(3):
        r_x, r_y, r_z, shift, here = R[k, a, 0], R[k, a, 1], R[k, a, 2], p[k, a], PLACE + a * BLOCK
        for i in range(n):
            S[here + i] = r_x * S[X + i] + r_y * S[Y + i] + r_z * S[Z + i] + shift
