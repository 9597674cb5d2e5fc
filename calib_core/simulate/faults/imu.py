"""Inertial readings of an IMU that is not ideal.

    gyroscope(t)     = (I + S_g + N_g) Exp(r_g) w(t) + A (f + e)(t)    S: scales of the axes, on the diagonal
    accelerometer(t) = (I + S_a + N_a) (f + e + q f^2)(t - delay)      N: axes off square, strictly below it

with w, f the true angular rate and specific force in the axes that the accelerometer defines, and e what axis k feels of turns
for sitting at r_k instead of the IMU's place: axis k of w' x r_k + w x (w x r_k); q bends the axes' lines. A low-pass filter
(second order, Butterworth) or two equal poles act on all of them before; the stamps allow for their delay, so that slow motion is
in time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.spatial.transform import Rotation

from calib_core.simulate.motion import Vector
from calib_core.types import FloatArray

_ZERO = (0.0, 0.0, 0.0)
#: Readings at given instants: t_s (N,) to angular rate and specific force, (N, 3) each.
Readings = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
#: Points at which the filter's answer is integrated, and the time constants after which it is over (it is then below 2e-6).
_FILTER_POINTS, _FILTER_LASTS = 48, 16.0
#: Half the span of the difference that is the rate's derivative: motion of 100 Hz loses 2e-8 of it.
_SLOPE_S = 5e-7


@dataclass(frozen=True, slots=True)
class ImuDeviations:
    """What sets one IMU apart from an ideal one; see the module. *_axes_rad: yx, zx, zy.   g_sensitivity: A by rows
    [rad/s/(m/s2)].   accel_quadratic_s2_m: q.   accel_places_m: r_x, r_y, r_z.   low_pass_hz, pole_s:
    0 for none."""

    gyro_scale: Vector = _ZERO
    gyro_axes_rad: Vector = _ZERO
    gyro_rotation_rad: Vector = _ZERO
    accel_scale: Vector = _ZERO
    accel_axes_rad: Vector = _ZERO
    g_sensitivity: tuple[float, ...] = (0.0,) * 9
    accel_delay_s: float = 0.0
    accel_quadratic_s2_m: Vector = _ZERO
    accel_places_m: tuple[float, ...] = (0.0,) * 9
    low_pass_hz: float = 0.0
    pole_s: float = 0.0

    def readings(self, exact: Readings, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What this IMU reads, without noise and bias, where an ideal one would read `exact`. t_s: (N,) [s]."""
        if self == IDEAL_IMU:
            return exact(t_s)
        felt = apart(exact, np.reshape(self.accel_places_m, (3, 3))) if any(self.accel_places_m) else exact
        seen = filtered(felt, self.low_pass_hz) if self.low_pass_hz else felt
        seen = lagging(seen, self.pole_s) if self.pole_s else seen
        rate, force = seen(t_s)
        late = seen(t_s - self.accel_delay_s)[1] if self.accel_delay_s else force
        turned = Rotation.from_rotvec(self.gyro_rotation_rad).as_matrix()
        gyro_matrix = mixing(self.gyro_scale, self.gyro_axes_rad) @ turned
        gyro = rate @ gyro_matrix.T + force @ np.reshape(self.g_sensitivity, (3, 3)).T
        bent = late + np.asarray(self.accel_quadratic_s2_m) * late**2
        return gyro, bent @ mixing(self.accel_scale, self.accel_axes_rad).T

    @property
    def low_pass_moments(self) -> tuple[float, float]:
        """Second [s2] and third [s3] central moment of what the filters make of a jolt; those of one after the other add up.

        H(s) = 1 / (1 + sqrt(2) s / w + (s / w)^2) has none and -2 sqrt(2) / w^3, 1 / (1 + T s)^2 has 2 T^2 and 4 T^3.
        """
        skew_s3 = -2.0 * np.sqrt(2.0) / (2.0 * np.pi * self.low_pass_hz) ** 3 if self.low_pass_hz else 0.0
        return 2.0 * self.pole_s**2, float(skew_s3 + 4.0 * self.pole_s**3)


IDEAL_IMU = ImuDeviations()


def mixing(scale: Vector, axes_rad: Vector) -> FloatArray:
    """I + S + N, (3, 3)."""
    matrix = np.diag(1.0 + np.asarray(scale, dtype=np.float64))
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = axes_rad
    return matrix


def apart(exact: Readings, places_m: FloatArray) -> Readings:
    """The readings where the accelerometer of each axis sits elsewhere. places_m: (3, 3) r_x, r_y, r_z by rows."""

    def felt(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        rate, force = exact(t_s)
        slope = (exact(t_s + _SLOPE_S)[0] - exact(t_s - _SLOPE_S)[0]) / (2.0 * _SLOPE_S)
        more = [
            (np.cross(slope, place) + np.cross(rate, np.cross(rate, place)))[:, axis]
            for axis, place in enumerate(places_m)
        ]
        return rate, force + np.stack(more, axis=1)

    return felt


def filtered(exact: Readings, cutoff_hz: float) -> Readings:
    """The readings behind a second-order Butterworth filter, stamped earlier by its delay.

    Its answer to a jolt is w / sin(q) exp(-cos(q) w u) sin(sin(q) w u), q = 45 deg, at time u after it.
    """
    rate = 2.0 * np.pi * cutoff_hz * np.sqrt(0.5)
    return _through(exact, rate, lambda v: np.exp(-v) * np.sin(v))


def lagging(exact: Readings, pole_s: float) -> Readings:
    """The readings behind two equal poles, u / T^2 exp(-u / T) at time u after a jolt, stamped earlier by their delay."""
    return _through(exact, 1.0 / pole_s, lambda v: v * np.exp(-v))


def _through(exact: Readings, rate: float, answer: Callable[[FloatArray], FloatArray]) -> Readings:
    """The readings behind a filter, stamped earlier by its delay. answer: to a jolt, of time in units of 1 / rate [s]."""
    nodes, weights = leggauss(_FILTER_POINTS)
    v = 0.5 * (nodes + 1.0) * _FILTER_LASTS
    u = v / rate
    weights = weights * answer(v)
    weights /= weights.sum()
    delay = float(weights @ u)

    def seen(t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        rates, forces = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        for weight, lag in zip(weights, u - delay, strict=True):
            rate_then, force_then = exact(t_s - lag)
            rates += weight * rate_then
            forces += weight * force_then
        return rates, forces

    return seen
