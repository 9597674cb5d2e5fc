"""How well each scan agrees with the planes: the plot on which a bad scan is found.

rms_m    spread of the scan's points about their nearest planes, de-skewed, points within GATE_M only
share    how many of its points are as near to a plane as the scene colours them by it; the others are grey there
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.results.plane_table import PlaneTable
from app.results.thickness import GATE_M as ON_PLANE_M
from app.results.thinning import thinned_scan
from app.schemas.results import ScanQuality
from calib_core import api
from calib_core.result import PlaneQuality
from calib_core.types import Recording, Trajectory

#: Wider than a wall's thickness, so that a scan that is off by decimetres shows.
GATE_M = 0.30
#: Points looked at of each scan: a per cent of its spread, and a long recording stays quick.
POINTS = 2000


def measure_scans(
    recording: Recording,
    trajectory: Trajectory,
    planes: Sequence[PlaneQuality],
    *,
    used_ns: frozenset[int] | None = None,
) -> ScanQuality:
    """Spread and share of every scan; None where the motion does not reach, is bridged, or the solve did not look.

    used_ns: stamps of the scans that it looked at; None for all.
    """
    table = PlaneTable.of(planes)
    first_ns = recording.scans[0].stamp_ns if len(recording.scans) else 0
    t_s: list[float] = []
    rms_m: list[float | None] = []
    share: list[float | None] = []
    for scan in recording.scans:
        t_s.append(round((scan.stamp_ns - first_ns) * 1e-9, 6))
        left_out = used_ns is not None and scan.stamp_ns not in used_ns
        if left_out or len(scan.points) == 0 or not api.covers(trajectory, scan):
            rms_m.append(None)
            share.append(None)
            continue
        owner, dist_m = table.nearest(api.map_points(thinned_scan(scan, POINTS), trajectory), gate_m=GATE_M)
        on = owner >= 0
        rms_m.append(float(np.sqrt(np.mean(np.square(dist_m[on], dtype=np.float64)))) if on.any() else None)
        share.append(float((on & (np.abs(dist_m) <= ON_PLANE_M)).mean()))
    return ScanQuality(t_s=t_s, rms_m=rms_m, share=share, points_each=POINTS)
