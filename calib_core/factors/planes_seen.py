"""Planes as the lidar sees them from knots, and what that changes with: compiled, one bin of points after another.

With m = R_k' n at knot k, looked up later by delta, phi = -omega delta and dp = -v delta:

    n_lidar = R_c' m,    w_lidar = m . p_c + n . p_k + w
    d n_lidar = R_c' hat(m) phi + hat(n_lidar) theta + R_c' R_k' B eta
    d w_lidar = (p_c x m) . phi + n . dp + m . dp_c + (R_k p_c + p_k) . B eta + dw

where phi turns the knot, and the bin sits at Exp(-omega delta) from it.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.geometry.compiled import exp_into, multiply_into
from calib_core.types import FloatArray, IntArray

#: Columns of J, and what they are of: the knot, the calibration's seven, the plane; the clocks' rate where it is unknown.
COLUMNS = 19
OF_KNOT, OF_CALIBRATION, OF_PLANE, OF_CLOCK = slice(0, 9), slice(9, 16), slice(16, 19), slice(19, 20)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moved_knot(
    J: FloatArray,
    m: FloatArray,
    n: FloatArray,
    omega: FloatArray,
    v: FloatArray,
    delta_s: float,
    R_imu_lidar: FloatArray,
    p_imu_lidar: FloatArray,
    phi: FloatArray,
    turn: FloatArray,
) -> None:
    """Fills the columns of the knot and of the time offset of one bin's J (4, 19). phi (4, 3), turn (3, 3): room to work."""
    for r in range(4):
        c0, c1, c2 = p_imu_lidar[0], p_imu_lidar[1], p_imu_lidar[2]
        if r < 3:
            c0, c1, c2 = R_imu_lidar[0, r], R_imu_lidar[1, r], R_imu_lidar[2, r]
        # c' hat(m) = (c x m)' for the lidar's axes c too.
        phi[r, 0], phi[r, 1], phi[r, 2] = c1 * m[2] - c2 * m[1], c2 * m[0] - c0 * m[2], c0 * m[1] - c1 * m[0]
        J[r, 15] = -(phi[r, 0] * omega[0] + phi[r, 1] * omega[1] + phi[r, 2] * omega[2])
    J[3, 15] -= n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
    exp_into(omega[0] * delta_s, omega[1] * delta_s, omega[2] * delta_s, turn)
    for r in range(4):
        for c in range(3):
            J[r, c] = phi[r, 0] * turn[0, c] + phi[r, 1] * turn[1, c] + phi[r, 2] * turn[2, c]
    for c in range(3):
        J[3, 3 + c] = n[c]
        J[3, 6 + c] = -delta_s * n[c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _moved_rest(
    J: FloatArray,
    m: FloatArray,
    at: FloatArray,
    here: FloatArray,
    R_imu_lidar: FloatArray,
    p_imu_lidar: FloatArray,
    axes: FloatArray,
    a: FloatArray,
) -> None:
    """Fills the columns of the extrinsic and the plane of one bin's J (4, 19)."""
    J[0, 10], J[0, 11], J[1, 11] = -a[2], a[1], -a[0]
    J[1, 9], J[2, 9], J[2, 10] = a[2], -a[1], a[0]
    for c in range(3):
        J[3, 12 + c] = m[c]
    for e in range(2):
        J[3, 16 + e] = axes[e, 0] * at[0] + axes[e, 1] * at[1] + axes[e, 2] * at[2]
        for c in range(3):
            seen = here[0, c] * axes[e, 0] + here[1, c] * axes[e, 1] + here[2, c] * axes[e, 2]  # by the IMU
            J[3, 16 + e] += seen * p_imu_lidar[c]
            for r in range(3):
                J[r, 16 + e] += R_imu_lidar[c, r] * seen
    J[3, 18] = 1.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def planes_seen_kernel(
    knot: IntArray,
    plane: IntArray,
    R: FloatArray,
    p: FloatArray,
    v: FloatArray,
    omega: FloatArray,
    delta_s: FloatArray,
    R_imu_lidar: FloatArray,
    p_imu_lidar: FloatArray,
    normals: FloatArray,
    offsets: FloatArray,
    axes: FloatArray,
    lever_s: FloatArray,
    a: FloatArray,
    J: FloatArray,
) -> None:
    """Fills a (B, 5) = [n_lidar, w_lidar, 1] and J (B, 4, 19): knot phi p v | theta p_c offset | plane; (0, ..) for none.

    knot, plane: (B,).   R (K, 3, 3), p, v (K, 3): knots, map.   omega: (K, 3) imu axes.   delta_s: (B,) later than the
    bins' making.   axes: (P, 2, 3) in which normals turn.   lever_s: (B,) of offset for a unit of the clocks' rate, which
    has a 20th column then; (0,) for none.
    """
    back, turn, here, m = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    n, at, phi = np.empty(3), np.empty(3), np.empty((4, 3))
    for b in range(knot.shape[0]):
        k, j, delta = knot[b], plane[b], delta_s[b]
        x, y, z = omega[k, 0] * delta, omega[k, 1] * delta, omega[k, 2] * delta
        exp_into(-x, -y, -z, back)
        multiply_into(R[k], back, here)
        w = offsets[j]
        for c in range(3):
            n[c] = normals[j, c]
            at[c] = p[k, c] - v[k, c] * delta
        for c in range(3):
            m[c] = here[0, c] * n[0] + here[1, c] * n[1] + here[2, c] * n[2]
            w += n[c] * at[c]
        for c in range(3):
            w += m[c] * p_imu_lidar[c]
            a[b, c] = R_imu_lidar[0, c] * m[0] + R_imu_lidar[1, c] * m[1] + R_imu_lidar[2, c] * m[2]
        a[b, 3] = w
        a[b, 4] = 1.0
        if J.shape[0] > 0:
            J[b] = 0.0
            _moved_knot(J[b], m, n, omega[k], v[k], delta, R_imu_lidar, p_imu_lidar, phi, turn)
            _moved_rest(J[b], m, at, here, R_imu_lidar, p_imu_lidar, axes[j], a[b])
            if lever_s.shape[0] > 0:
                for r in range(4):
                    J[b, r, 19] = J[b, r, 15] * lever_s[b]
