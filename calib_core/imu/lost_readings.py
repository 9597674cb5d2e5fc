r"""Readings that were lost on the way, as their neighbours tell them.

Between two readings the interpolation has the motion, which is slow. What shakes a sensor goes round in few samples: where a
reading of it is missing, the motion itself is short by what was shaken meanwhile, and a hundred of them are a walk of their own.
What is missing is what the filter that expects readings from their neighbours best (reading_prediction.py) expects of it, all of
them solved for at once where some are neighbours of others,

    y_m - sum_j c_j y_{m+j} = 0      for all m that are missing,

and how far off that is, is asked of readings that are there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from calib_core.imu.preintegration import NoiseDensity, UpsampledImu
from calib_core.imu.quantisation import resolution
from calib_core.imu.reading_prediction import SPAN, forecast_filter
from calib_core.types import BoolArray, FloatArray, ImuData, IntArray

#: judged: so many readings in a row are restored at most: what a queue drops. Further from its neighbours nothing is expected.
MOST = 3
#: judged: stamps within this share of a period of a whole number of them are on one row, and of those that many have to be: where
#: the sampling itself jitters, nobody knows what is missing.
_NEAR, _ON_ROW = 0.1, 0.95
#: judged: readings that a filter is fitted to, ten for each of its numbers at least, and places where it is tried. Time and a
#: tenth of a standard deviation's size depend on them.
_FEWEST, _FITTED, _TRIED = 20 * SPAN, 20_000, 200


@dataclass(frozen=True)
class Restored:
    """imu: with the readings that were missing. index: (R,) which they are.   variance: (R, 6) of them, gyro first, about what
    would have been read, noise included.   run: (R,) how many were missing in a row.
    """

    imu: ImuData
    index: IntArray
    variance: FloatArray
    run: IntArray

    def after(self, before: Restored | None) -> Restored:
        """Of both, where what was lost was restored to what another had made of the readings."""
        if before is None:
            return self
        index = np.searchsorted(self.imu.stamps_ns, before.imu.stamps_ns[before.index])
        return replace(
            self,
            index=np.concatenate([self.index, index]),
            variance=np.concatenate([self.variance, before.variance]),
            run=np.concatenate([self.run, before.run]),
        )

    def allowed_for(self, up: UpsampledImu, stamps_s: FloatArray, noise: NoiseDensity) -> UpsampledImu:
        """The links with what restored readings are further off than read ones. stamps_s: (Q,) of all.

        Those missing in a row are off alike.
        """
        period = float(np.median(np.diff(stamps_s)))
        read = np.concatenate([noise.gyro_rad_s_sqrt_hz, noise.accel_m_s2_sqrt_hz]) ** 2 / period
        beyond = np.maximum(self.variance - 2.0 * read, 0.0) * self.run[:, None]
        link = np.searchsorted(up.knots_s, stamps_s[self.index], side="right") - 1
        mine = (link >= 0) & (link < len(up.excess_density2))
        excess = up.excess_density2.copy()
        np.add.at(excess, link[mine], beyond[mine] * (period**2 / up.spacing_s))
        return replace(up, excess_density2=excess)


def restored(imu: ImuData) -> Restored | None:
    """With what was lost, where up to MOST in a row were; None where nothing was, or nobody can tell."""
    steps = np.diff(imu.stamps_ns)
    if len(steps) < _FEWEST:
        return None
    period_ns = float(np.median(steps))
    apart = np.rint(steps / period_ns).astype(np.int64)
    on_row = (np.abs(steps / period_ns - apart) < _NEAR) & (apart >= 1)
    if float(np.mean(on_row)) < _ON_ROW or not (on_row & (apart > 1) & (apart <= MOST + 1)).any():
        return None
    grid = _Grid.of(apart, on_row & (apart <= MOST + 1))
    missing, whole = grid.missing(), grid.whole()
    run = grid.run_of(missing)
    if not len(missing) or len(whole) < _FEWEST or not all(len(_places(whole, n)) for n in np.unique(run).tolist()):
        return None
    fitted = _some(whole, _FITTED)
    read = np.hstack([imu.gyro_rad_s, imu.accel_m_s2])
    mean = read.mean(axis=0)
    values = np.zeros((len(grid.known), read.shape[1]))
    values[grid.place] = read - mean
    filters = [forecast_filter(np.ascontiguousarray(channel), fitted) for channel in values.T]
    found = np.stack([_solved(y, c, missing) for y, c in zip(values.T, filters, strict=True)], axis=1)
    found = _in_steps(found, read - mean)
    off = {n: _tried(values, filters, whole, n) for n in np.unique(run).tolist()}
    # From the reading before each of them on.
    before = np.searchsorted(grid.place, missing) - 1
    past = missing - grid.place[before]
    stamps_ns = imu.stamps_ns[before] + np.rint(steps[before] * (past / apart[before])).astype(np.int64)
    index = before + 1 + np.arange(len(missing))
    whole_imu = replace(
        imu,
        stamps_ns=np.insert(imu.stamps_ns, before + 1, stamps_ns),
        gyro_rad_s=np.insert(imu.gyro_rad_s, before + 1, found[:, :3] + mean[:3], axis=0),
        accel_m_s2=np.insert(imu.accel_m_s2, before + 1, found[:, 3:] + mean[3:], axis=0),
    )
    return Restored(whole_imu, index, np.array([off[n] for n in run.tolist()]), run)


@dataclass(frozen=True)
class _Grid:
    """Samples in a row, those that were lost among them; rows further apart than a filter is long.

    place: (Q,) where readings are.   known: (G,) whether a sample was read.   inside: (G,) whether it is of a row at all.
    """

    place: IntArray
    known: BoolArray
    inside: BoolArray

    @staticmethod
    def of(apart: IntArray, joined: BoolArray) -> _Grid:
        """apart: (Q - 1,) samples from reading to reading.   joined: (Q - 1,) whether they are of one row."""
        place = SPAN + np.concatenate([[0], np.cumsum(np.where(joined, apart, 2 * SPAN + 1))])
        known, inside = np.zeros(place[-1] + SPAN + 1, np.bool_), np.zeros(place[-1] + SPAN + 1, np.bool_)
        known[place] = inside[place] = True
        for n in range(2, MOST + 2):
            for at in place[:-1][joined & (apart == n)]:
                inside[at + 1 : at + n] = True
        return _Grid(place, known, inside)

    def missing(self) -> IntArray:
        """Those that can be told: with readings or others that can be told all around."""
        tellable = self.inside.copy()
        while True:
            lost = np.flatnonzero(tellable & ~self.known)
            outside = np.concatenate([[0], np.cumsum(~tellable)])
            kept = outside[lost + SPAN + 1] == outside[lost - SPAN]
            if kept.all():
                return np.asarray(lost)
            tellable[lost[~kept]] = False

    def whole(self) -> IntArray:
        """Readings around which none is missing."""
        unknown = np.concatenate([[0], np.cumsum(~self.known)])
        return np.asarray(self.place[unknown[self.place + SPAN + 1] == unknown[self.place - SPAN]])

    def run_of(self, missing: IntArray) -> IntArray:
        """(R,) how many are missing in a row with each."""
        number = np.cumsum(np.append(True, np.diff(missing) > 1)) - 1
        return np.asarray(np.bincount(number)[number])


def _in_steps(found: FloatArray, read: FloatArray) -> FloatArray:
    """On the steps that readings come in: between them nothing is read."""
    step = resolution(read[:_FITTED])
    size = np.where(step > 0.0, step, 1.0)
    return np.asarray(np.where(step > 0.0, read[0] + np.rint((found - read[0]) / size) * size, found))


def _some(of: IntArray, most: int) -> IntArray:
    """So many of them at most, evenly."""
    return np.asarray(of[np.unique(np.linspace(0, len(of) - 1, min(len(of), most)).astype(np.int64))])


def _solved(y: FloatArray, c: FloatArray, missing: IntArray) -> FloatArray:
    """(R,) of one channel (G,), zero where samples are missing."""
    around = missing[:, None] + np.arange(-SPAN, SPAN + 1)
    at = np.searchsorted(missing, around)
    among = missing[np.minimum(at, len(missing) - 1)] == around
    row, step = np.nonzero(among)
    shape = (len(missing), len(missing))
    coupled = scipy.sparse.csc_matrix((c[step], (row, at[row, step])), shape=shape)
    one = scipy.sparse.identity(len(missing), format="csc")
    return np.asarray(scipy.sparse.linalg.spsolve(one - coupled, y[around] @ c))


def _places(whole: IntArray, n: int) -> IntArray:
    """Where so many in a row can be left out to see what becomes of them."""
    return np.asarray(whole[np.isin(whole + n - 1, whole)])


def _tried(values: FloatArray, filters: list[FloatArray], whole: IntArray, n: int) -> FloatArray:
    """(C,) mean square by which so many in a row come out otherwise than they were read, where they were."""
    unknown = np.arange(n)
    places = _some(_places(whole, n), _TRIED)
    out = np.zeros(len(filters))
    window = np.arange(-SPAN, SPAN + n)
    for channel, c in enumerate(filters):
        rows = np.zeros((n, len(window)))
        for k in range(n):
            rows[k, k : k + 2 * SPAN + 1] = c
        among = rows[:, SPAN + unknown].copy()
        rows[:, SPAN + unknown] = 0.0
        told = values[places[:, None] + window, channel] @ rows.T @ np.linalg.inv(np.eye(n) - among).T
        out[channel] = np.mean((told - values[places[:, None] + unknown, channel]) ** 2)
    return out
