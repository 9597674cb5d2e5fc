"""Inertial readings at instants between their stamps (paper section II-C), one window per scan.

A window is centred on its scan and reaches half a scan period further on either side (III-C): with a period T it holds
the readings of 2 T. Six independent GPs with constant mean and Matern kernel are trained in every window. A query
belongs to the window of the scan it is asked for, so that a scan's motion is smooth throughout.

`HeldReadings` is the comparison of table I: the latest reading, held until the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib_core.gp import Hyper, Smoothness, posterior_of_windows, train_windows
from calib_core.types import FloatArray, IntArray

#: The posterior of a query outside every reading is the mean: fewer readings than this say nothing of a scan's motion.
MIN_READINGS = 4


@dataclass(frozen=True, slots=True)
class Readings:
    """Inferred readings. gyro_rad_s, accel_m_s2: (..., 3). var_gyro, var_accel: (..., 3), their variances."""

    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    var_gyro: FloatArray
    var_accel: FloatArray


class ReadingSource(Protocol):
    """Anything that knows the readings at any time, asked for on behalf of a scan."""

    def at(self, scan: IntArray, imu_s: FloatArray) -> Readings:
        """Readings at imu_s (N,) [s, IMU clock], from the windows of scans (N,)."""
        ...


@dataclass(frozen=True, slots=True)
class WindowedReadings:
    """Six GPs per window. stamps_s: (M, W) [s, IMU clock].   values: (M, W, 6) gyro, accel.   hyper: arrays (M, 6)."""

    stamps_s: FloatArray
    values: FloatArray
    hyper: Hyper

    def at(self, scan: IntArray, imu_s: FloatArray) -> Readings:
        """Posterior mean and variance at imu_s (N,), in the windows of scans (N,)."""
        mean, var = posterior_of_windows(self.stamps_s, self.values, imu_s, scan, self.hyper)
        return Readings(mean[:, :3], mean[:, 3:], var[:, :3], var[:, 3:])


@dataclass(frozen=True, slots=True)
class HeldReadings:
    """Raw readings held until the next one. stamps_s: (Q,) [s, IMU clock]. values: (Q, 6). var: (6,) of one reading."""

    stamps_s: FloatArray
    values: FloatArray
    var: FloatArray

    def at(self, scan: IntArray, imu_s: FloatArray) -> Readings:
        """The latest reading at imu_s (N,). `scan` does not matter here."""
        del scan
        latest = np.clip(np.searchsorted(self.stamps_s, imu_s, side="right") - 1, 0, self.stamps_s.shape[0] - 1)
        values = self.values[latest]
        var = np.broadcast_to(self.var, values.shape)
        return Readings(values[:, :3], values[:, 3:], var[:, :3], var[:, 3:])


def train_scan_windows(
    stamps_s: FloatArray,
    values: FloatArray,
    scan_centre_s: FloatArray,
    period_s: float,
    *,
    smoothness: Smoothness = "5/2",
) -> WindowedReadings:
    """The trained windows of all scans.

    stamps_s: (Q,) increasing [s, IMU clock].   values: (Q, 6) gyro [rad/s], accel [m/s^2].   scan_centre_s: (M,) [s,
    IMU clock].   period_s: of the lidar. All windows hold the number of readings that fits 2 period_s at the typical
    rate; at the recording's ends they are moved inwards.
    """
    interval = float(np.median(np.diff(stamps_s)))
    size = min(max(MIN_READINGS, round(2.0 * period_s / interval)), stamps_s.shape[0])
    # The first reading of the window: the one from which `size` readings are centred on the scan.
    first = np.searchsorted(stamps_s, scan_centre_s) - size // 2
    pick = np.clip(first, 0, stamps_s.shape[0] - size)[:, None] + np.arange(size)
    stamps, readings = stamps_s[pick], values[pick]
    return WindowedReadings(stamps, readings, train_windows(stamps, readings, smoothness=smoothness))
