"""How far the lidar turned from one scan to the next, each pair by itself: no map that could go wrong, nothing carried on.

The planes of a scan are found in that scan alone and the next one is registered to them from where it stands. A pair
that fails is one pair. Both scans are bent by nearly the same motion, which leaves the turn between them alone: it is that
from the middle of one sweep to the middle of the next. Where they are bent by different ones, as of a rig that is shaken, it is
that between some instants of theirs; straightened by the turns that are known by then, it is that of the middles again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.odometry.motion_prior import Turning, rate_within, steady_sample
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.register import ScanMotion, register, straighten
from calib_core.full.odometry.settings import MAP, PAIRS, TrackSettings
from calib_core.geometry import log
from calib_core.planes.segment import segment_planes
from calib_core.threads import workers
from calib_core.types import FloatArray, IntArray, Scan


@dataclass(frozen=True)
class PairTurns:
    """Turns between neighbouring scans. first: (N,) position of the former of each pair. rotvec_rad: (N, 3), its axes.

    std_rad: (N,) 1 sigma about the axis that its planes tell least.
    """

    first: IntArray
    rotvec_rad: FloatArray
    std_rad: FloatArray


def pair_turns(scans: Sequence[Scan], *, turning: Turning | None = None, seed: int = 0) -> PairTurns:
    """The turns of every other pair of scans, of the middle of a long recording only. turning: within sweeps, where known."""
    first, turns, stds = [], [], []
    begin = max(0, (len(scans) - 2 * PAIRS.pairs) // 2)
    positions = range(begin, min(begin + 2 * PAIRS.pairs, len(scans) - 1), 2)
    pairs = [workers().submit(_turn, scans[at], scans[at + 1], at, turning, seed) for at in positions]
    for position, pair in zip(positions, pairs, strict=True):
        turn = pair.result()
        if turn is not None:
            first.append(position)
            turns.append(log(turn.R))
            stds.append(turn.std_rad)
    std_rad = np.array(stds, dtype=np.float64)
    told = std_rad < PAIRS.told_rad
    if np.count_nonzero(told) < PAIRS.fewest:
        told[:] = True
    rotvec_rad = np.array(turns, dtype=np.float64).reshape(-1, 3)
    return PairTurns(np.array(first, dtype=np.int64)[told], rotvec_rad[told], std_rad[told])


def _turn(one: Scan, other: Scan, position: int, turning: Turning | None, seed: int) -> ScanMotion | None:
    """The other scan as seen from the one, None where two planes at least do not tell the turn between them."""
    points = _as_from_the_middle(one, turning)
    fits = segment_planes(points, seed=seed, settings=PAIRS.segments)
    if len(fits) < 2:
        return None
    known = PlaneMap(np.array([f.normal for f in fits]), np.array([f.offset_m for f in fits]))
    known.seed(points, MAP.seed_m)
    s, none = TrackSettings(), np.zeros(3)
    tie = np.repeat([1 / PAIRS.step_rad**2, 1 / PAIRS.step_m**2, s.held, s.held], 3)
    start = ScanMotion(position, np.eye(3), none, none, none)
    points = _as_from_the_middle(other, turning)
    if len(points) < s.least_points:
        return None
    # At rest within the sweep: both scans are bent alike, or not at all.
    motion = register(
        points,
        np.zeros(len(points)),
        known,
        start,
        tie=tie,
        settings=s,
        position=position + 1,
        scales_m=s.wide_scales_m,
    ).motion
    told = motion.std_rad < PAIRS.told_at_least_rad and motion.share > PAIRS.told_share
    return motion if told else None


def _as_from_the_middle(scan: Scan, turning: Turning | None) -> FloatArray:
    """Some points (K, 3) as they would be seen at the middle of the sweep, as far as the turns within it are known."""
    points, tau = steady_sample(scan, PAIRS.points, turning)
    rate, middle_ns = rate_within(scan, turning), int(scan.points["offset_ns"].max(initial=0)) // 2
    turn = None if turning is None else turning.between(scan.stamp_ns, scan.stamp_ns + middle_ns)
    if rate is None or turn is None:
        return points
    none = np.zeros(3)
    return straighten(points, tau, ScanMotion(0, turn.T, none, rate, none))
