"""Single rotations for compiled loops, which cannot call so3.py."""

from __future__ import annotations

import math

import numba

from calib_core.types import FloatArray

#: Below this angle [rad], squared, four terms of a sine's series are all of its digits: 0.05^8 / 9! is 1e-16. From one instant to
#: the next hardly anything turns by more, and sines take longer than all else.
_SMALL_RAD2 = 0.05**2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def exp_into(x: float, y: float, z: float, R: FloatArray) -> None:
    """Fills R (3, 3) with the rotation of a rotation vector [rad]."""
    xx, yy, zz = x * x, y * y, z * z
    square = xx + yy + zz
    if square < _SMALL_RAD2:
        a = 1.0 - square * (1 / 6) * (1.0 - square * (1 / 20) * (1.0 - square * (1 / 42)))
        b = 0.5 - square * (1 / 24) * (1.0 - square * (1 / 30) * (1.0 - square * (1 / 56)))
    else:
        theta = math.sqrt(square)
        half = 0.5 * theta
        a, b = math.sin(theta) / theta, 0.5 * (math.sin(half) / half) ** 2
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
def log_into(R: FloatArray, out: FloatArray) -> None:
    """Fills out (3,) with the rotation vector [rad] of R (3, 3), of any length up to pi: through the unit quaternion, taken from
    its largest component.
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    largest = 3
    for i in range(3):
        if R[i, i] > (trace if largest == 3 else R[largest, largest]):
            largest = i
    if largest == 3:
        x, y, z, w = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace
    elif largest == 0:
        x, y, z, w = 1.0 - trace + 2.0 * R[0, 0], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]
    elif largest == 1:
        x, y, z, w = R[1, 0] + R[0, 1], 1.0 - trace + 2.0 * R[1, 1], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]
    else:
        x, y, z, w = R[0, 2] + R[2, 0], R[2, 1] + R[1, 2], 1.0 - trace + 2.0 * R[2, 2], R[1, 0] - R[0, 1]
    sign = -1.0 if w < 0.0 else 1.0
    sine = math.sqrt(x * x + y * y + z * z)
    scale = sign * (2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 * abs(w) else 2.0 / max(abs(w), 1e-300))
    out[0], out[1], out[2] = x * scale, y * scale, z * scale


@numba.njit(cache=True, nogil=True, error_model="numpy")
def right_jacobian_into(x: float, y: float, z: float, J: FloatArray) -> None:
    """Fills J (3, 3) with Jr of a rotation vector [rad]: I - b hat + c hat^2 (so3.py)."""
    square = x * x + y * y + z * z
    theta = math.sqrt(square)
    half = 0.5 * theta
    b = 0.5 * (math.sin(half) / half) ** 2 if half > 1e-8 else 0.5
    if theta < 0.25:
        c = (1.0 - square / 20 * (1.0 - square / 42 * (1.0 - square / 72 * (1.0 - square / 110)))) / 6
    else:
        c = (theta - math.sin(theta)) / (theta * square)
    by_hat_into(x, y, z, -b, c, J)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def right_jacobian_inverse_into(x: float, y: float, z: float, J: FloatArray) -> None:
    """Fills J (3, 3) with the inverse of Jr of a rotation vector [rad], shorter than 2 pi: I + hat / 2 + d hat^2 (so3.py)."""
    square = x * x + y * y + z * z
    theta = math.sqrt(square)
    if theta < 0.25:
        d = 1 / 12 + square * (1 / 720 + square * (1 / 30240 + square * (1 / 1209600 + square / 47900160)))
    else:
        d = (1.0 - 0.5 * theta / math.tan(0.5 * theta)) / square
    by_hat_into(x, y, z, 0.5, d, J)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def by_hat_into(x: float, y: float, z: float, one: float, two: float, out: FloatArray) -> None:
    """Out = I + one hat(w) + two hat(w)^2 of w = (x, y, z).   out: (3, 3)."""
    xx, yy, zz = x * x, y * y, z * z
    out[0, 0], out[0, 1], out[0, 2] = 1.0 - two * (yy + zz), two * x * y - one * z, two * x * z + one * y
    out[1, 0], out[1, 1], out[1, 2] = two * x * y + one * z, 1.0 - two * (xx + zz), two * y * z - one * x
    out[2, 0], out[2, 1], out[2, 2] = two * x * z - one * y, two * y * z + one * x, 1.0 - two * (xx + yy)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def transposed_by_into(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """Out = A' B, (3, 3) each."""
    for r in range(3):
        for c in range(3):
            out[r, c] = A[0, r] * B[0, c] + A[1, r] * B[1, c] + A[2, r] * B[2, c]
