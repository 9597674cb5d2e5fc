"""Readings whose stamps step backwards: in the order of their stamps, or in that in which they came?

A network that overtakes itself leaves stamps right and the order wrong; a host that stamps by a jittering clock leaves the
order right and the stamps wrong. The readings say which: a motion is smooth, and in the wrong order it is less so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.types import FloatArray, IntArray

#: Readings further out of place than this are a clock that was set, of which neither order is right.
_FURTHEST = 16
#: Standard deviations by which the order in which they came has to be the smoother one.
_SURE = 5.0


@dataclass(frozen=True, slots=True)
class Came:
    """Readings that keep the order in which they came. kept: (K,) which, in it.   moved: of them, how many stamps are others'.

    rougher: squared second differences in the order of the stamps over those in theirs, where the two differ.
    """

    kept: IntArray
    moved: int
    rougher: float


def as_they_came(kept: IntArray, readings: FloatArray) -> Came | None:
    """The order in which readings came, where they say that it is theirs; None where that of their stamps stands.

    kept: (K,) which readings are used, in order of their stamps.   readings: (Q, C) as received, any units.
    """
    came = np.sort(kept)
    moved = kept != came
    if not moved.any() or np.abs(np.searchsorted(came, kept) - np.arange(len(kept))).max() > _FURTHEST:
        return None
    usual = 1.4826 * np.median(np.abs(np.diff(readings[came], 2, axis=0)), axis=0)
    by_stamp, as_came = _roughness(readings[kept], usual), _roughness(readings[came], usual)
    beside = np.convolve(moved, np.ones(3), mode="same")[1:-1] > 0
    apart = (by_stamp - as_came)[beside]
    if float(apart.sum()) <= _SURE * float(np.sqrt(np.sum(apart**2))):
        return None
    return Came(came, int(np.count_nonzero(moved)), float(by_stamp[beside].sum() / max(as_came[beside].sum(), 1e-30)))


def _roughness(values: FloatArray, usual: FloatArray) -> FloatArray:
    """(K - 2,) squared second differences, each channel in its usual one (C,)."""
    known = usual > 0.0
    return np.asarray(np.sum((np.diff(values, 2, axis=0)[:, known] / usual[known]) ** 2, axis=1), dtype=np.float64)
