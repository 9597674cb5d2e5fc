"""IMU factors between neighbouring knots, eq. (11), with their Jacobians, for all links at once.

    r_R = Log(DR' R0' R1),   r_v = R0' (v1 - v0 - g h) - Dv,   r_p = R0' (p1 - p0 - v0 h - g h^2 / 2) - Dp

DR, Dv, Dp carry their first-order dependence on the bias, eq. (12). Perturbations: R Exp(phi) on the right, everything
else by addition; positions, velocities and gravity in the map frame. Block order of a knot: phi, p, v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.geometry import exp, hat, log, right_jacobian_inverse
from calib_core.imu.preintegration import Links
from calib_core.types import FloatArray

#: Columns of a knot, and what they are: a turn, a place and a velocity.
KNOT = 9
TURN, PLACE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)
#: Rows of a link's residual, in the order of eq. (11): of the rotation, the velocity and the position.
_OF_R, _OF_V, _OF_P = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True)
class KnotStates:
    """The IMU's state at every knot, in the map frame. R: (K, 3, 3) map <- imu. p: (K, 3) [m]. v: (K, 3) [m/s]."""

    R: FloatArray
    p: FloatArray
    v: FloatArray

    def part(self, first: int, last: int) -> KnotStates:
        """The states of knots first..last (exclusive)."""
        return KnotStates(self.R[first:last], self.p[first:last], self.v[first:last])

    @staticmethod
    def joined(a: KnotStates, b: KnotStates) -> KnotStates:
        """One run of knots after another."""
        return KnotStates(np.concatenate([a.R, b.R]), np.concatenate([a.p, b.p]), np.concatenate([a.v, b.v]))

    def moved(self, step: FloatArray) -> KnotStates:
        """The states after a step (K, 9) in block order phi, p, v."""
        return KnotStates(self.R @ exp(step[:, TURN]), self.p + step[:, PLACE], self.v + step[:, VELOCITY])


@dataclass(frozen=True)
class LinkFactors:
    """Whitened residuals of all links (L, 9) and their Jacobians.

    r_D_first, r_D_second: (L, 9, 9) with respect to the knots.   r_D_gravity, r_D_gyro_bias, r_D_accel_bias: (L, 9, 3).
    """

    residual: FloatArray
    r_D_first: FloatArray
    r_D_second: FloatArray
    r_D_gravity: FloatArray
    r_D_gyro_bias: FloatArray
    r_D_accel_bias: FloatArray


def link_residuals(
    links: Links, states: KnotStates, gravity: FloatArray, gyro_bias_change: FloatArray, accel_bias_change: FloatArray
) -> FloatArray:
    """Whitened residuals alone, (L, 9). gravity: (3,) map.   *_bias_change: (L, 3) from the preintegration's bias."""
    return (links.sqrt_info @ _raw(links, states, gravity, gyro_bias_change, accel_bias_change)[0][..., None])[..., 0]


def _raw(
    links: Links, states: KnotStates, gravity: FloatArray, dbg: FloatArray, dba: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Unwhitened residuals (L, 9) and the two rotated differences R0'(..) of velocity and position, (L, 3) each."""
    h = links.h_s
    R0t = np.swapaxes(states.R[:-1], 1, 2)
    correction = (links.DR_D_bg @ dbg[..., None])[..., 0]
    DR = links.DR @ exp(correction)
    r_R = log(np.swapaxes(DR, 1, 2) @ R0t @ states.R[1:])
    dv = (R0t @ (states.v[1:] - states.v[:-1] - gravity * h)[..., None])[..., 0]
    dp = (R0t @ (states.p[1:] - states.p[:-1] - states.v[:-1] * h - 0.5 * h**2 * gravity)[..., None])[..., 0]
    Dv = links.Dv + (links.Dv_D_bg @ dbg[..., None])[..., 0] + (links.Dv_D_ba @ dba[..., None])[..., 0]
    Dp = links.Dp + (links.Dp_D_bg @ dbg[..., None])[..., 0] + (links.Dp_D_ba @ dba[..., None])[..., 0]
    return np.concatenate([r_R, dv - Dv, dp - Dp], axis=1), dv, dp


def link_factors(
    links: Links, states: KnotStates, gravity: FloatArray, gyro_bias_change: FloatArray, accel_bias_change: FloatArray
) -> LinkFactors:
    """Whitened residuals and Jacobians of all links."""
    h = links.h_s
    count = links.DR.shape[0]
    raw, dv, dp = _raw(links, states, gravity, gyro_bias_change, accel_bias_change)
    R0, R1 = states.R[:-1], states.R[1:]
    R0t = np.swapaxes(R0, 1, 2)
    Jinv = right_jacobian_inverse(raw[:, _OF_R])
    first = np.zeros((count, 9, 9))
    second = np.zeros((count, 9, 9))
    first[:, _OF_R, TURN] = -Jinv @ np.swapaxes(R1, 1, 2) @ R0
    second[:, _OF_R, TURN] = Jinv
    first[:, _OF_V, TURN] = hat(dv)
    first[:, _OF_V, VELOCITY] = -R0t
    second[:, _OF_V, VELOCITY] = R0t
    first[:, _OF_P, TURN] = hat(dp)
    first[:, _OF_P, PLACE] = -R0t
    first[:, _OF_P, VELOCITY] = -h * R0t
    second[:, _OF_P, PLACE] = R0t
    D_gravity = np.zeros((count, 9, 3))
    D_gravity[:, _OF_V] = -h * R0t
    D_gravity[:, _OF_P] = -0.5 * h**2 * R0t
    D_bg = np.zeros((count, 9, 3))
    D_bg[:, _OF_R] = -Jinv @ exp(-raw[:, _OF_R]) @ links.DR_D_bg
    D_bg[:, _OF_V] = -links.Dv_D_bg
    D_bg[:, _OF_P] = -links.Dp_D_bg
    D_ba = np.zeros((count, 9, 3))
    D_ba[:, _OF_V] = -links.Dv_D_ba
    D_ba[:, _OF_P] = -links.Dp_D_ba
    L = links.sqrt_info
    return LinkFactors((L @ raw[..., None])[..., 0], L @ first, L @ second, L @ D_gravity, L @ D_bg, L @ D_ba)
