"""Links preintegrated one by one, compiled (preintegration.py has the equations). Each has a NumPy twin in the tests."""

from __future__ import annotations

import math

import numba
import numpy as np

from calib_core.geometry.compiled import exp_into, multiply_into, right_jacobian_into, turn_into
from calib_core.types import FloatArray

#: Where the two Gauss points of a substep are.
_EARLY, _LATE = 0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0
_ROOT_3 = math.sqrt(3.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def preintegrate_kernel(
    spacing_s: float,
    gyro: FloatArray,
    accel: FloatArray,
    gyro_bias: FloatArray,
    accel_bias: FloatArray,
    DR: FloatArray,
    Dv: FloatArray,
    Dp: FloatArray,
    DR_D_bg: FloatArray,
    Dv_D_bg: FloatArray,
    Dv_D_ba: FloatArray,
    Dp_D_bg: FloatArray,
    Dp_D_ba: FloatArray,
) -> None:
    """Fills the measurements of L links and their dependence on the biases, which begin at zero.

    gyro, accel: (L, G, 3) at Gauss points.   gyro_bias, accel_bias, Dv, Dp: (L, 3).   DR and the others: (L, 3, 3).
    """
    substeps = gyro.shape[1] // 2
    delta = spacing_s / substeps
    w, f, along = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    mean, slope, bend = np.empty(3), np.empty(3), np.empty(3)
    turned, R, step, Jr, JR_next = (
        np.empty((3, 3)),
        np.empty((2, 3, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((3, 3)),
    )
    force, J, by_gyro = np.empty((3, 3)), np.empty((3, 3)), np.empty((2, 3, 3))
    for k in range(gyro.shape[0]):
        R_now, JR = DR[k], DR_D_bg[k]
        for i in range(3):
            for j in range(3):
                R_now[i, j] = 1.0 if i == j else 0.0
        for s in range(substeps):
            for g in range(2):
                for i in range(3):
                    w[g, i] = gyro[k, 2 * s + g, i] - gyro_bias[k, i]
                    f[g, i] = accel[k, 2 * s + g, i] - accel_bias[k, i]
            for i in range(3):
                n, m = (i + 1) % 3, (i + 2) % 3
                mean[i] = 0.5 * (w[0, i] + w[1, i])
                slope[i] = _ROOT_3 * (w[1, i] - w[0, i])
                bend[i] = _ROOT_3 / 12.0 * delta**2 * (w[0, n] * w[1, m] - w[0, m] * w[1, n])
            for g in range(2):
                at = _EARLY if g == 0 else _LATE
                for i in range(3):
                    along[g, i] = delta * (mean[i] * at + slope[i] * (at * at - at) / 2) + at**3 * bend[i]
                exp_into(along[g, 0], along[g, 1], along[g, 2], turned)
                multiply_into(R_now, turned, R[g])
            x, y, z = delta * mean[0] + bend[0], delta * mean[1] + bend[1], delta * mean[2] + bend[2]
            exp_into(x, y, z, step)
            right_jacobian_into(x, y, z, Jr)
            for i in range(3):
                for j in range(3):
                    back = step[0, i] * JR[0, j] + step[1, i] * JR[1, j] + step[2, i] * JR[2, j]
                    JR_next[i, j] = back - delta * Jr[i, j]
            for g in range(2):
                at = _EARLY if g == 0 else _LATE
                # R hat(f) J, with R taken linearly in the gyroscope's bias across the substep.
                for j in range(3):
                    for i in range(3):
                        J[i, j] = JR[i, j] + at * (JR_next[i, j] - JR[i, j])
                    force[0, j] = f[g, 1] * J[2, j] - f[g, 2] * J[1, j]
                    force[1, j] = f[g, 2] * J[0, j] - f[g, 0] * J[2, j]
                    force[2, j] = f[g, 0] * J[1, j] - f[g, 1] * J[0, j]
                multiply_into(R[g], force, by_gyro[g])
                turn_into(R[g], f[g], along[g])
            early, late = 0.5 * delta**2 * (1.0 - _EARLY), 0.5 * delta**2 * (1.0 - _LATE)
            for i in range(3):
                Dp[k, i] += Dv[k, i] * delta + early * along[0, i] + late * along[1, i]
                Dv[k, i] += 0.5 * delta * (along[0, i] + along[1, i])
                for j in range(3):
                    Dp_D_bg[k, i, j] += Dv_D_bg[k, i, j] * delta - early * by_gyro[0, i, j] - late * by_gyro[1, i, j]
                    Dp_D_ba[k, i, j] += Dv_D_ba[k, i, j] * delta - early * R[0, i, j] - late * R[1, i, j]
                    Dv_D_bg[k, i, j] -= 0.5 * delta * (by_gyro[0, i, j] + by_gyro[1, i, j])
                    Dv_D_ba[k, i, j] -= 0.5 * delta * (R[0, i, j] + R[1, i, j])
            multiply_into(R_now, step, turned)
            for i in range(3):
                for j in range(3):
                    R_now[i, j], JR[i, j] = turned[i, j], JR_next[i, j]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sqrt_info_kernel(
    spacing_s: float, gyro_density2: FloatArray, accel_density2: FloatArray, force: FloatArray, sqrt_info: FloatArray
) -> None:
    """Fills sqrt_info (L, 9, 9), lower triangular.

    gyro_density2, accel_density2: (L, 3) squared white noise of each link.   force: (L, 3) [m/s2] its mean, without bias.
    """
    h = spacing_s
    A, GAt, AGAt = np.zeros((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    cov, inverse, std = np.zeros((9, 9)), np.zeros((9, 9)), np.empty(9)
    for k in range(force.shape[0]):
        A[0, 1], A[0, 2], A[1, 2] = force[k, 2], -force[k, 1], force[k, 0]
        A[1, 0], A[2, 0], A[2, 1] = -force[k, 2], force[k, 1], -force[k, 0]
        for i in range(3):
            for j in range(3):
                GAt[i, j] = gyro_density2[k, i] * A[j, i]
        multiply_into(A, GAt, AGAt)
        for i in range(3):
            for j in range(3):
                G = gyro_density2[k, i] if i == j else 0.0
                F = accel_density2[k, i] if i == j else 0.0
                # The lower half alone is read.
                cov[i, j] = G * h
                cov[3 + i, j] = GAt[j, i] * h**2 / 2
                cov[6 + i, j] = GAt[j, i] * h**3 / 6
                cov[3 + i, 3 + j] = F * h + AGAt[i, j] * h**3 / 3
                cov[6 + i, 3 + j] = F * h**2 / 2 + AGAt[i, j] * h**4 / 8
                cov[6 + i, 6 + j] = F * h**3 / 3 + AGAt[i, j] * h**5 / 20
        for i in range(9):
            std[i] = math.sqrt(cov[i, i])
        for i in range(9):
            for j in range(i + 1):
                value = cov[i, j] / (std[i] * std[j])
                for m in range(j):
                    value -= cov[m, i] * cov[m, j]
                # The factor lies in the upper half, transposed: what is read of the lower one stays.
                cov[j, i] = math.sqrt(value) if i == j else value / cov[j, j]
        for c in range(9):
            for r in range(c, 9):
                value = 1.0 if r == c else 0.0
                for m in range(c, r):
                    value -= cov[m, r] * inverse[m, c]
                inverse[r, c] = value / cov[r, r]
        for r in range(9):
            for c in range(9):
                sqrt_info[k, r, c] = inverse[r, c] / std[c] if c <= r else 0.0
