"""The motion between knots: the pose of IMU and lidar at any instant, from the nearest knot and the readings there.

From a knot at s_k, over tau (at most half a spacing, either way), with the readings' first and second differences:

    R = R_k Exp(w tau + w' tau^2/2 + w'' tau^3/6),
    v = v_k + (g + R_k f) tau,      p = p_k + v_k tau + (g + R_k Exp(w tau/3) f(tau/3)) tau^2 / 2
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.factors.bins import SlicePoses
from calib_core.factors.knots import KnotStates
from calib_core.geometry import cross, exp
from calib_core.imu.links import UpsampledImu
from calib_core.types import BoolArray, FloatArray, IntArray


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
        r = self.readings
        k = self.nearest_knot(imu_s)
        tau = imu_s - r.knots_s[k]
        h = r.spacing_s
        before, after = np.maximum(k - 1, 0), np.minimum(k + 1, len(r.knots_s) - 1)
        span = ((after - before) * h)[:, None]
        w = r.knot_gyro[k] - self.gyro_bias[k]
        w1 = (r.knot_gyro[after] - r.knot_gyro[before]) / span
        w2 = (r.knot_gyro[after] - 2 * r.knot_gyro[k] + r.knot_gyro[before]) / h**2 * ((after - before) == 2)[:, None]
        f = r.knot_accel[k] - self.accel_bias[k]
        f1 = (r.knot_accel[after] - r.knot_accel[before]) / span
        t = tau[:, None]
        Rk = self.states.R[k]
        R = Rk @ exp(w * t + w1 * t**2 / 2 + w2 * t**3 / 6)
        third = (Rk @ exp(w * t / 3) @ (f + f1 * t / 3)[..., None])[..., 0] + self.gravity
        half = (Rk @ exp(w * t / 2) @ (f + f1 * t / 2)[..., None])[..., 0] + self.gravity
        linked = np.concatenate([[False], r.linked, [False]])
        usable = np.where(tau < 0, linked[k], linked[k + 1]) & (np.abs(tau) < 0.51 * h)
        return ImuPoses(
            R=R,
            p=self.states.p[k] + self.states.v[k] * t + 0.5 * third * t**2,
            v=self.states.v[k] + half * t,
            omega_rad_s=w + w1 * t + w2 * t**2 / 2,
            usable=usable,
        )

    def lidar_at(self, imu_s: FloatArray, R_imu_lidar: FloatArray, p_imu_lidar: FloatArray) -> SlicePoses:
        """The lidar's poses and body rates at instants of the IMU's clock."""
        imu = self.at(imu_s)
        lever = (imu.R @ p_imu_lidar[:, None])[..., 0]
        v_map = imu.v + (imu.R @ cross(imu.omega_rad_s, p_imu_lidar)[..., None])[..., 0]
        R = imu.R @ R_imu_lidar
        return SlicePoses(
            R=R,
            p=imu.p + lever,
            omega_rad_s=imu.omega_rad_s @ R_imu_lidar,
            v_m_s=(np.swapaxes(R, 1, 2) @ v_map[..., None])[..., 0],
            usable=imu.usable,
        )
