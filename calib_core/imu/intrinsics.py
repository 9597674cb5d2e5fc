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
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib_core.geometry import exp, hat
from calib_core.imu.preintegration import UpsampledImu
from calib_core.types import FloatArray

_LOWER = ((1, 0), (2, 0), (2, 1))


@dataclass(frozen=True, slots=True)
class ImuIntrinsics:
    """Values in the order of their names: scales (3,), axes yx zx zy (3,) [rad], rotation (3,) [rad], delay [s].

    accel_quadratic: (3,) [1/(m/s2)].   g_sensitivity: (9,) F by rows [rad/s/(m/s2)].   size_effect: (9,) by rows, where each
    axis' accelerometer is [m].
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
    return replace(
        readings,
        gyro=(readings.gyro - accel @ F.T) @ G.T,
        knot_gyro=(readings.knot_gyro - knot_accel @ F.T) @ G.T,
        accel=accel,
        knot_accel=knot_accel,
    )


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


#: Columns of `bias_equivalents`: gyroscope scale 3, axes 3, rotation 3, accelerometer scale 3, axes 3, delay 1, quadratic 3,
#: g-sensitivity 9, size effect 9.
COLUMNS = 37


def bias_equivalents(readings: UpsampledImu, intrinsics: ImuIntrinsics) -> tuple[FloatArray, FloatArray]:
    """What a unit of each parameter is as a bias of each link: gyroscope (L, 3, 37), accelerometer (L, 3, 37).

    readings: corrected about the intrinsics.   Units: rad/s and m/s2 per unit of the parameter.
    """
    w, f = readings.gyro.mean(axis=1), readings.accel.mean(axis=1)
    links = len(w)
    gyro, accel = np.zeros((links, 3, COLUMNS)), np.zeros((links, 3, COLUMNS))
    turn = exp(intrinsics.gyro_rotation)
    G, A = np.linalg.inv(intrinsics.gyro), np.linalg.inv(intrinsics.accel)
    turned = w @ turn.T
    for c in range(3):
        gyro[:, :, c] = turned[:, c, None] * G[:, c]
        accel[:, :, 9 + c] = f[:, c, None] * A[:, c]
    for c, (row, column) in enumerate(_LOWER):
        gyro[:, :, 3 + c] = turned[:, column, None] * G[:, row]
        accel[:, :, 12 + c] = f[:, column, None] * A[:, row]
    # M Exp(d) - M to first order: M hat(d), whatever the rotation; its own right Jacobian is 1 to half a rotation.
    gyro[:, :, 6:9] = -hat(w)
    accel[:, :, 15] = -np.diff(readings.knot_accel, axis=0) / readings.spacing_s
    accel[:, :, 16:19] = f[:, :, None] ** 2 * np.eye(3)
    for row in range(3):
        gyro[:, :, 19 + 3 * row : 22 + 3 * row] = f[:, None, :] * G[:, row, None]
    accel[:, :, 28:] = felt_beside(w, np.diff(readings.knot_gyro, axis=0) / readings.spacing_s)
    for own in (slice(9, 19), slice(28, 37)):
        gyro[:, :, own] = -(G @ intrinsics.g_sensitivity.reshape(3, 3)) @ accel[:, :, own]
    return gyro, accel
