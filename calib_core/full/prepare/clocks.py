"""Both sensors' stamps as seconds of their own epochs, and what else a first look at every scan tells."""

from __future__ import annotations

import numpy as np

from calib_core.full.run import Clocks
from calib_core.types import Recording


def read_clocks(recording: Recording) -> Clocks:
    """Clocks of a recording: the IMU's epoch is the lidar's, moved by the coarse offset. Each scan is read once."""
    stamps = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    epoch = int(stamps[0])
    imu_epoch = epoch - recording.coarse_offset_ns
    sweeps, counts = [], []
    for scan in recording.scans:
        points = scan.points
        sweeps.append(int(points["offset_ns"].max()) * 1e-9 if len(points) else 0.0)
        counts.append(len(points))
    imu_s = np.asarray((recording.imu.stamps_ns - imu_epoch) * 1e-9, dtype=np.float64)
    scan_s = np.asarray((stamps - epoch) * 1e-9, dtype=np.float64)
    return Clocks(epoch, imu_epoch, imu_s, scan_s, np.array(sweeps), np.array(counts, dtype=np.int64))
