"""Which points of a scan are taken where not all are: every laser's, and moments of few lasers at once."""

from __future__ import annotations

from math import gcd

import numpy as np

from calib_core.full.joint.settings import SURVEYING
from calib_core.full.prepare.settings import LASERS
from calib_core.types import IntArray, PointArray

#: The primes in the numbers of lasers on rotors.
_LASERS_SHARE = 2 * 5
#: Which part of the lasers a scan has is told by its number times this: whatever scans are picked, each eighth or each twelfth,
#: all parts are among them.
_GOLDEN = (5.0**0.5 - 1.0) / 2.0


def across_lasers(stride: int) -> int:
    """The nearest stride that visits every laser, the larger of two as near.

    Sweeps list 16, 32, 40, 64, 80 or 128 lasers in turn: each fourth point of them all is that of the same four of sixteen.
    """
    tries = (stride + step for away in range(6) for step in (away, -away))
    return next(each for each in tries if each > 0 and gcd(each, _LASERS_SHARE) == 1)


def thinned(points: PointArray, stride: int, position: int) -> IntArray:
    """Places (M,) in a scan (N,), the one at this position of the recording, of about every so many-th point.

    Behind many lasers these are more points of fewer of them, in each scan of others. Moments are of one laser each: were all
    thinned alike, there would be as many moments as points.
    """
    lasers, parts = int(points["ring"].max(initial=0)) + 1, 1
    while lasers >= 2 * parts * SURVEYING.lasers_at_once and stride >= 2 * parts * SURVEYING.least_stride:
        parts *= 2
    if parts == 1 or lasers > LASERS.most:
        return np.arange(0, len(points), stride)
    turn = int(position * _GOLDEN % 1.0 * parts)
    return np.flatnonzero(points["ring"] % parts == turn)[:: across_lasers(round(stride / parts))]
