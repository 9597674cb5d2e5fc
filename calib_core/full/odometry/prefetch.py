"""The scans of a march: their stamps, and some points of each, taken on another thread ahead of the march."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future

from calib_core.full.odometry.register import sample_points
from calib_core.full.odometry.settings import FOLLOWING
from calib_core.threads import workers
from calib_core.types import FloatArray, Scan

_Sample = tuple[FloatArray, FloatArray]


class Ahead:
    """Samples of so many points of scans within a range of positions. stamps_ns: of these scans, by position."""

    def __init__(self, scans: Sequence[Scan], count: int, within: range) -> None:
        self._scans = scans
        self._count = count
        self._within = range(max(within.start, 0), min(within.stop, len(scans)))
        self._taken: dict[int, Future[list[_Sample]]] = {}
        self.stamps_ns = {position: scans[position].stamp_ns for position in self._within}

    def __contains__(self, position: int) -> bool:
        return position in self._within

    def between_s(self, one: int, other: int) -> float:
        """From one scan's stamp to another's."""
        return (self.stamps_ns[other] - self.stamps_ns[one]) * 1e-9

    def sample(self, position: int, direction: int) -> _Sample:
        """Of one scan (K, 3) [m], (K,) [s]. direction: 1 or -1, of the march: the next ones are begun with."""
        block = position // FOLLOWING.ahead_scans
        ahead = (block, block + direction)
        self._taken = {each: self._taken.get(each) or workers().submit(self._samples, each) for each in ahead}
        return self._taken[block].result()[position - self._positions(block).start]

    def _positions(self, block: int) -> range:
        first = max(block * FOLLOWING.ahead_scans, self._within.start)
        return range(first, max(first, min((block + 1) * FOLLOWING.ahead_scans, self._within.stop)))

    def _samples(self, block: int) -> list[_Sample]:
        return [sample_points(self._scans[position], self._count) for position in self._positions(block)]
