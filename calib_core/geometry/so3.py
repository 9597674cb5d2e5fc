"""Rotations: exponential, logarithm and their Jacobians, batched, NumPy only.

One perturbation everywhere: on the right, R Exp(phi). For phi = theta * axis, hat(phi) y = phi x y:

    Exp(phi)   = I + a hat(phi) + b hat(phi)^2,   a = sin(theta)/theta,      b = (1 - cos(theta))/theta^2
    Jr(phi)    = I - b hat(phi) + c hat(phi)^2,   c = (theta - sin(theta))/theta^3
    Jr(phi)^-1 = I + hat(phi)/2 + d hat(phi)^2,   d = 1/theta^2 - (1 + cos(theta))/(2 theta sin(theta))

with Exp(phi + delta) = Exp(phi) Exp(Jr(phi) delta) to first order. Each coefficient switches to its series where its
closed form starts to lose digits: the cancellation is of order eps/theta^2 for b (none with the half-angle form),
eps/theta^2 for c and eps/theta^2 for d, so each has its own switch.
"""

from __future__ import annotations

import math

import numpy as np

from calib_core.types import FloatArray

#: A rotation typed to three digits is still meant as a rotation; more than this is a mistake.
ROTATION_TOLERANCE = 1e-2

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def hat(phi: FloatArray) -> FloatArray:
    """The skew matrix of each vector: hat(a) b = a x b. phi: (..., 3). Returns (..., 3, 3)."""
    out = np.zeros((*phi.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -phi[..., 2], phi[..., 1], -phi[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = phi[..., 2], -phi[..., 1], phi[..., 0]
    return out


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """The cross product of each pair, (..., 3) with broadcasting: NumPy's own spends most of its time on moving axes."""
    return a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]


def _sinc(theta: FloatArray) -> FloatArray:
    return np.sinc(theta / np.pi)


def _coefficient_b(theta: FloatArray) -> FloatArray:
    return 0.5 * _sinc(0.5 * theta) ** 2


def _coefficient_c(theta: FloatArray) -> FloatArray:
    small = theta < 0.25
    safe = np.where(small, 1.0, theta)
    closed = (safe - np.sin(safe)) / safe**3
    t2 = theta**2
    series = (1 / 6) * (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110 * (1 - t2 / 156)))))
    return np.where(small, series, closed)


def _coefficient_d(theta: FloatArray) -> FloatArray:
    small = theta < 0.25
    safe = np.where(small, 1.0, theta)
    # (1 + cos)/sin = cot(theta/2), finite all the way to theta = pi where it is zero.
    closed = (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2
    t2 = theta**2
    series = 1 / 12 + t2 * (1 / 720 + t2 * (1 / 30240 + t2 * (1 / 1209600 + t2 * (1 / 47900160))))
    return np.where(small, series, closed)


def exp(phi: FloatArray) -> FloatArray:
    """The rotation of each rotation vector. phi: (..., 3) [rad]. Returns (..., 3, 3)."""
    if phi.ndim == 1:
        return _exp_one(float(phi[0]), float(phi[1]), float(phi[2]))
    x, y, z = phi[..., 0], phi[..., 1], phi[..., 2]
    xx, yy, zz = x * x, y * y, z * z
    theta = np.sqrt(xx + yy + zz)
    a, b = _sinc(theta), _coefficient_b(theta)
    ax, ay, az = a * x, a * y, a * z
    xy, xz, yz = b * x * y, b * x * z, b * y * z
    out = np.empty((*phi.shape[:-1], 3, 3))
    out[..., 0, 0], out[..., 1, 1], out[..., 2, 2] = 1 - b * (yy + zz), 1 - b * (xx + zz), 1 - b * (xx + yy)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = xy - az, xz + ay, yz - ax
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = xy + az, xz - ay, yz + ax
    return out


def _exp_one(x: float, y: float, z: float) -> FloatArray:
    """A single rotation in plain floats: a tenth of what the batched route costs on one, and single ones come by thousands."""
    theta = math.sqrt(x * x + y * y + z * z)
    a = math.sin(theta) / theta if theta > 1e-8 else 1.0
    half = 0.5 * theta
    b = 0.5 * (math.sin(half) / half) ** 2 if half > 1e-8 else 0.5
    xy, xz, yz = b * x * y, b * x * z, b * y * z
    xx, yy, zz = b * x * x, b * y * y, b * z * z
    ax, ay, az = a * x, a * y, a * z
    return np.array([[1 - yy - zz, xy - az, xz + ay], [xy + az, 1 - xx - zz, yz - ax], [xz - ay, yz + ax, 1 - xx - yy]])


def log(rotation: FloatArray) -> FloatArray:
    """The rotation vector of each rotation, of length at most pi. rotation: (..., 3, 3). Returns (..., 3) [rad].

    Through the unit quaternion, taken from its largest component, so that no angle loses digits, pi included.
    """
    r = np.asarray(rotation, dtype=np.float64)
    if r.ndim == 2 and np.trace(r) > 0:
        return _log_one(r)
    m = r.reshape(-1, 3, 3)
    trace = np.trace(m, axis1=1, axis2=2)
    diagonal = np.stack([m[:, 0, 0], m[:, 1, 1], m[:, 2, 2], trace], axis=1)
    largest = np.argmax(diagonal, axis=1)
    quat = np.empty((m.shape[0], 4))
    for i in range(3):
        pick = largest == i
        j, k = (i + 1) % 3, (i + 2) % 3
        s = m[pick]
        quat[pick, i] = 1.0 - trace[pick] + 2.0 * s[:, i, i]
        quat[pick, j] = s[:, j, i] + s[:, i, j]
        quat[pick, k] = s[:, k, i] + s[:, i, k]
        quat[pick, 3] = s[:, k, j] - s[:, j, k]
    pick = largest == 3
    s = m[pick]
    quat[pick, 0] = s[:, 2, 1] - s[:, 1, 2]
    quat[pick, 1] = s[:, 0, 2] - s[:, 2, 0]
    quat[pick, 2] = s[:, 1, 0] - s[:, 0, 1]
    quat[pick, 3] = 1.0 + trace[pick]
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    quat *= np.where(quat[:, 3:] < 0, -1.0, 1.0)
    sine = np.linalg.norm(quat[:, :3], axis=1)
    half = np.arctan2(sine, quat[:, 3])
    scale = np.where(sine < 1e-12, 2.0, 2.0 * half / np.where(sine < 1e-12, 1.0, sine))
    return (quat[:, :3] * scale[:, None]).reshape(*r.shape[:-2], 3)


def _log_one(r: FloatArray) -> FloatArray:
    """A single rotation of less than 120 deg in plain floats: there the quaternion's scalar part is the largest or near it."""
    (a, b, c), (d, e, f), (g, h, i) = r.tolist()
    x, y, z, w = h - f, c - g, d - b, 1.0 + a + e + i
    sine = math.sqrt(x * x + y * y + z * z)
    half = math.atan2(sine, w)
    scale = 2.0 * half / sine if sine > 1e-12 * w else 2.0 / w
    return np.array([x * scale, y * scale, z * scale])


def right_jacobian(phi: FloatArray) -> FloatArray:
    """Jr of each rotation vector: Exp(phi + delta) = Exp(phi) Exp(Jr delta). phi: (..., 3). Returns (..., 3, 3)."""
    theta = np.linalg.norm(phi, axis=-1)
    k = hat(phi)
    return np.eye(3) - _coefficient_b(theta)[..., None, None] * k + _coefficient_c(theta)[..., None, None] * (k @ k)


def right_jacobian_inverse(phi: FloatArray) -> FloatArray:
    """Inverse of Jr of each rotation vector: Log(Exp(phi) Exp(delta)) = phi + Jr^-1 delta. phi: (..., 3), |phi| < 2 pi."""
    theta = np.linalg.norm(phi, axis=-1)
    k = hat(phi)
    return np.eye(3) + 0.5 * k + _coefficient_d(theta)[..., None, None] * (k @ k)


def mean_rotation(rotations: FloatArray) -> FloatArray:
    """The rotation closest to a stack in the chordal sense. rotations: (N, 3, 3). Returns (3, 3)."""
    return nearest_rotation(rotations.sum(axis=0))


def nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation closest to a matrix in the Frobenius norm (orthogonal Procrustes). matrix: (3, 3)."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def rotation_meant(matrix: FloatArray) -> FloatArray | None:
    """The rotation that a matrix (3, 3) is up to the digits it was written with; None for one that is further off."""
    rotation = nearest_rotation(matrix)
    return rotation if np.abs(rotation - matrix).max() <= ROTATION_TOLERANCE else None
