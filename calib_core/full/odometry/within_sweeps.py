"""Whether what turns within the sweeps is what turns between them: of points that carry the times at which they were measured,
both are the same motion.

Clouds that another program has straightened show walls that stand still in each sweep while the lidar turns from one to the
next; point times that run backwards show walls that turn the other way; times in a wrong unit ones that turn too fast or too
slowly. The time offset and the whole correction of the sweeps rest on these times, and nothing later tells of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib_core.errors import Refused
from calib_core.full.odometry.register import ScanMotion
from calib_core.full.odometry.settings import WITHIN
from calib_core.full.run import Run
from calib_core.geometry import log


@dataclass(frozen=True, slots=True)
class WithinSweeps:
    """share: of the turn between the sweeps' beginnings that shows within them.   std: of it, by how spans scatter.

    spans: from one sweep to the next, that turned enough to tell.
    """

    share: float
    std: float
    spans: int


def turning_within(run: Run, motions: Sequence[ScanMotion]) -> WithinSweeps | None:
    """Of a track that the lidar alone was followed by; None where too little of it turned."""
    clocks = run.clocks
    seen = [
        (one, next_)
        for one, next_ in pairwise(motions)
        if next_.position == one.position + 1 and one.share > 0 and next_.share > 0
    ]
    if not seen:
        return None
    first = np.array([one.position for one, _ in seen])
    period_s = clocks.scan_s[first + 1] - clocks.scan_s[first]
    turns = log(np.array([one.R.T @ next_.R for one, next_ in seen]))
    between = turns / np.maximum(period_s, WITHIN.shortest_s)[:, None]
    within = np.array([one.omega_rad_s for one, _ in seen])
    usual_s = float(np.median(period_s))
    told = (
        (np.linalg.norm(between, axis=1) > WITHIN.turning_rad_s)
        & (period_s < WITHIN.longest_periods * usual_s)
        & (clocks.sweep_s[first] > WITHIN.least_sweep * usual_s)
    )
    if np.count_nonzero(told) < WITHIN.fewest_spans:
        return None
    along = np.sum(within * between, axis=1)[told]
    square = np.sum(between**2, axis=1)[told]
    share = float(along.sum() / square.sum())
    std = float(np.sqrt(np.sum((along - share * square) ** 2)) / square.sum())
    return WithinSweeps(share, std, len(square))


def require_measured_sweeps(run: Run, motions: Sequence[ScanMotion]) -> None:
    """Raises Refused where the points' times are not those at which they were measured; says where they seem off."""
    found = turning_within(run, motions)
    if found is None:
        return
    share, wide = found.share, WITHIN.sigmas * found.std
    shown = f"in {found.spans} sweeps the surroundings turn by {share:.2f} of what the lidar turns from one to the next"
    if share + wide < -WITHIN.straightened:
        raise Refused(
            "points.times_backwards",
            f"the times of the points run backwards: {shown}; expected 1; correct the points' times in the lidar's driver",
        )
    if share + wide < WITHIN.straightened:
        raise Refused(
            "points.straightened",
            f"the clouds were straightened before they were recorded, or their points' times are not those of their "
            f"measurement: {shown}; expected 1; record the driver's own clouds, with its motion compensation switched off",
        )
    if abs(share - 1.0) > max(WITHIN.least_off, wide):
        run.say(
            "warning",
            "points.times_off",
            f"the points' times seem to be {1.0 / share:.2f} of what they should be: {shown}, expected 1; the time offset and "
            "all else rest on them: check the unit and the rate in the lidar's driver",
        )
