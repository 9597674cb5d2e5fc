"""Whether a plane is one: it stands still, it is flat, it is a single surface. Each of the three has its own number.

What a solve leaves of a plane are averaged distances of many returns each, with a time and a place on the plane. If the
plane stands still and is flat, their averages over a second, and over a hand's breadth of it, are noise around zero:

    excess^2 = sum_g (o_g^2 - var(o_g)) / G,      o_g the weighted mean of group g,      var(o_g) = 1 / (its weight)

is zero on average, and what is beyond it are metres that noise did not make. Of few groups it strays: it counts where noise
would hardly ever make as much, a sum of squares being taken as a gamma law of its mean and variance. A person or a door
differs from second to second; a curtain, a cushion or the rim of a box from place to place; two surfaces taken for one
scatter within each average. No plane is perfect, and a motion that is not quite right yet shows on all of them: each is held
against what is usual among the others, counted by their points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from calib_core.full.planes.settings import JUDGEMENT
from calib_core.types import FloatArray, IntArray

Fault = Literal["", "moved", "bent", "mixed"]

_NAMES: tuple[Fault, ...] = ("moved", "bent", "mixed")
WORDS: dict[Fault, str] = {
    "moved": "moves against the other planes",
    "bent": "is not flat",
    "mixed": "is more than one surface",
}
#: The same before a solve.
SEEMS: dict[Fault, str] = {
    "moved": "seems to move against the other planes",
    "bent": "does not seem to be flat",
    "mixed": "seems to be more than one surface",
}


@dataclass(frozen=True)
class PlaneSamples:
    """Averaged distances of one plane's returns. time_s, distance_m, std_m: (N,).   cell: (N,) places on the plane.

    scatter: of single returns, mean square in standard deviations, 1 for noise alone.   points: how many there were.
    """

    time_s: FloatArray
    cell: IntArray
    distance_m: FloatArray
    std_m: FloatArray
    scatter: float
    points: float


@dataclass(frozen=True)
class Standing:
    """moved_m, bent_m: distances beyond noise, root mean square, from second to second and from place to place.

    scatter: as in the samples.   points: that it rests on.
    """

    moved_m: float
    bent_m: float
    scatter: float
    points: float


def standing_of(samples: PlaneSamples) -> Standing:
    """How a plane stands."""
    block = np.floor(samples.time_s / JUDGEMENT.block_s).astype(np.int64)
    moved_m = _excess_m(block, samples.distance_m, samples.std_m)
    bent_m = _excess_m(samples.cell, samples.distance_m, samples.std_m)
    return Standing(moved_m, bent_m, samples.scatter, samples.points)


def _excess_m(group: IntArray, distance_m: FloatArray, std_m: FloatArray) -> float:
    """What groups' mean distances have beyond noise, root mean square; 0 where noise would make as much."""
    if len(group) == 0:
        return 0.0
    _, index = np.unique(group, return_inverse=True)
    count = np.bincount(index)
    weight = np.bincount(index, 1.0 / std_m**2)
    mean = np.bincount(index, distance_m / std_m**2) / weight
    judged = count >= JUDGEMENT.fewest
    if not judged.any():
        return 0.0
    share = count[judged] / count[judged].sum()
    noise = float(share @ (1.0 / weight[judged]))
    beyond = float(share @ mean[judged] ** 2) - noise
    variance = 2.0 * float(np.sum((share / weight[judged]) ** 2))
    most = variance / noise * float(scipy.special.gammaincinv(noise**2 / variance, JUDGEMENT.confidence))
    return float(np.sqrt(beyond)) if beyond > most - noise else 0.0


def doubts(
    standings: Sequence[Standing], least_m: float = JUDGEMENT.least_m, most_m: float = JUDGEMENT.most_m
) -> FloatArray:
    """How far each plane is towards having moved, being bent, being several surfaces: (P, 3), at fault from 1 on.

    least_m: below this nothing is a fault, and beyond most_m it is one whatever the others are like.
    """
    points = np.array([s.points for s in standings])
    if not points.sum() > 0:
        return np.zeros((len(standings), 3))
    lengths = np.array([[s.moved_m, s.bent_m] for s in standings])
    limits = [float(np.clip(JUDGEMENT.times * usual(length, points), least_m, most_m)) for length in lengths.T]
    scatter = np.array([s.scatter for s in standings])
    # What noise alone makes is no second surface, however little a floor scatters that is seen at a grazing angle.
    mixed = scatter / max(JUDGEMENT.mixed_times * usual(scatter, points), 1.0)
    return np.column_stack([lengths / np.array(limits), mixed])


def fault_of(doubt: FloatArray) -> Fault:
    """What is most wrong with a plane, "" where nothing is. doubt: (3,) a row of `doubts`."""
    worst = int(np.argmax(doubt))
    return _NAMES[worst] if doubt[worst] > 1.0 else ""


def is_mostly_bent(standings: Sequence[Standing]) -> bool:
    """Whether the usual plane is not flat."""
    points = np.array([s.points for s in standings])
    bent = np.array([s.bent_m for s in standings])
    return bool(points.sum() > 0 and usual(bent, points) > JUDGEMENT.least_m)


def usual(value: FloatArray, points: FloatArray) -> float:
    """The value of the plane in the middle, counted by points. (P,) each."""
    order = np.argsort(value)
    middle = int(np.searchsorted(np.cumsum(points[order]), 0.5 * points.sum()))
    return float(value[order][min(middle, len(order) - 1)])
