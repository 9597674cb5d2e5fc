r"""When the readings were taken: an IMU samples evenly even where its stamps do not say so.

A stamp that a host or a bus puts on a reading jitters; the sensor's own clock does not. If the readings with number i were
taken at a line s_i, their stamps t_i scatter about it by tau_i = t_i - s_i, and the readings know nothing of tau. If the
sensor was polled when the stamp says, they do: against what their neighbours let one expect at s_i, every reading is off by
its slope times tau. The regression of one on the other,

    e_i = y_i - sum_j c_j y_{i+j} = beta ydot_i (tau_i - sum_j c_j tau_{i+j}) + noise,   c = (-1, 4, 4, -1) / 6,

over all channels says which: beta is 0 where only the stamps jitter, 1 where the sampling does. c is exact for cubics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded

from calib_core.types import BoolArray, FloatArray, IntArray

#: A pause of more than this many periods ends a row of readings: how many were lost in it is not sure.
_GAP_PERIODS = 3.5
#: A row has at least so many readings.
_LEAST = 100
#: Of a critically damped loop that follows the samples.
_PHASE_GAIN, _PERIOD_GAIN = 0.05, 0.05**2 / 4.0
#: Clocks drift: a row's line may bend at nodes this far apart where a straight one does not do.
_NODE_S = 10.0
#: A bend, or a clock started anew, has to be surer than this many standard deviations of its chi-square.
_SURE = 5.0
#: Readings on either side that a slope is taken from, and neighbours on either side that a reading is expected from.
_SLOPE_SPAN, _SPAN = 5, 2
_EXPECTED = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
#: Readings to a block whose means are compared.
_BLOCK = 50
#: Standard deviations by which beta has to be on its side of a half.
_DECISIVE = 3.0


@dataclass(frozen=True, slots=True)
class Sampling:
    """What is known of when readings were taken.

    even_ns: (Q,) stamps on the lines; as given where a reading is in no row.   period_s: of the lines, median.
    jitter_s: root mean square of the given stamps about them.   in_sampling, in_sampling_std: beta, the share of the jitter
    that the readings know of, and its standard deviation (infinite where the motion does not tell).
    mean_std_s: how well the mean of the jitter, which no line takes away, is known to be the one over all time.
    """

    even_ns: IntArray
    period_s: float
    jitter_s: float
    in_sampling: float
    in_sampling_std: float
    mean_std_s: float

    @property
    def is_even(self) -> bool:
        """Whether the readings say that less than half of the jitter is in when they were taken."""
        return self.in_sampling + _DECISIVE * self.in_sampling_std < 0.5

    @property
    def is_as_stamped(self) -> bool:
        """Whether they say that more than half of it is."""
        return self.in_sampling - _DECISIVE * self.in_sampling_std > 0.5


def study_sampling(stamps_ns: IntArray, values: FloatArray) -> Sampling | None:
    """Lines through the stamps, and what the readings say of them; None where the stamps are in no even row.

    stamps_ns: (Q,) strictly increasing.   values: (Q, C), any units.
    """
    n = stamps_ns.shape[0]
    if n < _LEAST:
        return None
    t = np.asarray((stamps_ns - stamps_ns[0]) * 1e-9, dtype=np.float64)
    period = float(np.median(np.diff(t)))
    rows = list(_rows(t, period))
    number, even, in_row = _counted(t, period, rows)
    if np.count_nonzero(in_row) < max(_LEAST, n // 2):
        return None
    if len(rows) > 1 and in_row.all():
        # The sensor's clock goes on through a gap, unless it was started anew.
        whole = _counted(t, period, [slice(0, n)])
        if whole[2].all() and _fits_as_well(t - whole[1], t - even, freedoms=2 * (len(rows) - 1)):
            number, even, in_row = whole
    tau = t - even
    jitter = float(np.sqrt(np.mean(tau[in_row] ** 2)))
    share, std = _share_in_sampling(number, in_row, tau, values, period)
    return Sampling(
        even_ns=stamps_ns - np.rint(tau * 1e9).astype(np.int64),
        period_s=float(np.median(np.diff(even)[in_row[1:]] / np.maximum(np.diff(number)[in_row[1:]], 1))),
        jitter_s=jitter,
        in_sampling=share,
        in_sampling_std=std,
        mean_std_s=_std_of_mean(tau[in_row]),
    )


def _counted(t: FloatArray, period: float, rows: Sequence[slice]) -> tuple[IntArray, FloatArray, BoolArray]:
    """Numbers of the samples, their times on the lines of their rows, and whether they are in one; (Q,) each."""
    number, even, in_row = np.zeros(len(t), dtype=np.int64), t.copy(), np.zeros(len(t), dtype=np.bool_)
    for row in rows:
        counted = _numbered(t[row], period)
        if counted is not None:
            number[row], even[row], in_row[row] = counted, _line(counted, t[row]), True
    return number, even, in_row


def _fits_as_well(stiff: FloatArray, loose: FloatArray, *, freedoms: int) -> bool:
    """Whether residuals with fewer free numbers are no larger than chance allows."""
    noise = float(np.mean(loose**2))
    gained = float(stiff @ stiff - loose @ loose)
    # Of pure noise the gain is chi-square with as many degrees of freedom as numbers were set free.
    return gained <= noise * (freedoms + _SURE * np.sqrt(2.0 * freedoms))


def _rows(t: FloatArray, period: float) -> Iterator[slice]:
    """Stretches between gaps that are long enough."""
    ends = np.concatenate([np.flatnonzero(np.diff(t) > _GAP_PERIODS * period) + 1, [len(t)]])
    start = 0
    for end in ends.tolist():
        if end - start >= _LEAST:
            yield slice(start, end)
        start = end


def _numbered(t: FloatArray, period: float) -> IntArray | None:
    """(Q,) which sample of an even row each reading is; None where two would be the same one."""
    number = _tracked(t, period)
    # Where the loop slipped by a sample, the line of all the others puts it right.
    for _ in range(3):
        line = _line(number, t)
        step = (line[-1] - line[0]) / max(int(number[-1] - number[0]), 1)
        number = number + np.rint((t - line) / step).astype(np.int64)
    return number if (np.diff(number) > 0).all() else None


def _tracked(t: FloatArray, period: float) -> IntArray:
    """(Q,) samples counted by a loop that follows their phase and period: a single step is too uncertain to count by.

    It locks on the way to the end and counts on the way back.
    """
    expected, step = float(t[0]), period
    count, numbers = 0, [0]
    for row in (t[1:], t[-2::-1]):
        count, numbers = 0, [0]
        for now in row.tolist():
            passed = round((now - expected) / step)
            late = now - (expected + passed * step)
            count += passed
            expected = now + (_PHASE_GAIN - 1.0) * late
            step += _PERIOD_GAIN * late / (passed or 1)
            numbers.append(count)
    number = np.array(numbers[::-1], dtype=np.int64)
    return np.asarray(number - number[0])


def _line(number: IntArray, t: FloatArray) -> FloatArray:
    """Times of the samples: a straight line, or one that bends every few seconds where that fits significantly better."""
    x = number - number.mean()
    slope = float(x @ t / (x @ x))
    straight = np.asarray(t.mean() + slope * x, dtype=np.float64)
    left = t - straight
    nodes = int(slope * (number[-1] - number[0]) / _NODE_S)
    if nodes < 1:
        return straight
    bend = _bent(number, left, nodes)
    return straight if _fits_as_well(left, left - bend, freedoms=nodes) else straight + bend


def _bent(number: IntArray, left: FloatArray, nodes: int) -> FloatArray:
    """Least-squares fit of a function that is linear between `nodes` + 1 even nodes."""
    place = (number - number[0]) / (number[-1] - number[0]) * nodes
    cell = np.minimum(place.astype(np.int64), nodes - 1)
    right = place - cell
    count = nodes + 1
    banded = np.zeros((2, count))
    banded[1] = np.bincount(cell, (1 - right) ** 2, count) + np.bincount(cell + 1, right**2, count)
    banded[0, 1:] = np.bincount(cell, right * (1 - right), count)[:-1]
    # A node over nothing but lost readings stays where it is.
    banded[1] += 1e-9 * banded[1].max()
    goal = np.bincount(cell, (1 - right) * left, count) + np.bincount(cell + 1, right * left, count)
    node = solveh_banded(banded, goal)
    return np.asarray((1 - right) * node[cell] + right * node[cell + 1], dtype=np.float64)


def _std_of_mean(tau: FloatArray) -> float:
    """Standard deviation of the mean. A busy host is late for a while: means of blocks know of what single stamps share."""
    single = float(np.sqrt(np.mean(tau**2) / len(tau)))
    blocks = len(tau) // _BLOCK
    if blocks < 2:
        return single
    means = tau[: blocks * _BLOCK].reshape(blocks, _BLOCK).mean(axis=1)
    return max(single, float(np.sqrt(np.mean(means**2) / blocks)))


def _share_in_sampling(
    number: IntArray, in_row: BoolArray, tau: FloatArray, values: FloatArray, period: float
) -> tuple[float, float]:
    """Share and standard deviation; (0.5, infinite) where nothing is to be told."""
    width = 2 * _SLOPE_SPAN + 1
    if len(number) <= width:
        return 0.5, np.inf
    whole = (number[width - 1 :] - number[: -width + 1] == width - 1) & in_row[width - 1 :] & in_row[: -width + 1]
    centre = np.flatnonzero(whole) + _SLOPE_SPAN
    if len(centre) < _LEAST:
        return 0.5, np.inf
    steps = np.arange(-_SLOPE_SPAN, _SLOPE_SPAN + 1)
    slope = np.zeros((len(centre), values.shape[1]))
    for step in steps.tolist():
        slope += step * values[centre + step]
    slope /= period * float(steps @ steps)
    error, moved = values[centre].astype(np.float64), tau[centre].copy()
    for step, weight in zip(range(-_SPAN, _SPAN + 1), _EXPECTED.tolist(), strict=True):
        error -= weight * values[centre + step]
        moved -= weight * tau[centre + step]
    x = slope * moved[:, None]
    spread = np.mean(error**2, axis=0)
    known = spread > 0
    x, error = x[:, known] / np.sqrt(spread[known]), error[:, known] / np.sqrt(spread[known])
    size = float(np.sum(x**2))
    if size <= 0.0:
        return 0.5, np.inf
    share = float(np.sum(x * error)) / size
    # Neighbours' errors share readings: the spread is taken from the products themselves, with what they have in common.
    product = np.sum(x * (error - share * x), axis=1)
    variance = float(product @ product)
    for lag in range(1, 2 * _SPAN + 1):
        variance += 2.0 * float(product[lag:] @ product[:-lag])
    return share, float(np.sqrt(max(variance, float(product @ product) / 4.0))) / size
