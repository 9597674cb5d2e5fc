"""A sample of the scans, small enough to be held: what the forecast is made from. The planes are those of whole scans."""

from __future__ import annotations

from calib_core.full.prepare.settings import SAMPLED
from calib_core.types import IntArray, Recording, Scan

#: A forecast looks at no more than this: a longer recording only knows the same better.
LOOKED_S = 61.0
#: Points of a scan in which planes may be looked for: a single scan has to show them.
_DENSE_POINTS = 15_000

#: Shares of the recording from which the planes may be followed anew (full/odometry/reference.py).
_ELSEWHERE = (0.12, 0.25, 0.5, 0.75, 0.88)


class SampledScans:
    """Scans of the first minute, thinned; those that may serve as the reference less so.

    n_scans: in the recording.   period_s: between them.
    """

    def __init__(self, n_scans: int, period_s: float) -> None:
        self._looked = min(n_scans, int(LOOKED_S / max(period_s, 1e-3)))
        self._n_scans = n_scans
        references = {0, 1, 2, *range(5, self._looked, max(5, self._looked // 40))}
        elsewhere = {round(share * (self._looked - 1)) for share in _ELSEWHERE}
        self._dense = references | elsewhere
        self.scans: list[Scan] = []
        self.points: list[int] = []

    @staticmethod
    def of(recording: Recording) -> SampledScans:
        """The sample of a recording that is decoded already."""
        sampled = SampledScans(len(recording.scans), recording.lidar.period_s)
        for position in range(len(recording.scans)):
            if not sampled.wants(position):
                break
            sampled.add(recording.scans[position])
        return sampled

    def wants(self, position: int) -> bool:
        """Whether the scan at this position is looked at."""
        return position < self._looked

    def count(self, ahead: int = 0) -> int:
        """Points of the next scan that stay, or of one that comes so many later."""
        return _DENSE_POINTS if len(self.scans) + ahead in self._dense else SAMPLED.points

    def add(self, scan: Scan, thinned: Scan | None = None) -> None:
        """Take a scan, in order; its index is its position. thinned: what is to stay of it, None where nobody has looked."""
        # Its loop brings the compiler, which is imported while the first scans are read.
        from calib_core.planes.sample import sample_scan

        self.points.append(len(scan.points))
        self.scans.append(thinned or sample_scan(scan, self.count()))

    def drop(self, positions: IntArray) -> None:
        """Leave out the scans that came at these positions."""
        dropped = {int(position) for position in positions}
        kept = [k for k, scan in enumerate(self.scans) if scan.index not in dropped]
        self.scans, self.points = [self.scans[k] for k in kept], [self.points[k] for k in kept]

    def put_in_order(self) -> None:
        """Sort by stamp; of one stamp the first counts."""
        stamps_ns = [scan.stamp_ns for scan in self.scans]
        order = sorted(range(len(stamps_ns)), key=stamps_ns.__getitem__)
        kept = [k for at, k in enumerate(order) if at == 0 or stamps_ns[k] != stamps_ns[order[at - 1]]]
        self.scans, self.points = [self.scans[k] for k in kept], [self.points[k] for k in kept]

    @property
    def share(self) -> float:
        """The part of the recording that is looked at, 0 to 1."""
        return min(1.0, self._looked / max(self._n_scans, 1))
