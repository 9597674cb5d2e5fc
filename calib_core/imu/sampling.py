r"""When the readings were taken: an IMU samples evenly even where its stamps do not say so.

A stamp that a host or a bus puts on a reading jitters; the sensor's own clock does not. If the readings with number i were
taken at a line s_i, their stamps t_i scatter about it by tau_i = t_i - s_i, and the readings know nothing of tau. If the
sensor was polled when the stamp says, they do: against what their neighbours let one expect at s_i, every reading is off by
its slope times tau. The regression of one on the other,

    e_i = y_i - sum_j c_j y_{i+j} = beta ydot_i (tau_i - sum_j c_j tau_{i+j}) + noise,   c = (-1, 4, 4, -1) / 6,

over all channels says which: beta is 0 where only the stamps jitter, 1 where the sampling does. c is exact for cubics. It is
asked of neighbours at 1, 2, 4 ... samples' distance, since the fast part of tau may be the stamps' and the slow part the
sampling's. What is slower still it cannot tell, and lines (`sample_rows.py`) do not take that away. Where the sensor is shaken
faster than cubics follow, that decides nothing, and what shakes it is asked (`sampling_jitter.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.imu.reading_prediction import SPAN
from calib_core.imu.sample_rows import LATE_SHARE, LEAST, Row, even_rows, lasting
from calib_core.imu.sampling_jitter import shaken_share
from calib_core.types import BoolArray, FloatArray, IntArray

#: Readings on either side that a slope is taken from, and neighbours on either side that a reading is expected from.
_SLOPE_SPAN, _SPAN = 5, 2
_EXPECTED = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
#: Readings whose neighbours are no further apart than this many times what they should be have lost none.
_NO_GAP = 1.5
#: The furthest neighbour that a reading is expected from.
_REACH_S = 0.1
#: A distance of neighbours at which beta is so many times less sure than at the best one does not count.
_LESS_SURE = 3.0
#: Readings are asked in runs of so many, and no more of them than this: an hour would tell nothing that minutes do not.
_RUN, _ENOUGH = 1000, 200_000
#: Standard deviations by which beta has to be on its side of a half.
_DECISIVE = 3.0
#: And by which it is likely to be, unless it is surely neither 0 nor 1: of sensors that are polled at their stamps, next to none
#: look as if they were not. Where beta is below a half even stamps leave less of the jitter than those that were given.
_LIKELY = 2.0
#: Beta is 0 to 1; beyond either end by more than this, and surely, neither holds.
_BEYOND = 0.25
#: Beta is between 0 and 1 where it is further from both, and surely.
_PARTLY = 0.1
#: A reading that is stamped so much of a period behind a late one waited with it.
_IN_A_BURST = 0.25
#: The tail of an exponential law beyond so many robust standard deviations holds a thousandth of its mean; further off is a
#: host's stall.
_TAIL_SIGMAS = 12.0
#: Beyond the median a normal law reaches as far as before it, half of one 2.9 and an exponential law 5.7 times as far, at 1 and
#: 99 %.
_ONE_SIDED = 2.0
#: Parts of the readings' own size below which a channel does not change but by rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Sampling:
    """What is known of when readings were taken.

    even_ns: (Q,) stamps on the lines; as given where a reading is in no row.   in_rows: share of the readings that are.
    period_s: of the lines, median.   jitter_s: root mean square of the given stamps about them, late ones left out.
    in_sampling, in_sampling_std: beta, the share of the jitter that the readings know of, and its standard deviation
    (infinite where they do not tell).   compared: readings that were held against their neighbours.   mean_std_s: how well
    the mean of the jitter, which no line takes away, is known to be the one over all time; where the readings change, since
    there the time offset is learnt. What the tail of a one-sided law changes in it is part of that, as likely to be any
    share of it: where the law ends and a host's stall begins, nobody can say.   every_std_s: how well the mean over all stamps is
    known, were there nothing but noise in it.   late_s: by how much the mean stamp comes after
    the most punctual ones, where most of the jitter is to that side; 0 where it is to both.   is_by_shaking: whether beta is told
    by what shakes the sensor, which makes less of a beta that is not 0 where it is faster than half the sampling rate.
    """

    even_ns: IntArray
    in_rows: float
    period_s: float
    jitter_s: float
    in_sampling: float
    in_sampling_std: float
    compared: int
    mean_std_s: float
    every_std_s: float
    late_s: float = 0.0
    is_by_shaking: bool = False

    @property
    def fits_neither(self) -> bool:
        """Whether beta is surely neither 0, nor 1, nor between."""
        sure = _DECISIVE * self.in_sampling_std
        return self.in_sampling + sure < -_BEYOND or self.in_sampling - sure > 1.0 + _BEYOND

    @property
    def is_even(self) -> bool:
        """Whether, by the readings, less than half of the jitter is likely to be in when they were taken."""
        likely = self.in_sampling + _LIKELY * self.in_sampling_std < 0.5 and not (self.fits_neither or self.is_mixed)
        return likely or self.is_surely_even

    @property
    def is_surely_even(self) -> bool:
        """Whether they leave no doubt of that."""
        less_than_seems = self.is_by_shaking and self.is_mixed
        sure = self.in_sampling + _DECISIVE * self.in_sampling_std < 0.5
        return sure and not (self.fits_neither or less_than_seems)

    @property
    def is_as_stamped(self) -> bool:
        """Whether they say that more than half of it is."""
        return self.in_sampling - _DECISIVE * self.in_sampling_std > 0.5 and not self.fits_neither

    @property
    def is_mixed(self) -> bool:
        """Whether beta is surely between 0 and 1."""
        sure = _DECISIVE * self.in_sampling_std
        return self.in_sampling - sure > _PARTLY and self.in_sampling + sure < 1.0 - _PARTLY


def study_sampling(stamps_ns: IntArray, values: FloatArray) -> Sampling | None:
    """Lines through the stamps, and what the readings say of them; None where too few stamps are in an even row.

    stamps_ns: (Q,) strictly increasing.   values: (Q, C), any units.
    """
    n = stamps_ns.shape[0]
    if n < LEAST:
        return None
    t = np.asarray((stamps_ns - stamps_ns[0]) * 1e-9, dtype=np.float64)
    rows = even_rows(t, by_order=True)
    number, even, used = np.zeros(n, dtype=np.int64), t.copy(), np.zeros(n, dtype=np.bool_)
    in_row = used.copy()
    for row in rows:
        number[row.index], even[row.index], used[row.index], in_row[row.index] = row.number, row.even_s, row.used, True
    if np.count_nonzero(in_row) < max(LEAST, n // 2):
        return None
    period = float(np.median([row.period_s for row in rows for _ in range(len(row.index) // LEAST)]))
    tau = t - even
    jitter = float(np.sqrt(np.mean(tau[used] ** 2)))
    values = values[:, np.ptp(values, axis=0) > _ROUNDING * np.abs(values).max(axis=0)].astype(np.float64)
    share, std = _least_even(number, in_row, tau, values, period)
    by_shaking = 0.5, np.inf
    if abs(share - 0.5) < _DECISIVE * std:
        by_shaking = shaken_share(_spread_runs(_unbroken(number, in_row, 3 * SPAN)), tau / period, values)
    is_by_shaking = by_shaking[1] < std
    if is_by_shaking:
        share, std = by_shaking
    mean_of_all = usual_mean(t, tau, in_row, period)
    apart_s = t[2 * _SLOPE_SPAN :] - t[: -2 * _SLOPE_SPAN]
    whole = np.flatnonzero(apart_s < _NO_GAP * 2 * _SLOPE_SPAN * period) + _SLOPE_SPAN
    return Sampling(
        even_ns=stamps_ns - np.where(in_row, np.rint((tau - mean_of_all) * 1e9), 0.0).astype(np.int64),
        in_rows=float(np.mean(in_row)),
        period_s=period,
        jitter_s=jitter,
        in_sampling=share,
        in_sampling_std=std,
        compared=len(_unbroken(number, in_row, _SLOPE_SPAN)),
        mean_std_s=float(
            np.hypot(
                jitter * lasting(rows, t) * _std_where_it_moves(rows, whole, values, n), mean_of_all / np.sqrt(3.0)
            )
        ),
        every_std_s=jitter * lasting(rows, t) / float(np.sqrt(np.count_nonzero(used))),
        late_s=mean_lateness(tau[used], mean_of_all),
        is_by_shaking=is_by_shaking,
    )


def mean_lateness(tau: FloatArray, mean: float) -> float:
    """By how much the mean stamp is later than one in a hundred, where that side of the law is the short one."""
    earliest, middle, latest = np.percentile(tau, [1.0, 50.0, 99.0])
    return float(mean - earliest) if latest - middle > _ONE_SIDED * (middle - earliest) else 0.0


def usual_mean(t: FloatArray, tau: FloatArray, in_row: BoolArray, period: float) -> float:
    """Mean lateness where the host did not stall: lines ignore the tail of a one-sided law, which is part of its mean.

    A reading near its line counts, unless it was stamped right behind a late one: it waited with it.
    """
    centre = float(np.median(tau[in_row]))
    robust = 1.4826 * float(np.median(np.abs(tau[in_row] - centre)))
    off, most = tau - centre, min(period, _TAIL_SIGMAS * robust)
    if np.mean(off[in_row] > most) > LATE_SHARE:
        # Not a host's stalls: so many are the law, of which a robust spread sees the punctual part only.
        most = period
    late = np.flatnonzero(in_row & (off > most))
    begins = np.concatenate([[True], np.diff(t) > _IN_A_BURST * period])
    burst = np.cumsum(begins) - 1
    first_late = np.full(burst[-1] + 1, len(t))
    np.minimum.at(first_late, burst[late], late)
    waited = np.arange(len(t)) > first_late[burst]
    usual = in_row & (np.abs(off) <= most) & ~waited
    return float(np.mean(tau[usual])) if usual.any() else 0.0


def _unbroken(number: IntArray, in_row: BoolArray, span: int) -> IntArray:
    """The readings with no neighbour missing up to `span` samples away on either side."""
    width = 2 * span + 1
    if len(number) < width:
        return np.zeros(0, dtype=np.int64)
    last = width - 1
    whole = (number[last:] - number[: len(number) - last] == last) & in_row[last:] & in_row[: len(number) - last]
    return np.asarray(np.flatnonzero(whole) + span)


def _spread_runs(centre: IntArray) -> IntArray:
    """At most so many, in runs spread over all."""
    runs = len(centre) // _RUN
    if len(centre) <= _ENOUGH:
        return centre
    taken = np.linspace(0, runs - 1, _ENOUGH // _RUN).astype(np.int64)
    return np.asarray(centre[: runs * _RUN].reshape(runs, _RUN)[taken].ravel())


def _slopes(centre: IntArray, values: FloatArray) -> FloatArray:
    """(N, C) per sample, of a line through the readings beside each."""
    steps = np.arange(-_SLOPE_SPAN, _SLOPE_SPAN + 1)
    slope = np.zeros((len(centre), values.shape[1]))
    for step in steps.tolist():
        slope += step * values[centre + step]
    return slope / float(steps @ steps)


def _against_neighbours(centre: IntArray, values: FloatArray, apart: int) -> FloatArray:
    """(N, ...): what neighbours `apart` samples from one another do not let one expect."""
    left = values[centre]
    for step, weight in zip(range(-_SPAN, _SPAN + 1), _EXPECTED.tolist(), strict=True):
        left = left - weight * values[centre + step * apart]
    return left


def _least_even(
    number: IntArray, in_row: BoolArray, tau: FloatArray, values: FloatArray, period: float
) -> tuple[float, float]:
    """Beta and its standard deviation at the distance of neighbours at which it is most surely above a half."""
    found = []
    apart = 1
    while apart == 1 or _SPAN * apart * period <= _REACH_S:
        found.append(_share_in_sampling(number, in_row, tau, values, period, apart))
        apart *= 2
    surest = min(std for _, std in found)
    if not np.isfinite(surest):
        return 0.5, np.inf
    return max((f for f in found if f[1] <= _LESS_SURE * surest), key=lambda f: (f[0] - 0.5) / f[1])


def _share_in_sampling(
    number: IntArray, in_row: BoolArray, tau: FloatArray, values: FloatArray, period: float, apart: int
) -> tuple[float, float]:
    """Beta and its standard deviation; (0.5, infinite) where nothing is to be told."""
    centre = _spread_runs(_unbroken(number, in_row, max(_SLOPE_SPAN, _SPAN * apart)))
    if len(centre) < LEAST:
        return 0.5, np.inf
    error = _against_neighbours(centre, values, apart)
    spread = np.sqrt(np.mean(error**2, axis=0))
    known = spread > 0
    error = error[:, known] / spread[known]
    moved = _against_neighbours(centre, tau, apart)
    x = _slopes(centre, values[:, known]) / spread[known] * (moved[:, None] / period)
    size = float(np.sum(x**2))
    if size <= 0.0:
        return 0.5, np.inf
    share = float(np.sum(x * error)) / size
    # Neighbours' errors share readings: the spread is taken from the products themselves, with what they have in common.
    product = np.sum(x * (error - share * x), axis=1)
    variance = float(product @ product)
    for lag in range(apart, (2 * _SPAN + 1) * apart, apart):
        variance += 2.0 * float(product[lag:] @ product[:-lag])
    return share, float(np.sqrt(max(variance, float(product @ product) / 4.0))) / size


def _std_where_it_moves(rows: list[Row], centre: IntArray, values: FloatArray, count: int) -> float:
    """Standard deviation of the mean error for stamps with independent errors of 1, weighted by squared slopes.

    That of the lines where there are any, of the stamps themselves where there are none.
    """
    weight = np.zeros(count)
    centre = _spread_runs(centre)
    if len(centre):
        noise = np.mean(_against_neighbours(centre, values, 1) ** 2, axis=0)
        weight[centre] = np.sum(_slopes(centre, values) ** 2 / np.maximum(noise, np.finfo(np.float64).tiny), axis=1)
    if weight.sum() <= 0.0:
        weight = np.ones(count)
    weight /= weight.sum()
    total = sum(row.variance_of_mean(weight[row.index]) for row in rows)
    for row in rows:
        weight[row.index] = 0.0
    return float(np.sqrt(total + weight @ weight))
