"""Both sensors' stamps as seconds of their own epochs, and what else a first look at every scan tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.prepare.settings import LASERS, SWEEPS
from calib_core.full.run import Clocks
from calib_core.memoised import told_once
from calib_core.threads import workers
from calib_core.types import ComplexArray, FloatArray, IntArray, PointArray, Recording, Scan


@dataclass(frozen=True, slots=True)
class FirstLook:
    """What every scan is, from reading it once.

    stamps_ns: (M,) of the first point.   sweep_s: (M,) last point after the first.   points: (M,) how many.
    period_s: median between scans.   facing: (2, M) complex x + i y, where a rotor looked in the middle of each sweep if it turns
    once a period from x to y (row 0) or the other way round (row 1); of length 1 where the points keep to such a rotor, shorter
    as they do not.   seen_at_s: (M,) the mean time of the points that tell so, after the middle of the sweep: where a view is
    cut.   farthest_m, nearest_m: the longest and the shortest range of a sample's returns.
    """

    stamps_ns: IntArray
    sweep_s: FloatArray
    points: IntArray
    period_s: float
    facing: ComplexArray
    seen_at_s: FloatArray
    farthest_m: float
    nearest_m: float


def look(recording: Recording, stamps_ns: IntArray | None = None) -> FirstLook:
    """What reading every scan once tells, on all threads. stamps_ns: (M,) of the scans, where they are known."""
    scans = recording.scans
    stamps = np.array([scan.stamp_ns for scan in scans], dtype=np.int64) if stamps_ns is None else stamps_ns
    return _look(scans, stamps, recording.lidar.period_s)


@told_once
def _look(scans: Sequence[Scan], stamps: IntArray, usual_s: float) -> FirstLook:
    """stamps: (M,) of the scans.   usual_s: between them, where there is one."""
    period_s = float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else usual_s
    some = [
        range(first, min(first + SWEEPS.scans_at_once, len(scans)))
        for first in range(0, len(scans), SWEEPS.scans_at_once)
    ]
    looks = list(workers().map(lambda places: _look_at([scans[k].points for k in places], period_s), some))
    sweeps, counts, turned_back, seen_at, farthest, nearest = zip(*looks, strict=True)
    return FirstLook(
        stamps,
        np.concatenate(sweeps),
        np.concatenate(counts),
        period_s,
        _facing(turned_back),
        np.concatenate(seen_at),
        max(farthest),
        min(nearest),
    )


def _look_at(
    clouds: Sequence[PointArray], period_s: float
) -> tuple[FloatArray, IntArray, ComplexArray, FloatArray, float, float]:
    """Of some scans their sweeps, points, turned directions (2, M, L), mean times, the longest and the shortest range."""
    counts = np.array([len(points) for points in clouds], dtype=np.int64)
    sweep_s = np.array([int(points["offset_ns"].max()) * 1e-9 if len(points) else 0.0 for points in clouds])
    samples = [points[sampled(len(points))] for points in clouds]
    every, sizes = np.concatenate(samples), [len(sample) for sample in samples]
    range_m = np.linalg.norm(every["xyz"], axis=1)
    farthest_m, nearest_m = float(np.fmax.reduce(range_m, initial=0.0)), float(np.fmin.reduce(range_m, initial=np.inf))
    return sweep_s, counts, *_turned_back(every, sizes, sweep_s, period_s), farthest_m, nearest_m


def sampled(count: int) -> IntArray:
    """Which of a scan's points are looked at: one drawn of each of as many stretches alike, or all where they are few.

    Every so many-th point would keep step with the lasers, which fire in turn: with all of those that look to one side, and
    after one point that is lost with all of those that look to the other.
    """
    if count <= SWEEPS.sampled_points:
        return np.arange(count)
    begin = np.arange(SWEEPS.sampled_points + 1) * count // SWEEPS.sampled_points
    drawn = np.random.default_rng(0).random(SWEEPS.sampled_points)
    return np.asarray(begin[:-1] + np.floor(drawn * np.diff(begin)), dtype=np.int64)


def _turned_back(
    points: PointArray, sizes: Sequence[int], sweep_s: FloatArray, period_s: float
) -> tuple[ComplexArray, FloatArray]:
    """(2, M, L) sums, laser by laser, of directions of some of each sweep's points, turned back to its middle either way; (M,)
    the mean time of these points, after the middle [s].

    As parts of all of a sweep's directions: of one sense of turning and one sweep they add up to their mean.
    points: of all sweeps, one after the other.   sizes: how many of each.   sweep_s: (M,).
    """
    lasers = min(int(points["ring"].max(initial=0)) + 1, LASERS.most)
    out = np.zeros((2, len(sizes), lasers), dtype=np.complex128)
    if period_s <= 0.0:
        return out, np.zeros(len(sizes))
    x, y = points["xyz"][:, 0].astype(np.float64), points["xyz"][:, 1].astype(np.float64)
    away = np.hypot(x, y)
    seen = away > 0.0
    direction = (x[seen] + 1j * y[seen]) / away[seen]
    sweep = np.repeat(np.arange(len(sizes)), sizes)[seen]
    after_s = points["offset_ns"][seen] * 1e-9 - 0.5 * sweep_s[sweep]
    turn = np.exp(2j * np.pi / period_s * after_s)
    place = sweep * lasers + np.minimum(points["ring"][seen], lasers - 1)
    total = np.maximum(np.bincount(sweep, minlength=len(sizes)), 1)[:, None]
    for way, back in enumerate((direction * turn.conj(), direction * turn)):
        of = [np.bincount(place, part, len(sizes) * lasers).reshape(-1, lasers) for part in (back.real, back.imag)]
        out[way] = (of[0] + 1j * of[1]) / total
    return out, np.bincount(sweep, after_s, len(sizes)) / total[:, 0]


def _facing(turned_back: Sequence[ComplexArray]) -> ComplexArray:
    """(2, M) means of the directions of each sweep's points, each laser's turned by how far it looks aside of the others.

    turned_back: (2, .., L) of stretches of scans, one after the other. A laser's azimuth is its own, by up to 9 deg, and which
    lasers return anything changes from scan to scan: the mean over all of them would wander by milliseconds of a rotor's turn.
    """
    lasers = max(part.shape[2] for part in turned_back)
    wide = [np.pad(part, ((0, 0), (0, 0), (0, lasers - part.shape[2]))) for part in turned_back]
    out = []
    for sums in np.concatenate(wide, axis=1):
        aside = np.ones(lasers, dtype=np.complex128)
        for _ in range(SWEEPS.passes):
            aside = _unit(np.einsum("ml,m->l", sums, _unit(_summed(sums, aside)).conj()))
        out.append(_summed(sums, aside))
    return np.array(out)


def _summed(sums: ComplexArray, aside: ComplexArray) -> ComplexArray:
    """(M,) of (M, L), each laser's turned back by where it looks. Not by BLAS, whose threads would wait for one another."""
    return np.asarray(np.einsum("ml,l->m", sums, aside.conj()), dtype=np.complex128)


def _unit(directions: ComplexArray) -> ComplexArray:
    """Of length 1; 1 where there is none."""
    length = np.abs(directions)
    return np.asarray(
        np.where(length > 0.0, directions / np.where(length > 0.0, length, 1.0), 1.0), dtype=np.complex128
    )


def clocks_of(recording: Recording, seen: FirstLook) -> Clocks:
    """Clocks of a recording: the IMU's epoch is the lidar's, moved by the coarse offset."""
    epoch = int(seen.stamps_ns[0])
    imu_epoch = epoch - recording.coarse_offset_ns
    imu_s = np.asarray((recording.imu.stamps_ns - imu_epoch) * 1e-9, dtype=np.float64)
    scan_s = np.asarray((seen.stamps_ns - epoch) * 1e-9, dtype=np.float64)
    return Clocks(epoch, imu_epoch, imu_s, scan_s, seen.sweep_s, seen.points)
