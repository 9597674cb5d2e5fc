"""A part of a scan's points that stands for all of them."""

from __future__ import annotations

from calib_core.planes.sample_kernels import places_kernel
from calib_core.types import IntArray, Scan


def evenly_spread(n: int, count: int) -> IntArray:
    """About `count` of n places in order: a golden-ratio stride visits rings and azimuths alike, however packets interleave."""
    return places_kernel(n, count)


def sample_scan(scan: Scan, count: int) -> Scan:
    """The scan with at most `count` of its points, spread evenly whatever the interleaving, in their own order."""
    n = len(scan.points)
    if n <= count:
        return scan
    return Scan(scan.index, scan.stamp_ns, scan.points[evenly_spread(n, count)])
