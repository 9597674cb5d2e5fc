"""Knots: the instants at which the solve has an IMU state, one per scan.

Lost scans keep their knot: IMU factors lead through them to the next tracked scan, which costs nothing and keeps every
preintegration as short as a scan. Where messages are missing altogether, knots are put into the gap for the same
reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.types import FloatArray, IntArray

#: A step between two scans of more than this many periods is a gap.
_GAP_PERIODS = 1.6


@dataclass(frozen=True, slots=True)
class Timeline:
    """start_s: (M,) [s, lidar clock].   duration_s: (M,) to the next knot.   position: (M,) of its scan, or -1."""

    start_s: FloatArray
    duration_s: FloatArray
    position: IntArray


def build_timeline(positions: Sequence[int], start_s: FloatArray, period_s: float) -> Timeline:
    """The knots of scans at positions, first points at start_s (S,) increasing. The last knot lasts one period."""
    starts, owners = [start_s[:1]], [np.array(positions[:1])]
    for i, span in enumerate(np.diff(start_s)):
        pieces = max(1, round(span / period_s)) if span > _GAP_PERIODS * period_s else 1
        starts.append(start_s[i] + span * np.arange(1, pieces) / pieces)
        owners.append(np.full(pieces - 1, -1))
        starts.append(start_s[i + 1 : i + 2])
        owners.append(np.array([positions[i + 1]]))
    start = np.concatenate(starts)
    return Timeline(start, np.append(np.diff(start), period_s), np.concatenate(owners).astype(np.int64))
