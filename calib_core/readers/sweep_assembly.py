"""Clouds that are a part of a sweep each, as drivers send them packet by packet or by halves of a turn: gathered into scans that
show enough at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calib_core.readers.clouds.cloud import RawCloud, StructArray, points_mark
from calib_core.types import BoolArray, Clue, Finding, FloatArray, Scan

#: The usual turn of a lidar, and the usual frame of one that does not turn: a scan is gathered to this length.
_SCAN_S = 0.1
#: Clouds that come less often are scans: the quickest rotors turn 20 times a second.
_SHORTEST_S = 0.04
#: Clouds that come no less often than this may be halves of a scan: two of them last no longer than the slower lidars' one.
_HALF_S = 0.08

#: Azimuths are counted in so many bins.
_BINS = 72
#: One point of so many is asked first; an odd number meets all lasers of a column in turn.
_FEW = 7
#: Clouds make a turn if together they see so much of it, and each little more than its part of it.
_WHOLE, _MORE = 0.9, 1.2
#: Two clouds in a row are halves if together they see so many times what one does; what stays in view while a lidar turns by 3
#: rad/s, and is 60 deg wide, is 1.15 times as wide after a twentieth of a second.
_OTHER = 1.35
#: More parts than this come quicker than any scan.
_MOST_OF_A_TURN = 4


def parts_of_a_scan(period_s: float, clouds: Sequence[RawCloud]) -> int:
    """How many clouds make a scan, 1 where each is one. period_s: usual, between clouds.   clouds: the first of them, in order.

    Those that come quicker than any scan, by time; those that see a part of a turn each, by what so many see together: half of a
    room is two walls, and every other cloud sees others. So it is with a rosette's that come 20 times a second, though no number
    of them sees all around.
    """
    if 0.0 < period_s < _SHORTEST_S:
        return max(1, round(_SCAN_S / period_s))
    seen = np.array([_bearings(cloud) for cloud in clouds if cloud.points.size]).reshape(-1, _BINS)
    one, two = _seen_by(seen, 1), _seen_by(seen, 2)
    for parts in range(2, _MOST_OF_A_TURN + 1):
        if np.median(one) > _MORE / parts:
            break
        if np.median(_seen_by(seen, parts)) >= _WHOLE:
            return parts
    # Of a view that is cut, one cloud may show all and the next nothing: the middle one of either says little.
    return 2 if 0.0 < period_s < _HALF_S and np.mean(two) > _OTHER * np.mean(one) else 1


def _seen_by(seen: BoolArray, parts: int) -> FloatArray:
    """How much of a turn so many clouds in a row see together, wherever they begin; 0 where there are fewer. seen: (K, 72)."""
    together = [float(np.mean(seen[k : k + parts].any(axis=0))) for k in range(len(seen) - parts + 1)]
    return np.array(together or [0.0])


def _bearings(cloud: RawCloud) -> BoolArray:
    """(72,) whether any point lies at an azimuth. Where a few show that all are seen, the rest is not asked."""
    few = _bearings_of(cloud.points[::_FEW])
    return few if few.all() else _bearings_of(cloud.points)


@np.errstate(invalid="ignore")  # damaged floats are masked, not warned of
def _bearings_of(points: StructArray) -> BoolArray:
    x, y = points["x"].astype(np.float64), points["y"].astype(np.float64)
    known = np.isfinite(x) & np.isfinite(y) & ((x != 0.0) | (y != 0.0))
    return np.asarray(np.histogram(np.arctan2(y[known], x[known]), _BINS, (-np.pi, np.pi))[0] > 0, dtype=np.bool_)


def lasting_ns(parts: int, period_s: float) -> int:
    """How long after the first part of a scan its last one may begin."""
    return round((parts - 0.5) * period_s * 1e9)


def gathered_finding(topic: str, parts: int, period_s: float) -> Finding:
    """What is said of it."""
    return Finding(
        "points.gathered",
        "info",
        f"Clouds on {topic} come every {1e3 * period_s:.3g} ms, each a part of a sweep: {parts} at a time are taken as one scan.",
        (Clue("clouds a scan", parts), Clue("period of clouds", round(period_s, 6), "s")),
    )


@dataclass(slots=True)
class Gathering:
    """Parts of the scan that is being gathered. lasting_ns: of a whole one.

    A part belongs to it if it begins within that time of the first part; one that comes late begins a scan of its own, which is
    put in order later; one of the stamp of the one before is left out. n_twice: how many held its points.   n_unlike: how many
    held others.
    """

    lasting_ns: int
    n_twice: int = 0
    n_unlike: int = 0
    _parts: list[Scan] = field(default_factory=list)

    def add(self, part: Scan) -> Scan | None:
        """The scan before, where the part begins another."""
        if self._parts:
            since_first_ns = part.stamp_ns - self._parts[0].stamp_ns
            if part.stamp_ns == self._parts[-1].stamp_ns:
                if points_mark(part.points) == points_mark(self._parts[-1].points):
                    self.n_twice += 1
                else:
                    self.n_unlike += 1
                return None
            if part.stamp_ns > self._parts[-1].stamp_ns and since_first_ns < self.lasting_ns:
                self._parts.append(part)
                return None
        done = self.rest()
        self._parts = [part]
        return done

    def rest(self) -> Scan | None:
        """What is gathered by now."""
        if not self._parts:
            return None
        first = self._parts[0]
        points = np.concatenate([part.points for part in self._parts])
        sizes = [part.points.size for part in self._parts]
        points["offset_ns"] += np.repeat([part.stamp_ns - first.stamp_ns for part in self._parts], sizes).astype(
            np.int32
        )
        self._parts = []
        return Scan(first.index, first.stamp_ns, points)
