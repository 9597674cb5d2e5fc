"""Both sensors' stamps as seconds of their own epochs, and what else a first look at every scan tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib_core.full.prepare.settings import SWEEPS
from calib_core.full.run import Clocks
from calib_core.threads import workers
from calib_core.types import ComplexArray, FloatArray, IntArray, PointArray, Recording


@dataclass(frozen=True, slots=True)
class FirstLook:
    """What every scan is, from reading it once.

    stamps_ns: (M,) of the first point.   sweep_s: (M,) last point after the first.   points: (M,) how many.
    period_s: median between scans.   facing: (2, M) complex x + i y, where a rotor looked in the middle of each sweep if it turns
    once a period from x to y (row 0) or the other way round (row 1); of length 1 where the points keep to such a rotor, shorter
    as they do not.   farthest_m, nearest_m: the longest and the shortest range of a sample's returns.
    """

    stamps_ns: IntArray
    sweep_s: FloatArray
    points: IntArray
    period_s: float
    facing: ComplexArray
    farthest_m: float
    nearest_m: float


def look(recording: Recording, stamps_ns: IntArray | None = None) -> FirstLook:
    """What reading every scan once tells, on all threads. stamps_ns: (M,) of the scans, where they are known."""
    scans = recording.scans
    stamps = np.array([scan.stamp_ns for scan in scans], dtype=np.int64) if stamps_ns is None else stamps_ns
    period_s = float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else recording.lidar.period_s
    some = [
        range(first, min(first + SWEEPS.scans_at_once, len(scans)))
        for first in range(0, len(scans), SWEEPS.scans_at_once)
    ]
    looks = list(workers().map(lambda places: _look_at([scans[k].points for k in places], period_s), some))
    sweeps, counts, facing, farthest, nearest = zip(*looks, strict=True)
    return FirstLook(
        stamps,
        np.concatenate(sweeps),
        np.concatenate(counts),
        period_s,
        np.concatenate(facing, axis=1),
        max(farthest),
        min(nearest),
    )


def _look_at(clouds: Sequence[PointArray], period_s: float) -> tuple[FloatArray, IntArray, ComplexArray, float, float]:
    """Of some scans their sweeps, points, facing (2, M), the longest and the shortest range."""
    counts = np.array([len(points) for points in clouds], dtype=np.int64)
    sweep_s = np.array([int(points["offset_ns"].max()) * 1e-9 if len(points) else 0.0 for points in clouds])
    samples = [points[:: max(1, len(points) // SWEEPS.sampled_points)] for points in clouds]
    every, sizes = np.concatenate(samples), [len(sample) for sample in samples]
    range_m = np.linalg.norm(every["xyz"], axis=1)
    farthest_m, nearest_m = float(np.fmax.reduce(range_m, initial=0.0)), float(np.fmin.reduce(range_m, initial=np.inf))
    return sweep_s, counts, _facing(every, sizes, sweep_s, period_s), farthest_m, nearest_m


def _facing(points: PointArray, sizes: Sequence[int], sweep_s: FloatArray, period_s: float) -> ComplexArray:
    """(2, M) means of the directions of some of each sweep's points, turned back to the middle of the sweep either way.

    points: of all sweeps, one after the other.   sizes: how many of each.   sweep_s: (M,).
    """
    out = np.zeros((2, len(sizes)), dtype=np.complex128)
    if period_s <= 0.0:
        return out
    x, y = points["xyz"][:, 0].astype(np.float64), points["xyz"][:, 1].astype(np.float64)
    away = np.hypot(x, y)
    seen = away > 0.0
    direction = (x[seen] + 1j * y[seen]) / away[seen]
    middle_s = np.repeat(0.5 * sweep_s, sizes)[seen]
    turn = np.exp(2j * np.pi / period_s * (points["offset_ns"][seen] * 1e-9 - middle_s))
    ends = np.concatenate([[0], np.cumsum(seen)])[np.cumsum(sizes)]
    for k, (first, end) in enumerate(pairwise([0, *ends.tolist()])):
        if end > first:
            one, by = direction[first:end], turn[first:end]
            out[:, k] = np.mean(one * by.conj()), np.mean(one * by)
    return out


def clocks_of(recording: Recording, seen: FirstLook) -> Clocks:
    """Clocks of a recording: the IMU's epoch is the lidar's, moved by the coarse offset."""
    epoch = int(seen.stamps_ns[0])
    imu_epoch = epoch - recording.coarse_offset_ns
    imu_s = np.asarray((recording.imu.stamps_ns - imu_epoch) * 1e-9, dtype=np.float64)
    scan_s = np.asarray((seen.stamps_ns - epoch) * 1e-9, dtype=np.float64)
    return Clocks(epoch, imu_epoch, imu_s, scan_s, seen.sweep_s, seen.points)
