"""Start values without any guess, as records: time offset, rotation, then gravity, lever arm and accelerometer bias.

1. `time_offset.py`: the lags at which the lidar's turns and the gyroscope's agree best.
2. `rotation.py`: the rotation at each, in closed form, and the lag refined on what it leaves.
3. `linear.py`: gravity, lever arm and accelerometer bias, which are linear then. A turn that was left open is the one at
   which this fits best; where it fits alike at many, that at which planes are plumb and level (`single_axis.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from calib_core.full.initialise.settings import LAGS
from calib_core.full.odometry.register import ScanMotion
from calib_core.geometry import exp
from calib_core.types import FloatArray


@dataclass(frozen=True)
class LidarTrack:
    """The tracked motion as arrays. start_s: (M,) lidar clock, R, p at the scan's start; rates in the sweep; sweep_s: (M,).
    unseen: (M, 3, 3) map, takes from a place what its scan has not told of it.
    """

    start_s: FloatArray
    sweep_s: FloatArray
    R: FloatArray
    p: FloatArray
    omega_rad_s: FloatArray
    v_m_s: FloatArray
    unseen: FloatArray

    @staticmethod
    def of(motions: Sequence[ScanMotion], start_s: FloatArray, sweep_s: FloatArray) -> LidarTrack:
        """From tracked scans and their times."""
        return LidarTrack(
            start_s,
            sweep_s,
            np.array([m.R for m in motions]),
            np.array([m.p for m in motions]),
            np.array([m.omega_rad_s for m in motions]),
            np.array([m.v_m_s for m in motions]),
            np.array([m.unseen for m in motions]),
        )

    def part(self, which: slice) -> LidarTrack:
        """Some of its scans."""
        return LidarTrack(*(getattr(self, each.name)[which] for each in fields(self)))

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lidar poses at instants of the lidar clock: R (N, 3, 3), p (N, 3). Constant rates from each scan's start."""
        m = np.clip(np.searchsorted(self.start_s, t_s, side="right") - 1, 0, len(self.start_s) - 1)
        tau = np.clip(t_s - self.start_s[m], -LAGS.before_s, LAGS.beyond_s)[:, None]
        return self.R[m] @ exp(self.omega_rad_s[m] * tau), self.p[m] + self.v_m_s[m] * tau


@dataclass(frozen=True)
class RotationStart:
    """A lag and the rotation at it. time_offset_s: added to IMU stamps. open_axis_imu: (3,) where the turn about it is open.

    correlation: of the rates' norms at the lag. residual: rms of the fit over rms of the rates, 0 for perfect.
    repeats_s: other lags that fit as well, as of a motion that repeats itself; this one is the nearest to the stamps' own.
    std_rad, bias_std_rad_s: 1 sigma of the rotation about its worst axis and of the gyroscope's constant, by what the fit leaves;
    as much as anything where that is not known.
    """

    time_offset_s: float
    R_imu_lidar: FloatArray
    gyro_bias: FloatArray
    residual: float
    correlation: float
    open_axis_imu: FloatArray | None
    repeats_s: tuple[float, ...] = ()
    std_rad: float = np.pi
    bias_std_rad_s: float = 1.0

    def turn_std_rad(self, turn_rad: float, over_s: float) -> float:
        """1 sigma of a turn by so much over so long that the gyroscope's turn gives as the lidar's. Of a rate: over a second."""
        return turn_rad * self.std_rad + over_s * self.bias_std_rad_s


@dataclass(frozen=True)
class LinearStart:
    """The linear solution. gravity (3,) map, p_imu_lidar (3,), accel_bias (3,), rms: whitened residual."""

    gravity: FloatArray
    p_imu_lidar: FloatArray
    accel_bias: FloatArray
    rms: float


@dataclass(frozen=True)
class Start:
    """Start values of the joint solve: a rotation and the linear solution with it."""

    rotation: RotationStart
    linear: LinearStart

    @property
    def misfit(self) -> float:
        """Of both steps, to be compared between trials."""
        return self.linear.rms * (1.0 + self.rotation.residual)
