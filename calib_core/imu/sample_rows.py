"""Even rows of samples behind stamps that jitter: which sample of its row each reading is, and the line of their times.

A row is counted by a loop that follows phase and period, then put right by its own line (`clock_line.py`); it ends where
readings were lost for long. Stamps that jitter by more than half a period have no nearest sample: they are counted by their
order. Stamps that wander more slowly than they jitter are no jitter about that line: such a row is halved until its parts do
not, and a part that still does has no line; a reading that was lost where they are counted by their order is such a part.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
import scipy

from calib_core.imu.clock_line import fits_as_well, line_of, normal_equations, onto_nodes, places
from calib_core.types import BoolArray, FloatArray, IntArray

#: A pause of more than this many periods ends a row: how many readings were lost in it is not sure.
_GAP_PERIODS = 3.5
#: A row has at least so many readings, half of which are stamped in time: a row of the fewest must not keep a late stamp because
#: it has none to spare.
LEAST = 100
#: Of a critically damped loop that follows the samples.
_PHASE_GAIN, _PERIOD_GAIN = 0.05, 0.05**2 / 4.0
#: Stamps further from their line than so many robust standard deviations, or half a period, are late: it ignores them.
_LATE_SIGMAS = 6.0
#: A row may have this share of late stamps, and the others an rms of so much of a period (evenly spread: 0.29).
LATE_SHARE, _SPREAD = 0.05, 0.25
#: Stamps that are in time are off by at most so much of a period where the nearest sample is theirs.
_NEAREST = 0.5
#: Counted by their order, a row has to show a reading that was lost: the difference of its halves' means is known to a sixth of
#: a period, by so many readings per squared spread.
_SHOWS_A_LOSS = 144.0
#: Periods that differ by less lead to the same count: the loop that counts follows the period.
_SAME_PERIOD = 1e-3
#: Means of blocks longer than this against those of blocks as long tell wandering from jitter that lasts: so far the
#: readings themselves can tell the one from the other (`sampling.py`), and no further.
_QUICK_S, _LEAST_QUICK = 0.1, 5
#: How much more than chance long blocks may keep, compared with quick ones.
_GROWTH = 2.0
#: Of a shorter part nobody can say that it does not wander.
_SHORTEST_S = 7.5
#: Errors of less than this share of the period are no jitter, and change nothing whichever way they are taken.
_STILL = 1e-3
#: Blocks that a verdict about their spread needs, and a measure of it.
_FEWEST_BLOCKS, _MEASURED_BLOCKS = 8, 24


@dataclass(frozen=True, slots=True)
class Row:
    """Readings of one even clock.

    index: (N,) which of the recording's readings.   number: (N,) which sample each is, increasing.   even_s: (N,) the
    samples' times on the line.   used: (N,) whether the line was fitted to it.   cells: of the line, 1 where it is straight.
    reach: how many periods a stamp that is in time may be off, infinite where readings are counted by their order.
    """

    index: IntArray
    number: IntArray
    even_s: FloatArray
    used: BoolArray
    cells: int
    reach: float

    @property
    def period_s(self) -> float:
        """Mean distance of samples."""
        return float((self.even_s[-1] - self.even_s[0]) / (self.number[-1] - self.number[0]))

    def variance_of_mean(self, weight: FloatArray) -> float:
        """Variance of the line's error in the mean with `weight` (N,), for stamps with independent errors of variance 1."""
        cell, right = places(self.number, self.cells)
        normal = normal_equations(cell, right, self.used, self.cells)
        goal = onto_nodes(cell, right, weight, self.cells)
        return float(goal @ scipy.linalg.solveh_banded(normal, goal))


def even_rows(t: FloatArray, *, by_order: bool, least: int = LEAST) -> list[Row]:
    """The rows behind stamps t (Q,) [s], strictly increasing; readings that follow none are in no row.

    by_order: whether readings without a nearest sample are counted by their order, for those that can be asked after it.
    least: readings of a row.
    """
    period = float(np.median(np.diff(t)))
    rows: list[Row] = []
    for stretch in _stretches(t, _GAP_PERIODS * period, least):
        numbered = _numbered(t[stretch], period, least)
        if numbered is not None:
            rows.append(_fitted(np.arange(stretch.start, stretch.stop), *numbered, t, reach=_NEAREST, least=least))
    if by_order and not rows:
        rows = _in_their_order(t, period, least)
    if len(rows) > 1:
        # The sensor's clock goes on through a gap, unless it was started anew.
        whole = _joined(rows, t, least)
        apart = np.concatenate([(t[row.index] - row.even_s)[row.used] for row in rows])
        together = (t[whole.index] - whole.even_s)[np.concatenate([row.used for row in rows])]
        if fits_as_well(together, apart, freedoms=2 * (len(rows) - 1)):
            rows = [whole]
    if len(rows) == 1:
        rows = [_completed(rows[0], t, least)]
    return _in_order([part for row in rows for part in _steady(row, t, least)], t)


def lasting(rows: Sequence[Row], t: FloatArray) -> float:
    """How many times less sure a mean of the stamps' errors is than if they were independent, 1 at least."""
    errors = [np.where(row.used, t[row.index] - row.even_s, 0.0) for row in rows]
    size = max((len(e) for e in errors), default=0)
    variance = float(np.mean(np.concatenate(errors) ** 2)) if errors else 0.0
    worst, length = 1.0, 2
    while variance > 0.0 and length * _MEASURED_BLOCKS <= size:
        means = np.concatenate([_block_means(e, length) for e in errors])
        worst = max(worst, float(np.mean(means**2)) * length / variance)
        length *= 2
    return math.sqrt(worst)


def _stretches(t: FloatArray, gap: float, least: int) -> Iterator[slice]:
    """Between gaps of more than so many seconds, where they are long enough."""
    ends = np.concatenate([np.flatnonzero(np.diff(t) > gap) + 1, [len(t)]])
    start = 0
    for end in ends.tolist():
        if end - start >= least:
            yield slice(start, end)
        start = end


def _numbered(t: FloatArray, period: float, least: int) -> tuple[IntArray, BoolArray] | None:
    """Which sample of an even row each reading is, and whether it is stamped near it, (N,) each; None where they are in none.

    The median step is far from the period where stamps are coarse, the mean step where readings were lost: the one whose
    row fits better is right.
    """
    best, smallest = None, _SPREAD
    mean = float(t[-1] - t[0]) / (len(t) - 1)
    for guess in (period, mean) if abs(mean - period) > _SAME_PERIOD * period else (period,):
        number = _tracked(t, guess)
        used = np.ones(len(t), dtype=np.bool_)
        for _ in range(3):
            if np.count_nonzero(used) < least // 2:
                break
            # Where the loop slipped by a sample, the line of all the others puts it right. A reading stamped so late that
            # it takes its successor's number was the sample before; and those that a host that had stood still stamps in a
            # burst are then far from the line, and are left out of it.
            line, _cells = line_of(number, t, used)
            step = (line[-1] - line[0]) / max(int(number[-1] - number[0]), 1)
            slipped = np.rint((t - line) / step).astype(np.int64)
            if not slipped.any():
                break
            before, number = number, _each_its_own(number + slipped)
            used = np.abs(t - line - step * (number - before)) <= _NEAREST * step
        number = _each_its_own(number)
        if np.count_nonzero(used) < least // 2:
            continue
        row = _fitted(np.arange(len(t)), number, used, t, reach=_NEAREST, least=least)
        off = (t - row.even_s) / row.period_s
        near = np.abs(off) < _NEAREST
        spread = float(np.sqrt(np.mean(off[near] ** 2))) if near.any() else np.inf
        if np.mean(~near) < LATE_SHARE and spread < smallest:
            best, smallest = (number, used), spread
    return best


def _in_their_order(t: FloatArray, period: float, least: int) -> list[Row]:
    """Rows of stamps that jitter by more than half a period, where none was lost: a step in them shows against their spread."""
    steps = np.diff(t)
    # Far steps are jitter here, not losses, as long as they are of its size.
    usual = 1.4826 * float(np.median(np.abs(steps - period)))
    rows = []
    for stretch in _stretches(t, _GAP_PERIODS * period + _LATE_SIGMAS * usual, least):
        index = np.arange(stretch.start, stretch.stop)
        row = _fitted(index, index - stretch.start, np.ones(len(index), dtype=np.bool_), t, reach=math.inf, least=least)
        off = (t[row.index] - row.even_s)[row.used] / row.period_s
        if _SHOWS_A_LOSS * float(np.mean(off**2)) < len(index) and np.mean(~row.used) < LATE_SHARE:
            rows.append(row)
    return rows


def _each_its_own(number: IntArray) -> IntArray:
    """Strictly increasing numbers: the largest such that none exceeds what was counted."""
    place = np.arange(len(number))
    return np.asarray(np.minimum.accumulate((number - place)[::-1])[::-1] + place)


def _tracked(t: FloatArray, period: float) -> IntArray:
    """(N,) samples counted by a loop that follows their phase and period: a single step is too uncertain to count by.

    It locks on the way to the end and counts on the way back.
    """
    number = np.zeros(len(t), dtype=np.int64)
    _track(t, period, number)
    return np.asarray(number - number[0])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _track(t: FloatArray, period: float, number: IntArray) -> None:
    expected, step, count = t[0], period, 0
    for leg in range(2):
        count = 0
        for k in range(1, len(t)):
            now = t[k] if leg == 0 else t[len(t) - 1 - k]
            passed = math.floor((now - expected) / step + 0.5)
            late = now - (expected + passed * step)
            count += passed
            expected = now + (_PHASE_GAIN - 1.0) * late
            step += _PERIOD_GAIN * late / (passed if passed != 0 else 1)
            if leg == 1:
                number[len(t) - 1 - k] = count


def _fitted(index: IntArray, number: IntArray, used: BoolArray, t: FloatArray, *, reach: float, least: int) -> Row:
    """The row with its line, late stamps left out. used: (N,) those to begin with.   t: (Q,) of the whole recording."""
    here = t[index]
    even, cells = line_of(number, here, used)
    for _ in range(2):
        off = here - even
        centre = float(np.median(off[used]))
        period = (even[-1] - even[0]) / max(int(number[-1] - number[0]), 1)
        robust = 1.4826 * float(np.median(np.abs(off[used] - centre)))
        near = np.abs(off - centre) <= min(reach * period, max(_LATE_SIGMAS * robust, 1e-3 * period))
        if np.count_nonzero(near) < least // 2:
            break
        used = near
        even, cells = line_of(number, here, used)
    return Row(index, number, even, used, cells, reach)


def _joined(rows: Sequence[Row], t: FloatArray, least: int) -> Row:
    """One row through all: each goes on counting where the line of the one before it would be."""
    numbers = [rows[0].number]
    for before, after in pairwise(rows):
        passed = round((after.even_s[0] - before.even_s[-1]) / before.period_s)
        numbers.append(after.number - after.number[0] + numbers[-1][-1] + max(passed, 1))
    index, used = np.concatenate([row.index for row in rows]), np.concatenate([row.used for row in rows])
    return _fitted(index, np.concatenate(numbers), used, t, reach=max(row.reach for row in rows), least=least)


def _completed(row: Row, t: FloatArray, least: int) -> Row:
    """With the readings that were too few between gaps to be counted by themselves: the only line is theirs too.

    A host that stalls often leaves many; taken as stamped, they would be late. After a stall a burst shares one instant:
    its last reading has the number of that instant, those before it the numbers before.
    """
    new = np.setdiff1d(np.arange(len(t)), row.index)
    if not len(new):
        return row
    number, used = np.zeros(len(t), np.int64), np.zeros(len(t), np.bool_)
    number[row.index], used[row.index] = row.number, row.used
    # Where the row bends, from place to place; beyond its ends at its mean pace.
    off = np.interp(t[new], row.even_s, row.number - row.even_s / row.period_s)
    number[new] = np.rint(t[new] / row.period_s + off).astype(np.int64)
    number = _each_its_own(number)
    if np.any(number[row.index] != row.number):
        return row
    line = (number[new] - off) * row.period_s
    used[new] = np.abs(t[new] - line) <= row.reach * row.period_s
    return _fitted(np.arange(len(t)), number, used, t, reach=row.reach, least=least)


def _steady(row: Row, t: FloatArray, least: int) -> Iterator[Row]:
    """The parts of a row whose stamps jitter about their line and do not wander about it."""
    if not _wanders(row, t):
        yield row
        return
    half = len(row.index) // 2
    if half < least or half * row.period_s < _SHORTEST_S:
        return
    near = np.abs(t[row.index] - row.even_s) <= row.reach * row.period_s
    for part in (slice(0, half), slice(half, None)):
        if np.count_nonzero(near[part]) >= least:
            one = _fitted(row.index[part], row.number[part], near[part], t, reach=row.reach, least=least)
            yield from _steady(one, t, least)


def _wanders(row: Row, t: FloatArray) -> bool:
    """Whether means over long blocks are further from the line than those over quick ones let one expect.

    Errors that share something for a while raise both alike; a step, a drift or an uneven pace raises the long ones.
    """
    here = t[row.index]
    # Stamps that are late for seconds are a clock that was set; a host that stood still stamps all it missed in no time.
    time = np.minimum(np.gradient(here) / row.period_s, 1.0)
    off = np.clip(here - row.even_s, -row.reach * row.period_s, row.reach * row.period_s)
    # Where most are in time and some are late, the line is that of the former: their mean lateness is none that wanders.
    error = time * (off - np.mean(time * off) / np.mean(time))
    variance = float(np.mean(error**2))
    if variance <= (_STILL * row.period_s) ** 2:
        return False
    excess = []
    length = max(round(_QUICK_S / row.period_s), _LEAST_QUICK)
    while length * _FEWEST_BLOCKS <= len(error):
        excess.append(float(np.sqrt(np.mean(_block_means(error, length) ** 2) * length / variance)))
        length *= 2
    return len(excess) > 1 and max(excess) > _GROWTH * max(excess[0], 1.0)


def _block_means(values: FloatArray, length: int) -> FloatArray:
    blocks = len(values) // length
    return np.asarray(values[: blocks * length].reshape(blocks, length).mean(axis=1))


def _in_order(rows: list[Row], t: FloatArray) -> list[Row]:
    """Without the rows whose samples would change places with readings beside them."""
    while True:
        even = t.copy()
        owner = np.full(len(t), -1)
        for k, row in enumerate(rows):
            even[row.index], owner[row.index] = row.even_s, k
        wrong = np.flatnonzero(np.diff(even) <= 0)
        out = set(owner[np.concatenate([wrong, wrong + 1])].tolist()) - {-1}
        if not out:
            return rows
        rows = [row for k, row in enumerate(rows) if k not in out]
