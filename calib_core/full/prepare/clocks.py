"""Both sensors' stamps as seconds of their own epochs, and what else a first look at every scan tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.prepare.settings import SWEEPS
from calib_core.full.run import Clocks
from calib_core.types import ComplexArray, FloatArray, IntArray, PointArray, Recording


@dataclass(frozen=True, slots=True)
class FirstLook:
    """What every scan is, from reading it once.

    stamps_ns: (M,) of the first point.   sweep_s: (M,) last point after the first.   points: (M,) how many.
    period_s: usual, between scans.   facing: (2, M) where the lidar looked in the middle of each sweep, as a unit vector in the
    plane of x and y, if it turns once a period from x to y, and if the other way round; shorter than one as the points do not
    keep to that.   farthest_m: the longest range of a sample's returns.
    """

    stamps_ns: IntArray
    sweep_s: FloatArray
    points: IntArray
    period_s: float
    facing: ComplexArray
    farthest_m: float


def look(recording: Recording) -> FirstLook:
    """At every scan, once."""
    stamps = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    period_s = float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else recording.lidar.period_s
    sweeps, counts, facing, farthest_m = [], [], np.zeros((2, len(stamps)), dtype=np.complex128), 0.0
    for place, scan in enumerate(recording.scans):
        points = scan.points
        sweeps.append(int(points["offset_ns"].max()) * 1e-9 if len(points) else 0.0)
        counts.append(len(points))
        sample = points[:: max(1, len(points) // SWEEPS.sampled_points)]
        facing[:, place] = _facing(sample, sweeps[-1], period_s)
        farthest_m = float(np.fmax.reduce(np.linalg.norm(sample["xyz"], axis=1), initial=farthest_m))
    return FirstLook(stamps, np.array(sweeps), np.array(counts, dtype=np.int64), period_s, facing, farthest_m)


def _facing(points: PointArray, sweep_s: float, period_s: float) -> ComplexArray:
    """(2,) mean of the directions of some of a sweep's points, turned back to the middle of the sweep either way."""
    out = np.zeros(2, dtype=np.complex128)
    if not len(points) or period_s <= 0.0:
        return out
    x, y = points["xyz"][:, 0].astype(np.float64), points["xyz"][:, 1].astype(np.float64)
    away = np.hypot(x, y)
    seen = away > 0.0
    direction = (x[seen] + 1j * y[seen]) / away[seen]
    turn = np.exp(2j * np.pi / period_s * (points["offset_ns"][seen] * 1e-9 - 0.5 * sweep_s))
    if len(direction):
        out[:] = np.mean(direction * turn.conj()), np.mean(direction * turn)
    return out


def clocks_of(recording: Recording, seen: FirstLook) -> Clocks:
    """Clocks of a recording: the IMU's epoch is the lidar's, moved by the coarse offset."""
    epoch = int(seen.stamps_ns[0])
    imu_epoch = epoch - recording.coarse_offset_ns
    imu_s = np.asarray((recording.imu.stamps_ns - imu_epoch) * 1e-9, dtype=np.float64)
    scan_s = np.asarray((seen.stamps_ns - epoch) * 1e-9, dtype=np.float64)
    return Clocks(epoch, imu_epoch, imu_s, scan_s, seen.sweep_s, seen.points)
