"""The IMU's links one by one, compiled (imu.py has the equations). Each has a NumPy twin in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.geometry.compiled import (
    exp_into,
    log_into,
    multiply_into,
    right_jacobian_inverse_into,
    transposed_by_into,
)
from calib_core.types import FloatArray


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _against(R: FloatArray, x: float, y: float, z: float, out: FloatArray) -> None:
    """Out = R' (x, y, z)."""
    for i in range(3):
        out[i] = R[0, i] * x + R[1, i] * y + R[2, i] * z


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _raw_into(
    k: int,
    h: float,
    DR: FloatArray,
    Dv: FloatArray,
    Dp: FloatArray,
    DR_D_bg: FloatArray,
    Dv_D_bg: FloatArray,
    Dv_D_ba: FloatArray,
    Dp_D_bg: FloatArray,
    Dp_D_ba: FloatArray,
    R: FloatArray,
    p: FloatArray,
    v: FloatArray,
    gravity: FloatArray,
    dbg: FloatArray,
    dba: FloatArray,
    work: FloatArray,
    apart: FloatArray,
    raw: FloatArray,
) -> None:
    """Fills raw (9,) with link k's residual before it is whitened, and apart (2, 3) with R0'(..) of velocity and position.

    work: (4, 3, 3), of which the last is R0' R1 after.
    """
    for i in range(3):
        work[0, 0, i] = DR_D_bg[k, i, 0] * dbg[k, 0] + DR_D_bg[k, i, 1] * dbg[k, 1] + DR_D_bg[k, i, 2] * dbg[k, 2]
    exp_into(work[0, 0, 0], work[0, 0, 1], work[0, 0, 2], work[1])
    multiply_into(DR[k], work[1], work[2])
    transposed_by_into(R[k], R[k + 1], work[3])
    transposed_by_into(work[2], work[3], work[1])
    log_into(work[1], raw)
    _against(
        R[k],
        v[k + 1, 0] - v[k, 0] - gravity[0] * h,
        v[k + 1, 1] - v[k, 1] - gravity[1] * h,
        v[k + 1, 2] - v[k, 2] - gravity[2] * h,
        apart[0],
    )
    fallen = 0.5 * h * h
    _against(
        R[k],
        p[k + 1, 0] - p[k, 0] - v[k, 0] * h - fallen * gravity[0],
        p[k + 1, 1] - p[k, 1] - v[k, 1] * h - fallen * gravity[1],
        p[k + 1, 2] - p[k, 2] - v[k, 2] * h - fallen * gravity[2],
        apart[1],
    )
    for i in range(3):
        velocity, place = Dv[k, i], Dp[k, i]
        for j in range(3):
            velocity += Dv_D_bg[k, i, j] * dbg[k, j] + Dv_D_ba[k, i, j] * dba[k, j]
            place += Dp_D_bg[k, i, j] * dbg[k, j] + Dp_D_ba[k, i, j] * dba[k, j]
        raw[3 + i], raw[6 + i] = apart[0, i] - velocity, apart[1, i] - place


@numba.njit(cache=True, nogil=True, error_model="numpy")
def link_residuals_kernel(
    h: float,
    DR: FloatArray,
    Dv: FloatArray,
    Dp: FloatArray,
    DR_D_bg: FloatArray,
    Dv_D_bg: FloatArray,
    Dv_D_ba: FloatArray,
    Dp_D_bg: FloatArray,
    Dp_D_ba: FloatArray,
    sqrt_info: FloatArray,
    R: FloatArray,
    p: FloatArray,
    v: FloatArray,
    gravity: FloatArray,
    dbg: FloatArray,
    dba: FloatArray,
    residual: FloatArray,
) -> None:
    """Fills residual (L, 9), whitened."""
    work, apart, raw = np.empty((4, 3, 3)), np.empty((2, 3)), np.empty(9)
    for k in range(DR.shape[0]):
        _raw_into(
            k, h, DR, Dv, Dp, DR_D_bg, Dv_D_bg, Dv_D_ba, Dp_D_bg, Dp_D_ba, R, p, v, gravity, dbg, dba, work, apart, raw
        )
        for r in range(9):
            value = 0.0
            for c in range(r + 1):
                value += sqrt_info[k, r, c] * raw[c]
            residual[k, r] = value


@numba.njit(cache=True, nogil=True, error_model="numpy")
def link_factors_kernel(
    h: float,
    DR: FloatArray,
    Dv: FloatArray,
    Dp: FloatArray,
    DR_D_bg: FloatArray,
    Dv_D_bg: FloatArray,
    Dv_D_ba: FloatArray,
    Dp_D_bg: FloatArray,
    Dp_D_ba: FloatArray,
    sqrt_info: FloatArray,
    R: FloatArray,
    p: FloatArray,
    v: FloatArray,
    gravity: FloatArray,
    dbg: FloatArray,
    dba: FloatArray,
    residual: FloatArray,
    first: FloatArray,
    second: FloatArray,
    by_gravity: FloatArray,
    by_gyro_bias: FloatArray,
    by_accel_bias: FloatArray,
) -> None:
    """Fills residual (L, 9), first and second (L, 9, 9) of the knots, the others (L, 9, 3): all whitened.

    Columns of a knot: turn, place, velocity. Rows: rotation, velocity, position. sqrt_info is lower triangular.
    """
    work, apart, raw = np.empty((4, 3, 3)), np.empty((2, 3)), np.empty(9)
    Jinv, back, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    by_first, by_bias = np.empty((3, 3)), np.empty((3, 3))
    hats = np.zeros((2, 3, 3))
    for k in range(DR.shape[0]):
        _raw_into(
            k, h, DR, Dv, Dp, DR_D_bg, Dv_D_bg, Dv_D_ba, Dp_D_bg, Dp_D_ba, R, p, v, gravity, dbg, dba, work, apart, raw
        )
        right_jacobian_inverse_into(raw[0], raw[1], raw[2], Jinv)
        for i in range(3):
            for j in range(3):
                turned[i, j] = work[3, j, i]  # R1' R0
        multiply_into(Jinv, turned, by_first)
        exp_into(-raw[0], -raw[1], -raw[2], back)
        multiply_into(Jinv, back, turned)
        multiply_into(turned, DR_D_bg[k], by_bias)
        for d in range(2):
            hats[d, 0, 1], hats[d, 0, 2], hats[d, 1, 2] = -apart[d, 2], apart[d, 1], -apart[d, 0]
            hats[d, 1, 0], hats[d, 2, 0], hats[d, 2, 1] = apart[d, 2], -apart[d, 1], apart[d, 0]
        for r in range(9):
            value = 0.0
            for c in range(r + 1):
                value += sqrt_info[k, r, c] * raw[c]
            residual[k, r] = value
            W = sqrt_info[k, r]
            for j in range(3):
                turn, next_turn, gyro, accel, velocity, place = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(3):
                    turn -= W[i] * by_first[i, j]
                    next_turn += W[i] * Jinv[i, j]
                    gyro -= W[i] * by_bias[i, j]
                    turn += W[3 + i] * hats[0, i, j] + W[6 + i] * hats[1, i, j]
                    gyro -= W[3 + i] * Dv_D_bg[k, i, j] + W[6 + i] * Dp_D_bg[k, i, j]
                    accel -= W[3 + i] * Dv_D_ba[k, i, j] + W[6 + i] * Dp_D_ba[k, i, j]
                    velocity += W[3 + i] * R[k, j, i]  # W R0'
                    place += W[6 + i] * R[k, j, i]
                first[k, r, j], first[k, r, 3 + j], first[k, r, 6 + j] = turn, -place, -velocity - h * place
                second[k, r, j], second[k, r, 3 + j], second[k, r, 6 + j] = next_turn, place, velocity
                by_gravity[k, r, j] = -h * velocity - 0.5 * h * h * place
                by_gyro_bias[k, r, j], by_accel_bias[k, r, j] = gyro, accel
