"""An IMU's own scale, axes and delay taken out of its readings, and what a change of them does to a link.

    reading = M (x + b') [+ F a],   M_g = (I + S_g + N_g) Exp(r_g),   M_a = I + S_a + N_a   (signs: calib_core/intrinsics.py)

with x the true rate or specific force in the IMU's frame. The corrected reading r' = M^-1 reading is x + b': all that follows
treats it as a reading whose bias is b' = M^-1 b. A later change dM adds -M^-1 dM r' to x, exactly what a bias greater by

    db' = M^-1 dM r'

would; over one link (10 ms) r' is as good as its mean. So every parameter's Jacobian is the bias's, turned by a (3,) vector a
link, and no factor has to know of intrinsics. An accelerometer late by `delay` is asked that much later (`upsample`); a change
of the delay by d is a bias greater by -d/dt r'_a d. A line that bends, q a^2, is taken out by the corrected r'_a itself; a change
dq is a bias greater by r'_a^2 dq. What the gyroscope feels of forces, F a, is taken out with the corrected
accelerometer's r'_a, whose own bias is part of the gyroscope's then; a change dF is a bias greater by M_g^-1 dF r'_a, and one
that is a bias of the accelerometer greater by db is one of the gyroscope less by M_g^-1 F db. An accelerometer that sits beside
the IMU's place by r feels w' x r + w x (w x r) more, which is linear in r: a change dr is a bias greater by the same of dr.

A low-pass filter's spread v and skew u are taken out of what is corrected by - v / 2 times its second derivative and + u / 6
times its third, those of a polynomial through some knots: of motion, not of noise. A change dv is a bias greater by dv / 2 times
the second, du one less by du / 6 times the third.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.geometry import exp, hat
from calib_core.imu.preintegration import UpsampledImu
from calib_core.paged import heed_pages, paged, set_aside
from calib_core.types import BoolArray, FloatArray, IntArray

#: Elements of a matrix, by row and column.
_DIAGONAL = ((0, 0), (1, 1), (2, 2))
_LOWER = ((1, 0), (2, 0), (2, 1))
_EVERY = tuple((row, column) for row in range(3) for column in range(3))
#: Knots on either side that tell how readings bend: 10 ms apart they leave motion of 5 Hz its second derivative, and 94 % of its
#: third.
_BESIDE = 3


@dataclass(frozen=True, slots=True)
class ImuIntrinsics:
    """Values in the order of their names: scales (3,), axes yx zx zy (3,) [rad], rotation (3,) [rad], delay [s].

    accel_quadratic: (3,) [1/(m/s2)].   g_sensitivity: (9,) F by rows [rad/s/(m/s2)].   size_effect: (9,) by rows, where each
    axis' accelerometer is [m].   low_pass_spread (2,) [s2], low_pass_skew (2,) [s3]: gyroscope, accelerometer.
    """

    gyro_scale: FloatArray
    gyro_axes: FloatArray
    gyro_rotation: FloatArray
    accel_scale: FloatArray
    accel_axes: FloatArray
    accel_delay_s: float
    accel_quadratic: FloatArray
    g_sensitivity: FloatArray
    size_effect: FloatArray = field(default_factory=lambda: np.zeros(9))
    low_pass_spread: FloatArray = field(default_factory=lambda: np.zeros(2))
    low_pass_skew: FloatArray = field(default_factory=lambda: np.zeros(2))

    @property
    def gyro(self) -> FloatArray:
        """M_g (3, 3): reading of the true rate."""
        return np.asarray(_triangular(self.gyro_scale, self.gyro_axes) @ exp(self.gyro_rotation))

    @property
    def accel(self) -> FloatArray:
        """M_a (3, 3): reading of the true specific force."""
        return _triangular(self.accel_scale, self.accel_axes)


def _triangular(scale: FloatArray, axes: FloatArray) -> FloatArray:
    M = np.diag(1.0 + scale)
    for value, (row, column) in zip(axes, _LOWER, strict=True):
        M[row, column] = value
    return M


def corrected(readings: UpsampledImu, intrinsics: ImuIntrinsics) -> UpsampledImu:
    """The readings with M taken out. The delay is the upsampling's own."""
    G, A = np.linalg.inv(intrinsics.gyro), np.linalg.inv(intrinsics.accel)
    F = intrinsics.g_sensitivity.reshape(3, 3)
    accel, knot_accel = (
        a - intrinsics.accel_quadratic * a**2 for a in (readings.accel @ A.T, readings.knot_accel @ A.T)
    )
    if intrinsics.size_effect.any():
        rate, knot_rate = (readings.gyro - accel @ F.T) @ G.T, (readings.knot_gyro - knot_accel @ F.T) @ G.T
        slope = np.asarray(np.gradient(rate.reshape(-1, 3), readings.gauss_s.ravel(), axis=0)).reshape(rate.shape)
        accel = accel - felt_beside(rate, slope) @ intrinsics.size_effect
        knot_slope = np.asarray(np.gradient(knot_rate, readings.spacing_s, axis=0))
        knot_accel = knot_accel - felt_beside(knot_rate, knot_slope) @ intrinsics.size_effect
    found = replace(
        readings,
        gyro=set_aside((readings.gyro - accel @ F.T) @ G.T),
        knot_gyro=(readings.knot_gyro - knot_accel @ F.T) @ G.T,
        accel=set_aside(accel),
        knot_accel=knot_accel,
    )
    if intrinsics.low_pass_spread.any() or intrinsics.low_pass_skew.any():
        return _sharpened(found, intrinsics.low_pass_spread, intrinsics.low_pass_skew)
    return found


def _sharpened(readings: UpsampledImu, spread_s2: FloatArray, skew_s3: FloatArray) -> UpsampledImu:
    """What was there before the IMU's own filter. spread_s2, skew_s3: (2,) gyroscope, accelerometer."""
    more = [
        unsmeared(knot, readings.spacing_s, float(v), float(u))
        for knot, v, u in zip((readings.knot_gyro, readings.knot_accel), spread_s2, skew_s3, strict=True)
    ]
    at = ((readings.gauss_s - readings.knots_s[:-1, None]) / readings.spacing_s)[..., None]
    gyro, accel = ((1.0 - at) * each[:-1, None] + at * each[1:, None] for each in more)
    return replace(
        readings,
        gyro=readings.gyro + gyro,
        knot_gyro=readings.knot_gyro + more[0],
        accel=readings.accel + accel,
        knot_accel=readings.knot_accel + more[1],
    )


def unsmeared(knot: FloatArray, spacing_s: float, spread_s2: float, skew_s3: float) -> FloatArray:
    """What has to be added to evenly spaced readings (K, 3) to take a filter of this spread and skew out of them."""
    second, third = bends(knot, spacing_s)
    return -0.5 * spread_s2 * second + skew_s3 / 6.0 * third


def bends(knot: FloatArray, spacing_s: float) -> tuple[FloatArray, FloatArray]:
    """Second and third derivatives (K, 3) each of what is evenly spaced (K, 3): of the quartic that fits seven of them best."""
    if len(knot) <= _BESIDE:
        return np.zeros_like(knot), np.zeros_like(knot)
    steps = np.arange(-_BESIDE, _BESIDE + 1)
    fit = np.linalg.pinv(steps[:, None] ** np.arange(5.0))
    # Beyond the ends as before them, turned about: no bend there.
    before, after = 2.0 * knot[:1] - knot[_BESIDE:0:-1], 2.0 * knot[-1:] - knot[-2 : -2 - _BESIDE : -1]
    seven = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, knot, after]), len(steps), axis=0)
    return seven @ fit[2] * (2.0 / spacing_s**2), seven @ fit[3] * (6.0 / spacing_s**3)


def felt_beside(rate_rad_s: FloatArray, slope_rad_s2: FloatArray) -> FloatArray:
    """What accelerometers feel more by a unit of each of the nine by which they are beside the IMU's place: (..., 3, 9).

    rate_rad_s, slope_rad_s2: (..., 3) rate of turn and its derivative.
    """
    spin = hat(rate_rad_s)
    by_place = hat(slope_rad_s2) + spin @ spin
    felt = np.zeros((*rate_rad_s.shape, 9))
    for axis in range(3):
        felt[..., axis, 3 * axis : 3 * axis + 3] = by_place[..., axis, :]
    return felt


#: The parameters, in order: gyroscope scale 3, axes 3, rotation 3, accelerometer scale 3, axes 3, delay 1, quadratic 3,
#: g-sensitivity 9, size effect 9, low-pass spread 2, skew 2.
COLUMNS = 41
#: (41,) which of them are the accelerometer's own.
_OF_ACCEL = np.isin(np.arange(COLUMNS), [*range(9, 19), *range(28, 37), 38, 40])


@dataclass(frozen=True, slots=True)
class BiasEquivalents:
    """What a unit of each of n parameters is as a bias of each link. Units: rad/s and m/s2 per unit of the parameter.

    own: (n, L, 3) as a bias of the sensor that it is of.   of_accel: (n,) which of them are the accelerometer's.
    gyro_D_accel: (3, 3) what a bias of the accelerometer is as one of the gyroscope, which feels forces.
    """

    own: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    of_accel: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    gyro_D_accel: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def of_links(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """Gyroscope, accelerometer: (.., 3, n) each, of the links first..last (exclusive)."""
        own = self.own[:, first:last].transpose(1, 2, 0)
        heed_pages(own.nbytes)
        accel = np.where(self.of_accel, own, 0.0)
        return np.where(self.of_accel, 0.0, own) + self.gyro_D_accel @ accel, accel

    def times(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What values (n,) are as biases: gyroscope, accelerometer, (L, 3) each."""
        each = np.stack([np.where(self.of_accel, 0.0, values), np.where(self.of_accel, values, 0.0)])
        gyro, accel = np.tensordot(each, self.own, 1)
        heed_pages(self.own.nbytes)
        return gyro + accel @ self.gyro_D_accel.T, accel


def bias_equivalents(readings: UpsampledImu, intrinsics: ImuIntrinsics, asked: IntArray) -> BiasEquivalents:
    """Of these parameters, by their places among all. readings: corrected about the intrinsics."""
    G, F = np.linalg.inv(intrinsics.gyro), intrinsics.g_sensitivity.reshape(3, 3)
    (own,) = paged((len(asked), len(readings.gyro), 3))
    first = 0
    for count, make in _families(readings, intrinsics):
        mine = np.flatnonzero((asked >= first) & (asked < first + count))
        if mine.size:
            own[mine] = make()[asked[mine] - first]
            heed_pages(own[0].nbytes * len(mine))
        first += count
    return BiasEquivalents(own, _OF_ACCEL[asked], -(G @ F))


def _families(readings: UpsampledImu, intrinsics: ImuIntrinsics) -> Iterator[tuple[int, Callable[[], FloatArray]]]:
    """How many parameters each family of them has, and what makes their (n, L, 3): in order, those not asked for never made."""
    w, f = np.asarray(readings.gyro.mean(axis=1)), np.asarray(readings.accel.mean(axis=1))
    G, A = (np.asarray(np.linalg.inv(each), np.float64) for each in (intrinsics.gyro, intrinsics.accel))
    turned = w @ exp(intrinsics.gyro_rotation).T

    def scaled(of: FloatArray, M: FloatArray, pairs: Sequence[tuple[int, int]]) -> FloatArray:
        return np.stack([of[:, column, None] * M[:, row] for row, column in pairs])

    yield 3, lambda: scaled(turned, G, _DIAGONAL)
    yield 3, lambda: scaled(turned, G, _LOWER)
    # M Exp(d) - M to first order: M hat(d), whatever the rotation; its own right Jacobian is 1 to half a rotation.
    yield 3, lambda: -hat(w).transpose(2, 0, 1)
    yield 3, lambda: scaled(f, A, _DIAGONAL)
    yield 3, lambda: scaled(f, A, _LOWER)
    yield 1, lambda: -np.diff(readings.knot_accel, axis=0)[None] / readings.spacing_s
    yield 3, lambda: f**2 * np.eye(3)[:, None]
    yield 9, lambda: scaled(f, G, _EVERY)
    yield 9, lambda: felt_beside(w, np.diff(readings.knot_gyro, axis=0) / readings.spacing_s).transpose(2, 0, 1)

    def bent(which: int) -> FloatArray:
        each = (bends(knot, readings.spacing_s)[which] for knot in (readings.knot_gyro, readings.knot_accel))
        return np.stack([0.5 * (bend[:-1] + bend[1:]) for bend in each])

    yield 2, lambda: 0.5 * bent(0)
    yield 2, lambda: -bent(1) / 6.0
