"""Whether somebody thinned the clouds by a grid, one point to a cell, and how large its cells are.

A voxel filter cuts space into cubes along the lidar's own axes and leaves one point of each: the first, or the mean. Which points
are left then depends on their noise. The first return in a cell that a beam sweeps into is one that noise pushed over the face,
and a wall that grazes a face leaves the few returns that noise pushed through it as much say as the many that stayed: hand-held
recordings of 15 s, 10 cm, answered 2 to 4 sigmas off, all the same way. In which cell a return lies is known, though, and given
that, its noise follows the normal law between the two faces that its ray passes: that is what is solved for
(`factors/kernels.py`, `as_sieved`). It costs what such a cell tells less of.

A mean of points may bear their mean time or that of the first. A rotor looks where its time says, and tells; where nothing
does, the time offset is unsure by half the time in which the beam passes a cell, or nothing.

Told by what is not there: of a cloud as a lidar sends it two returns often lie in one cell, wherever the grid begins; of a
thinned one none do in its own grid, and many in one half a cell beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.prepare.settings import SIEVING
from calib_core.memoised import told_once
from calib_core.types import FloatArray, IntArray, PointArray, Scan

#: Row, column and layer as one number: 2^20 cells either way are kilometres.
_ROW_KEY = np.array([1 << 42, 1 << 21, 1])


@dataclass(frozen=True, slots=True)
class Sieve:
    """cell_m: edge of the cells.   shared: points of the sample in a cell with another one.   beside: the same in grids half a
    cell beside, mean.   points: of the sample.   passing_s: in which the beam passes a cell, median over the points; 0 where
    directions tell that times are their own.
    """

    cell_m: float
    shared: int
    beside: float
    points: int
    passing_s: float

    @property
    def std_s(self) -> float:
        """What the time offset is unsure by: the mean of a cell's points bears their mean time, or that of the first."""
        return float(np.sqrt(0.5) * 0.5 * self.passing_s)


@told_once
def sieve_of(scans: Sequence[Scan], period_s: float) -> Sieve | None:
    """What clouds were thinned by; None where they were not, or where it left no trace. period_s: for a look round."""
    places: IntArray = np.unique(np.linspace(0, len(scans) - 1, min(len(scans), SIEVING.scans)).astype(np.int64))
    sample = [scans[int(place)].points for place in places]
    clouds = [points["xyz"] for points in sample]
    if not clouds:
        return None
    first = max(clouds, key=len)[: SIEVING.first_points].astype(np.float64)
    fewest = SIEVING.fewest_beside / SIEVING.scans
    for cell_m in _sizes():
        if _shared(first / cell_m) > SIEVING.most_shared * len(first) or _beside(first / cell_m) < fewest:
            continue
        shared, beside = 0, 0.0
        for cloud in clouds:
            place = cloud.astype(np.float64) / cell_m
            shared += _shared(place)
            beside += _beside(place)
        if beside >= SIEVING.fewest_beside and shared <= SIEVING.most_shared * beside:
            angle_rad = cell_m / float(
                np.median(np.concatenate([np.hypot(cloud[:, 0], cloud[:, 1]) for cloud in clouds]))
            )
            told = _scatter_rad(sample[:: SIEVING.scans // 4], period_s) < SIEVING.in_time * angle_rad
            passing_s = 0.0 if told else period_s * angle_rad / (2.0 * np.pi)
            return Sieve(cell_m, shared, beside, sum(map(len, clouds)), passing_s)
    return None


def in_words(sieve: Sieve, topic: str) -> str:
    """To a person: what was found, by what, what is done and what to do."""
    return (
        f"the clouds of {topic} were thinned by a grid of {100.0 * sieve.cell_m:.3g} cm: only {sieve.shared} of {sieve.points} "
        f"points share a cell, while {sieve.beside:.0f} would if the grid were shifted by half a cell. Which points a grid keeps "
        "depends on their noise: this is allowed for, but the removed points are lost. Record the cloud as the lidar's driver "
        "sends it"
    )


def _sizes() -> list[float]:
    """The largest first: of a grid, those that it is a multiple of hold no two points either."""
    least, most = round(SIEVING.least_m / SIEVING.step_m), round(SIEVING.most_m / SIEVING.step_m)
    return [size * SIEVING.step_m for size in range(most, least - 1, -1)]


def _beside(place: FloatArray) -> float:
    """The same half a cell beside along each axis, mean."""
    return float(np.mean([_shared(place + half) for half in np.eye(3) * 0.5]))


def _shared(place: FloatArray) -> int:
    """Points (N, 3), in cells, that share one with a point before them."""
    key = np.floor(place).astype(np.int64) @ _ROW_KEY
    return len(key) - len(np.unique(key))


def _scatter_rad(sample: Sequence[PointArray], period_s: float) -> float:
    """How far points look from where a rotor's turning has each laser look at their times, of half of them farther.

    period_s: of scans, which packets cut, and so the rotor's but for a part in a hundred: the best near it counts, either way.
    """
    turns = 2.0 * np.pi / period_s * (1.0 + np.linspace(-SIEVING.uneven, SIEVING.uneven, SIEVING.periods))
    scatters = []
    for rate in np.concatenate([turns, -turns]):
        off = []
        for points in sample:
            x, y = points["xyz"][:, 0].astype(np.float64), points["xyz"][:, 1].astype(np.float64)
            looks = (x + 1j * y) * np.exp(-1j * rate * 1e-9 * points["offset_ns"].astype(np.float64))
            looks /= np.maximum(np.abs(looks), np.finfo(np.float64).tiny)
            laser = points["ring"].astype(np.int64)
            middle = np.bincount(laser, looks.real) + 1j * np.bincount(laser, looks.imag)
            off.append(np.abs(np.angle(looks * middle[laser].conj())))
        scatters.append(float(np.median(np.concatenate(off))))
    return min(scatters)
