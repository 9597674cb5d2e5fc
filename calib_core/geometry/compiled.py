"""Single rotations for compiled loops, which cannot call so3.py, and small triangles by the thousand."""

from __future__ import annotations

import math

import numba
import numpy as np

from calib_core.types import FloatArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def exp_into(x: float, y: float, z: float, R: FloatArray) -> None:
    """Fills R (3, 3) with the rotation of a rotation vector [rad]."""
    xx, yy, zz = x * x, y * y, z * z
    theta = math.sqrt(xx + yy + zz)
    a = math.sin(theta) / theta if theta > 1e-8 else 1.0
    half = 0.5 * theta
    b = 0.5 * (math.sin(half) / half) ** 2 if half > 1e-8 else 0.5
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - b * (yy + zz), b * x * y - a * z, b * x * z + a * y
    R[1, 0], R[1, 1], R[1, 2] = b * x * y + a * z, 1.0 - b * (xx + zz), b * y * z - a * x
    R[2, 0], R[2, 1], R[2, 2] = b * x * z - a * y, b * y * z + a * x, 1.0 - b * (xx + yy)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def multiply_into(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """Out = A B, (3, 3) each: a library's product would take longer to call than to do."""
    for r in range(3):
        for c in range(3):
            out[r, c] = A[r, 0] * B[0, c] + A[r, 1] * B[1, c] + A[r, 2] * B[2, c]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def turn_into(A: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Out = A x.   A: (3, 3).   x, out: (3,)."""
    for r in range(3):
        out[r] = A[r, 0] * x[0] + A[r, 1] * x[1] + A[r, 2] * x[2]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def invert_lower(L: FloatArray, inverse: FloatArray) -> None:
    """Fills inverse (N, n, n) with those of lower triangular matrices L (N, n, n)."""
    n = L.shape[1]
    for k in range(L.shape[0]):
        for c in range(n):
            for r in range(n):
                if r < c:
                    inverse[k, r, c] = 0.0
                    continue
                value = 1.0 if r == c else 0.0
                for m in range(c, r):
                    value -= L[k, r, m] * inverse[k, m, c]
                inverse[k, r, c] = value / L[k, r, r]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def log_of(R: FloatArray) -> FloatArray:
    """The rotation vector (3,) [rad] of a rotation. Digits are lost towards pi, where so3.log is to be taken."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    w = 1.0 + R[0, 0] + R[1, 1] + R[2, 2]
    sine = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    return axis * (2.0 * math.atan2(sine, w) / sine if sine > 1e-12 * w else 2.0 / max(w, 1e-300))
