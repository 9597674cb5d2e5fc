"""A part of what there is that stands for all of it, evenly and the same each time: what is measured and drawn stays quick."""

from __future__ import annotations

import numpy as np

from calib_core.types import IntArray, PointArray, Scan


def spread(total: int, most: int) -> IntArray:
    """At most `most` places, evenly over 0 .. total - 1."""
    if total <= most:
        return np.arange(total)
    return np.linspace(0, total - 1, most).astype(np.int64)


def thinned_scan(scan: Scan, most: int) -> Scan:
    """The scan with at most `most` of its points."""
    if len(scan.points) <= most:
        return scan
    points: PointArray = scan.points[spread(len(scan.points), most)]
    return Scan(index=scan.index, stamp_ns=scan.stamp_ns, points=points)
