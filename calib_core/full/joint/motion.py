"""The motion between knots: the pose of IMU and lidar at any instant, from the nearest knot and the readings there.

From a knot at s_k, over tau (at most half a spacing, either way), with the readings' first and second derivatives there:

    R = R_k Exp(w tau + w' tau^2/2 + w'' tau^3/6),
    v = v_k + (g + R_k f) tau,      p = p_k + v_k tau + (g + R_k Exp(w tau/3) f(tau/3)) tau^2 / 2

Of the turning the readings between the knots tell these: the parabola through that at the knot and those at the two Gauss points
on tau's side, by which the link turns as much in half a spacing. A rotor shakes a rig by half a milliradian 85 times a second,
which readings 10 ms apart, from knot to knot, take for another motion. Of the force first differences from knot to knot do:
twice integrated, the same shaking is hundredths of a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from calib_core.factors.imu import KnotStates
from calib_core.factors.lidar_plane import SlicePoses
from calib_core.full.joint.settings import CHAIN
from calib_core.geometry.compiled import exp_into, multiply_into, turn_into
from calib_core.imu.preintegration import UpsampledImu, gauss_nodes
from calib_core.paged import heed_pages, paged
from calib_core.types import BoolArray, FloatArray, IntArray

#: Where in half a spacing its two Gauss points are, from the knot.
_NEAR, _FAR = (float(node) for node in gauss_nodes(1))


@dataclass(frozen=True, slots=True)
class ImuPoses:
    """R: (N, 3, 3) map <- imu. p: (N, 3) [m]. v: (N, 3) [m/s] map. omega_rad_s: (N, 3) imu axes. usable: (N,)."""

    R: FloatArray
    p: FloatArray
    v: FloatArray
    omega_rad_s: FloatArray
    usable: BoolArray


@dataclass(frozen=True)
class Motion:
    """The IMU's motion. gyro_bias, accel_bias: (K, 3) at the knots. gravity: (3,) map."""

    readings: UpsampledImu
    states: KnotStates
    gyro_bias: FloatArray
    accel_bias: FloatArray
    gravity: FloatArray

    def nearest_knot(self, imu_s: FloatArray) -> IntArray:
        """Index of the knot nearest to each instant of the IMU's clock, clipped to the ends."""
        first = self.readings.knots_s[0]
        k = np.rint((imu_s - first) / self.readings.spacing_s).astype(np.int64)
        return np.clip(k, 0, len(self.readings.knots_s) - 1)

    def at(self, imu_s: FloatArray) -> ImuPoses:
        """Poses at instants of the IMU's clock, (N,). Unusable beyond the knots and where the IMU was silent."""
        r, n = self.readings, len(imu_s)
        # In order, whatever they are parts of: the loop was compiled six times over.
        imu_s, knots_s, knots_R, knots_p, knots_v = (
            np.ascontiguousarray(part) for part in (imu_s, r.knots_s, self.states.R, self.states.p, self.states.v)
        )
        poses = ImuPoses(
            np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n, np.bool_)
        )
        _between_knots(
            imu_s, self.nearest_knot(imu_s), knots_s, r.spacing_s, CHAIN.reach_knots, r.linked, r.gyro, r.knot_gyro,
            r.knot_accel, self.gyro_bias, self.accel_bias, self.gravity, knots_R, knots_p, knots_v,
            poses.R, poses.p, poses.v, poses.omega_rad_s, poses.usable,
        )  # fmt: skip
        return poses

    def lidar_at(self, imu_s: FloatArray, R_imu_lidar: FloatArray, p_imu_lidar: FloatArray) -> SlicePoses:
        """The lidar's poses and body rates at instants of the IMU's clock."""
        n = len(imu_s)
        R, p, omega, v = paged((n, 3, 3), (n, 3), (n, 3), (n, 3))
        lidar = SlicePoses(R, p, omega, v, np.empty(n, np.bool_))
        R_imu_lidar, p_imu_lidar = np.ascontiguousarray(R_imu_lidar), np.ascontiguousarray(p_imu_lidar)
        for first in range(0, n, CHAIN.clusters_at_once):
            some = slice(first, first + CHAIN.clusters_at_once)
            imu = self.at(imu_s[some])
            lidar.usable[some] = imu.usable
            _on_the_imu(
                imu.R, imu.p, imu.v, imu.omega_rad_s, R_imu_lidar, p_imu_lidar,
                lidar.R[some], lidar.p[some], lidar.omega_rad_s[some], lidar.v_m_s[some],
            )  # fmt: skip
            heed_pages(2 * lidar.R[some].nbytes)
        return lidar


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _between_knots(
    imu_s: FloatArray,
    nearest: IntArray,
    knots_s: FloatArray,
    h: float,
    reach_knots: float,
    linked: BoolArray,
    between: FloatArray,
    gyro: FloatArray,
    accel: FloatArray,
    gyro_bias: FloatArray,
    accel_bias: FloatArray,
    gravity: FloatArray,
    knots_R: FloatArray,
    knots_p: FloatArray,
    knots_v: FloatArray,
    R: FloatArray,
    p: FloatArray,
    v: FloatArray,
    omega: FloatArray,
    usable: BoolArray,
) -> None:
    """Fills R (N, 3, 3), p, v, omega (N, 3), usable (N,): the formulas above, instant by instant.

    nearest: (N,) knots.   between: (L, G, 3) rates at the links' Gauss points.
    """
    last = len(knots_s) - 1
    # Half a spacing is then one substep of a link, with two Gauss points. Rarer readings make more, and tell nothing fast.
    halves = between.shape[1] // 2 == 2
    near_s, far_s = 0.5 * h * _NEAR, 0.5 * h * _FAR
    turn = np.empty((3, 3))
    w, w1, w2 = np.empty(3), np.empty(3), np.empty(3)
    f, f1, force, turned = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(imu_s)):
        k = nearest[i]
        t = imu_s[i] - knots_s[k]
        before, after = max(k - 1, 0), min(k + 1, last)
        span = (after - before) * h
        for c in range(3):
            w[c] = gyro[k, c] - gyro_bias[k, c]
            w1[c] = (gyro[after, c] - gyro[before, c]) / span
            w2[c] = (gyro[after, c] - 2.0 * gyro[k, c] + gyro[before, c]) / h**2 if after - before == 2 else 0.0
            if halves and (k > 0 if t < 0.0 else k < last):
                side = -1.0 if t < 0.0 else 1.0
                near = (between[k - 1, 3, c] if t < 0.0 else between[k, 0, c]) - gyro[k, c]
                far = (between[k - 1, 2, c] if t < 0.0 else between[k, 1, c]) - gyro[k, c]
                w2[c] = 2.0 * (far / far_s - near / near_s) / (far_s - near_s)
                w1[c] = side * (near / near_s - 0.5 * w2[c] * near_s)
            f[c] = accel[k, c] - accel_bias[k, c]
            f1[c] = (accel[after, c] - accel[before, c]) / span
            omega[i, c] = w[c] + w1[c] * t + w2[c] * t**2 / 2.0
            turned[c] = w[c] * t + w1[c] * t**2 / 2.0 + w2[c] * t**3 / 6.0
        exp_into(turned[0], turned[1], turned[2], turn)
        multiply_into(knots_R[k], turn, R[i])
        for part in (3.0, 2.0):
            exp_into(w[0] * t / part, w[1] * t / part, w[2] * t / part, turn)
            for c in range(3):
                force[c] = f[c] + f1[c] * t / part
            turn_into(turn, force, turned)
            turn_into(knots_R[k], turned, force)
            for c in range(3):
                if part == 3.0:
                    p[i, c] = knots_p[k, c] + knots_v[k, c] * t + 0.5 * t**2 * (force[c] + gravity[c])
                else:
                    v[i, c] = knots_v[k, c] + t * (force[c] + gravity[c])
        known = (k > 0 and linked[k - 1]) if t < 0.0 else (k < last and linked[k])
        usable[i] = known and abs(t) < reach_knots * h


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _on_the_imu(
    imu_R: FloatArray,
    imu_p: FloatArray,
    imu_v: FloatArray,
    imu_omega: FloatArray,
    R_imu_lidar: FloatArray,
    p_imu_lidar: FloatArray,
    R: FloatArray,
    p: FloatArray,
    omega: FloatArray,
    v: FloatArray,
) -> None:
    """Fills R (N, 3, 3), p, omega and v (N, 3) of the lidar, the last two in its own axes, from the IMU's as `ImuPoses` has them.

    Its velocity is the IMU's and the swing of the lever arm.
    """
    arm, swing = p_imu_lidar, np.empty(3)
    for i in range(len(imu_R)):
        multiply_into(imu_R[i], R_imu_lidar, R[i])
        w = imu_omega[i]
        swing[0] = w[1] * arm[2] - w[2] * arm[1]
        swing[1] = w[2] * arm[0] - w[0] * arm[2]
        swing[2] = w[0] * arm[1] - w[1] * arm[0]
        for c in range(3):
            p[i, c], omega[i, c], v[i, c] = imu_p[i, c], 0.0, 0.0
            for a in range(3):
                p[i, c] += imu_R[i, c, a] * arm[a]
                omega[i, c] += w[a] * R_imu_lidar[a, c]
                v[i, c] += imu_v[i, a] * R[i, a, c] + swing[a] * R_imu_lidar[a, c]
