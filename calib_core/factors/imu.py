"""IMU factors between neighbouring knots, eq. (11), with their Jacobians, for all links at once.

    r_R = Log(DR' R0' R1),   r_v = R0' (v1 - v0 - g h) - Dv,   r_p = R0' (p1 - p0 - v0 h - g h^2 / 2) - Dp

DR, Dv, Dp carry their first-order dependence on the bias, eq. (12). Perturbations: R Exp(phi) on the right, everything
else by addition; positions, velocities and gravity in the map frame. Block order of a knot: phi, p, v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.factors.link_kernels import link_factors_kernel, link_residuals_kernel
from calib_core.geometry import exp
from calib_core.imu.preintegration import Links
from calib_core.types import FloatArray

#: Columns of a knot, and what they are: a turn, a place and a velocity.
KNOT = 9
TURN, PLACE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)


#: The arrays of `Links`, as compiled loops are given them.
_Nine = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]


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
    residual = np.empty((len(links.DR), KNOT))
    link_residuals_kernel(
        links.h_s, *_arrays(links), states.R, states.p, states.v, gravity, gyro_bias_change, accel_bias_change, residual
    )
    return residual


def link_factors(
    links: Links, states: KnotStates, gravity: FloatArray, gyro_bias_change: FloatArray, accel_bias_change: FloatArray
) -> LinkFactors:
    """Whitened residuals and Jacobians of all links."""
    count = len(links.DR)
    shapes = (count, KNOT), (count, KNOT, KNOT), (count, KNOT, KNOT), *([(count, KNOT, 3)] * 3)
    filled = LinkFactors(*(np.empty(shape) for shape in shapes))
    link_factors_kernel(
        links.h_s, *_arrays(links), states.R, states.p, states.v, gravity, gyro_bias_change, accel_bias_change,
        filled.residual, filled.r_D_first, filled.r_D_second,
        filled.r_D_gravity, filled.r_D_gyro_bias, filled.r_D_accel_bias,
    )  # fmt: skip
    return filled


def _arrays(links: Links) -> _Nine:
    """As compiled loops are given them."""
    return (
        links.DR, links.Dv, links.Dp, links.DR_D_bg, links.Dv_D_bg, links.Dv_D_ba, links.Dp_D_bg, links.Dp_D_ba, links.sqrt_info,
    )  # fmt: skip
