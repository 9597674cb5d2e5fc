"""Where a sweep begins and ends by its point times: the window outside of which times are garbage, and what must be
added to all of them so that the header is what the user says it is, or the epochs meet.

The detection knows quantiles of the points that returned. A sweep may begin or end where little returns (its operator
stands there, or the sky): the window therefore reaches at least one scan period from either end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.threads import workers
from calib_core.types import Clue, Finding, FloatArray, IntArray

#: Headers and point times further apart than this count from different instants.
_SAME_EPOCH_S = 10.0
_MARGIN = 0.06
#: Values that begin (or end) this near the header, in scan periods, already count from it as asked.
_AT_HEADER = 0.05
#: Sweeps that are seen to last this share of the period follow one another without a pause.
_CONTIGUOUS = 0.8
#: From one point to the next is the same in all scans, and where they do not come in order, sorting takes the longest of all.
_STEP_SCANS = 8
NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class SweepEdges:
    """First and last time of each sampled scan, of the points inside the window, by their own values.

    window_ns: allowed times after the header, or around the scan's own middle where `absolute`.
    first_ns, last_ns: (K,) integer nanoseconds from where the values count.   header_ns: (K,) of the same scans.
    step_ns: from one point to the next.
    """

    absolute: bool
    period_s: float
    window_ns: tuple[float, float]
    header_ns: IntArray
    first_ns: IntArray
    last_ns: IntArray
    step_ns: int = 0

    def after_header_ns(self) -> tuple[int, int]:
        """When a sweep begins and ends after its header.

        Headers may jitter against absolute times: the median. Relative times jitter with them, and a sweep whose edge
        did not return says nothing of the edge: the outer tenth.
        """
        if not self.first_ns.size:
            return 0, 0
        base: IntArray = self.header_ns if self.absolute else np.zeros_like(self.header_ns)
        rank = 0.5 if self.absolute else 0.1
        first, last = np.sort(self.first_ns - base), np.sort(self.last_ns - base)
        return int(first[round(rank * (first.size - 1))]), int(last[round((1.0 - rank) * (last.size - 1))])


def sweep_edges(
    clouds: Sequence[RawCloud],
    values: Sequence[IntArray | FloatArray],
    ns_per_unit: float,
    quantiles_ns: tuple[FloatArray, FloatArray],
    *,
    period_s: float,
    absolute: bool,
) -> SweepEdges:
    """The edges of the sampled scans. values: each scan's, of points with a return.   quantiles_ns: (K,) 1 and 99 %."""
    low, high = quantiles_ns
    window = _window_ns(low, high, period_s * NS_PER_S, absolute=absolute)
    known = np.flatnonzero(np.isfinite(low)).tolist()
    with_step = set(known[:: max(1, len(known) // _STEP_SCANS)])

    @np.errstate(
        invalid="ignore", over="ignore"
    )  # damaged floats are masked, not warned of; a thread has its own state
    def one(k: int) -> tuple[int, int, int, float] | None:
        own = values[k]
        middle = 0.5 * (low[k] + high[k]) if absolute else 0.0
        after = own * ns_per_unit - middle
        inside = own[(after >= window[0]) & (after <= window[1])]
        if not inside.size:
            return None
        first, last = _whole_ns(inside.min(), ns_per_unit), _whole_ns(inside.max(), ns_per_unit)
        return clouds[k].header_ns, first, last, _usual_step(inside) * ns_per_unit if k in with_step else math.nan

    found = [each for each in workers().map(one, known) if each is not None]
    steps = [step for *_, step in found if math.isfinite(step)]
    step_ns = round(float(np.median(steps))) if steps else 0
    headers, firsts, lasts = (np.array([each[column] for each in found], np.int64) for column in range(3))
    return SweepEdges(absolute, period_s, window, headers, firsts, lasts, step_ns)


def _usual_step(values: IntArray | FloatArray) -> float:
    """The median difference between neighbours of the distinct values (N,), 0 where there is but one."""
    step = np.diff(values)
    if step.size and step.min() < 0:  # points that are sent in the order of their times need no sorting
        step = np.diff(np.sort(values))
    step = step[step > 0]
    return float(np.median(step)) if step.size else 0.0


def _window_ns(low: FloatArray, high: FloatArray, period_ns: float, *, absolute: bool) -> tuple[float, float]:
    first, last = float(np.nanmedian(low)), float(np.nanmedian(high))
    span = float(np.nanmedian(high - low)) / 0.98
    margin = _MARGIN * period_ns
    if absolute:
        reach = max(1.1 * span, period_ns) + margin
        return -reach, reach
    edge = 0.012 * span
    return min(first - edge, last - period_ns) - margin, max(last + edge, first + period_ns) + margin


def _whole_ns(value: np.generic, ns_per_unit: float) -> int:
    """A value in integer nanoseconds; epochs may be 1e18 ns apart, where a float knows only a quarter of a microsecond."""
    number = value.item()
    whole = math.floor(number)
    scale = int(ns_per_unit)
    return whole * scale + round((number - whole) * scale)


def whole_sweep_ns(edges: SweepEdges) -> tuple[int, int]:
    """When a sweep begins and ends after its header, its ends seen or not.

    Times that count from a header at one end of the sweep have their zero there, whether or not something returned at
    that instant; and where sweeps follow one another without a pause, the other end is a period away.
    """
    begin_ns, end_ns = edges.after_header_ns()
    period_ns = round(edges.period_s * NS_PER_S)
    if edges.absolute or end_ns - begin_ns < _CONTIGUOUS * period_ns:
        return begin_ns, end_ns
    if 0 <= begin_ns < (1.0 - _CONTIGUOUS) * period_ns:
        return 0, max(end_ns, period_ns - edges.step_ns)
    if 0 <= -end_ns < (1.0 - _CONTIGUOUS) * period_ns:
        return min(begin_ns, edges.step_ns - period_ns), 0
    return begin_ns, end_ns


def reference_shift(edges: SweepEdges, asked: str | None, *, own_clock: bool) -> tuple[int, tuple[Finding, ...]]:
    """Nanoseconds to add to every point time.

    asked: what the user says the header is, None where nobody did.   own_clock: absolute times near the headers stay
    as they are.
    """
    if not edges.first_ns.size:
        return 0, ()
    begin_ns, end_ns = whole_sweep_ns(edges)
    near_ns = _AT_HEADER * edges.period_s * NS_PER_S
    if asked == "header-first":
        return (0 if abs(begin_ns) <= near_ns and not edges.absolute else -begin_ns), ()
    if asked == "header-last":
        return (0 if abs(end_ns) <= near_ns and not edges.absolute else -end_ns), ()
    if not edges.absolute or (own_clock and abs(begin_ns) <= _SAME_EPOCH_S * NS_PER_S):
        return 0, ()
    return -begin_ns, (_epoch_finding(edges),)


def _epoch_finding(edges: SweepEdges) -> Finding:
    apart_ns = edges.header_ns - edges.first_ns
    apart_s = float(np.median(apart_ns)) / NS_PER_S
    return Finding(
        code="points.epoch",
        level="warning",
        text=f"Point times and headers count from different instants, {apart_s:.3f} s apart.",
        evidence=(
            Clue("header minus first point", apart_s, "s"),
            Clue("its spread", float(np.ptp(apart_ns)) / NS_PER_S, "s"),
        ),
        confidence=1.0,
        consequence="point times are moved into the headers' epoch by one constant, so that a jittering"
        " header moves nothing",
        override="--point-time-reference header-last",
    )
