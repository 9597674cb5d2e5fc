"""How far the lidar turned from one scan to the next, each pair by itself: no map that could go wrong, nothing carried on.

The planes of a scan are found in that scan alone and the next one is registered to them from where it stands. A pair
that fails is one pair. Both scans are bent by nearly the same motion, which leaves the turn between them alone: it is that
from the middle of one sweep to the middle of the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.register import ScanMotion, TrackSettings, register, sample_points
from calib_core.geometry import log
from calib_core.planes.segment import SegmentSettings, segment_planes
from calib_core.types import FloatArray, IntArray, Scan

#: Pairs that are looked at: a lag and a rotation follow from some tens of them.
_MOST_PAIRS = 120
_POINTS = 2500
_SEGMENT = SegmentSettings(hypotheses=350, subsample=2000, min_points=60)
#: 1 sigma of the next scan about this one: what a hand does in a tenth of a second, and no more.
_STEP_RAD, _STEP_M = 0.2, 0.2
#: A turn told worse than this [rad], or by less than this share of the points, is none.
_TOLD_RAD, _TOLD_SHARE = 0.03, 0.4


@dataclass(frozen=True)
class PairTurns:
    """Turns between neighbouring scans. first: (N,) position of the former of each pair. rotvec_rad: (N, 3), its axes.

    std_rad: (N,) 1 sigma about the axis that its planes tell least.
    """

    first: IntArray
    rotvec_rad: FloatArray
    std_rad: FloatArray


def pair_turns(scans: Sequence[Scan], *, seed: int = 0) -> PairTurns:
    """The turns of every other pair of scans, of the middle of a long recording only."""
    first, turns, stds = [], [], []
    begin = max(0, (len(scans) - 2 * _MOST_PAIRS) // 2)
    for position in range(begin, min(begin + 2 * _MOST_PAIRS, len(scans) - 1), 2):
        turn = _turn(scans[position], scans[position + 1], position, seed)
        if turn is not None:
            first.append(position)
            turns.append(log(turn.R))
            stds.append(turn.std_rad)
    return PairTurns(np.array(first, dtype=np.int64), np.array(turns, dtype=np.float64).reshape(-1, 3), np.array(stds))


def _turn(one: Scan, other: Scan, position: int, seed: int) -> ScanMotion | None:
    """The other scan as seen from the one, None where two planes at least do not tell the turn between them."""
    points, _ = sample_points(one, _POINTS)
    fits = segment_planes(points, seed=seed, settings=_SEGMENT)
    if len(fits) < 2:
        return None
    known = PlaneMap(np.array([f.normal for f in fits]), np.array([f.offset_m for f in fits]))
    known.seed(points, 0.12)
    s, none = TrackSettings(), np.zeros(3)
    tie = np.repeat([1 / _STEP_RAD**2, 1 / _STEP_M**2, 1e8, 1e8], 3)
    start = ScanMotion(position, np.eye(3), none, none, none)
    points, tau = sample_points(other, _POINTS)
    if len(points) < s.least_points:
        return None
    # At rest within the sweep: both scans are bent alike.
    motion = register(
        points, np.zeros_like(tau), known, start, tie=tie, settings=s, position=position + 1, scales_m=s.wide_scales_m
    ).motion
    told = motion.std_rad < _TOLD_RAD and motion.share > _TOLD_SHARE
    return motion if told else None
