"""IMU factors between consecutive scans, eq. (11), with analytic Jacobians, for all pairs at once.

With T the time from scan m to m + 1 and the measurements DR, Dv, Dp moved to first order by eq. (12):

    r_R = Log(DR' R' R+)
    r_v = R' (v+ - v - T g) - Dv
    r_p = R' (p+ - p - T v - 1/2 T^2 g) - Dp

Rotations are perturbed on the right; E = Exp(r_R), Ji the inverse right Jacobian at r_R, Jr the right one at the
correction's rotation vector:

    r_R:   phi  -Ji R+' R        phi+  Ji            b_g, t  -Ji E' Jr DR_D_.
    r_v:   phi  hat(r_v + Dv)    v  -R'   v+  R'
    r_p:   phi  hat(r_p + Dp)    p  -R'   v  -T R'   p+  R'

Blocks of a state: phi, p, v; of a residual: R, v, p. Whitening is left to weights.py and the caller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.geometry import exp, hat, log, right_jacobian, right_jacobian_inverse
from calib_core.paper.lidar_factor import CalibrationState, ScanStates
from calib_core.paper.preintegration import Preintegrated
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class ImuFactors:
    """Residuals (L, 9) and Jacobians: r_D_first, r_D_second (L, 9, 9); r_D_bg, r_D_ba (L, 9, 3); r_D_t (L, 9)."""

    residual: FloatArray
    r_D_first: FloatArray
    r_D_second: FloatArray
    r_D_bg: FloatArray
    r_D_ba: FloatArray
    r_D_t: FloatArray


def imu_residuals(
    measured: Preintegrated,
    duration_s: FloatArray,
    first: ScanStates,
    second: ScanStates,
    calibration: CalibrationState,
    gravity_world: FloatArray,
) -> FloatArray:
    """Residuals alone, (L, 9). measured: leading shape (L,).   duration_s: (L,) [s].   gravity_world: (3,) [m/s^2]."""
    c = calibration
    DR, Dv, Dp, _ = measured.corrected(c.gyro_bias_delta, c.accel_bias_delta, c.time_delta_s)
    T = duration_s[:, None]
    back = np.swapaxes(first.R, 1, 2)
    r_R = log(np.swapaxes(DR, 1, 2) @ back @ second.R)
    r_v = _apply(back, second.v - first.v - T * gravity_world) - Dv
    r_p = _apply(back, second.p - first.p - T * first.v - 0.5 * T**2 * gravity_world) - Dp
    return np.concatenate([r_R, r_v, r_p], axis=1)


def imu_factors(
    measured: Preintegrated,
    duration_s: FloatArray,
    first: ScanStates,
    second: ScanStates,
    calibration: CalibrationState,
    gravity_world: FloatArray,
) -> ImuFactors:
    """Residuals and Jacobians of all pairs; arguments as for `imu_residuals`."""
    c = calibration
    residual = imu_residuals(measured, duration_s, first, second, calibration, gravity_world)
    _, Dv, Dp, rotvec = measured.corrected(c.gyro_bias_delta, c.accel_bias_delta, c.time_delta_s)
    r_R = residual[:, :3]
    back = np.swapaxes(first.R, 1, 2)
    inverse = right_jacobian_inverse(r_R)
    count = residual.shape[0]
    D_first, D_second = np.zeros((count, 9, 9)), np.zeros((count, 9, 9))
    D_first[:, 0:3, 0:3] = -inverse @ np.swapaxes(second.R, 1, 2) @ first.R
    D_second[:, 0:3, 0:3] = inverse
    D_first[:, 3:6, 0:3] = hat(residual[:, 3:6] + Dv)
    D_first[:, 3:6, 6:9] = -back
    D_second[:, 3:6, 6:9] = back
    D_first[:, 6:9, 0:3] = hat(residual[:, 6:9] + Dp)
    D_first[:, 6:9, 3:6] = -back
    D_first[:, 6:9, 6:9] = -back * duration_s[:, None, None]
    D_second[:, 6:9, 3:6] = back
    turn = -inverse @ exp(-r_R) @ right_jacobian(rotvec)
    D_bg = np.concatenate([turn @ measured.DR_D_bg, -measured.Dv_D_bg, -measured.Dp_D_bg], axis=1)
    D_ba = np.concatenate([np.zeros((count, 3, 3)), -measured.Dv_D_ba, -measured.Dp_D_ba], axis=1)
    D_t = np.concatenate([_apply(turn, measured.DR_D_t), -measured.Dv_D_t, -measured.Dp_D_t], axis=1)
    return ImuFactors(residual, D_first, D_second, D_bg, D_ba, D_t)


def _apply(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    applied: FloatArray = (matrix @ vectors[..., None])[..., 0]
    return applied
