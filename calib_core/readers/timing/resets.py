"""Clocks that were set while the recording ran, and recordings of a playback that began anew.

A recorder's own clock goes on: where the stamps of a topic leave it by a jump and stay away, whoever stamps them was set. On
either side of that instant stamps mean something else; one side has to do.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.readers.timing.clocks import NS_PER_S, HeaderTimes
from calib_core.types import Clue, Finding, IntArray

#: Drivers' stalls are as long, and the messages behind them soon catch up: a jump of so much has to stay for some messages,
LEAST_NS = 50_000_000
#: a smaller one, which looks like messages that were lost, for seconds, and stand out from how the lag varies. Smaller still,
#: it shows in the answer, once there is one (`assess/clock_step.py`, which is sure from a millisecond on).
_LEAST_SURE_NS = 5_000_000
#: Messages on either side whose lag says that it stays, and the seconds of them.
_AROUND = 10
_AROUND_NS = 4_000_000_000
#: Judged: no clock is set more often within so many seconds: stamps of bundles that were sent one by one jump with each.
_MOST_AROUND = 3
#: Derived: medians of ten messages, or more, that are further apart than so many deviations are not by chance.
_SIGMAS = 8.0


@dataclass(frozen=True, slots=True)
class Reset:
    """One jump. at_ns: when the first message after it was received.   by_ns: how far the clock was set ahead, below 0: back."""

    topic: str
    at_ns: int
    by_ns: int


def resets(stamps: HeaderTimes, topic: str) -> list[Reset]:
    """Where the topic's clock was set, in receive order."""
    lag_ns = stamps.receive_ns - stamps.header_ns
    if lag_ns.size < 2 * _AROUND:
        return []
    step_ns, received_ns = np.diff(stamps.header_ns), np.diff(stamps.receive_ns)
    usual_ns = int(np.median(step_ns))
    by_ns = step_ns - received_ns
    # What the recorder got late is not stamped late: the stamps have to be what is unusual.
    unusual = np.abs(step_ns - usual_ns) > np.abs(received_ns - usual_ns)
    jumps = np.flatnonzero((np.abs(by_ns) > _LEAST_SURE_NS) & unusual) + 1
    if jumps.size == 0:
        return []
    large = jumps[np.abs(by_ns[jumps - 1]) > LEAST_NS]
    at_ns = stamps.receive_ns[large]
    crowded = (np.abs(at_ns[:, None] - at_ns) < _AROUND_NS).sum(axis=1) > _MOST_AROUND
    large = large[~crowded]
    found: list[Reset] = []
    for place in large.tolist():
        stays_ns = _usual(lag_ns[max(0, place - _AROUND) : place]) - _usual(lag_ns[place : place + _AROUND])
        if stays_ns * int(by_ns[place - 1]) > 0 and abs(stays_ns) > LEAST_NS:
            found.append(Reset(topic, int(stamps.receive_ns[place]), stays_ns))
    edges = [0, *np.searchsorted(stamps.receive_ns, [reset.at_ns for reset in found]).tolist(), lag_ns.size]
    small = np.setdiff1d(jumps, large)
    # What jumps all the time is jitter: the greatest alone is asked of each stretch.
    for first, end in itertools.pairwise(edges):
        within = small[(small > first) & (small < end)]
        if within.size:
            place = int(within[np.argmax(np.abs(by_ns[within - 1]))])
            stays_ns = _surely_stays_ns(stamps, (first, place, end))
            if stays_ns * int(by_ns[place - 1]) > 0:
                found.append(Reset(topic, int(stamps.receive_ns[place]), stays_ns))
    return sorted(found, key=lambda reset: reset.at_ns)


def resets_of_all(series: Sequence[HeaderTimes], topic: str) -> list[Reset]:
    """Where each series of stamps of the same messages jumps alike: what comes into sight where sweeps begin moves their first
    returns and not their last.
    """
    first, *others = (resets(stamps, topic) for stamps in series)
    return [
        reset
        for reset in first
        if all(any(same.at_ns == reset.at_ns and same.by_ns * reset.by_ns > 0 for same in other) for other in others)
    ]


def _surely_stays_ns(stamps: HeaderTimes, stretch: tuple[int, int, int]) -> int:
    """How far the lag has gone down [ns] for seconds after a message from what it was for seconds before, 0 where that is no more
    than its own variation. stretch: first message, the one after the jump, and end.
    """
    first, place, end = stretch
    lag_ns, at_ns = stamps.receive_ns - stamps.header_ns, int(stamps.receive_ns[place])
    near = np.abs(stamps.receive_ns - at_ns) < _AROUND_NS
    before, after = lag_ns[first:place][near[first:place]], lag_ns[place:end][near[place:end]]
    if min(before.size, after.size) < _AROUND:
        return 0
    stays_ns = _usual(before) - _usual(after)
    varies_ns = max(_usual(np.abs(side - _usual(side))) for side in (before, after))
    return stays_ns if abs(stays_ns) > max(_LEAST_SURE_NS, _SIGMAS * varies_ns) else 0


def _usual(lag_ns: IntArray) -> int:
    """Median of what may count from another century: no float holds that to the nanosecond."""
    return int(np.sort(lag_ns)[lag_ns.size // 2])


def _amount(by_ns: int) -> str:
    """A jump for a person."""
    return f"{abs(by_ns) / NS_PER_S:.2f} s" if abs(by_ns) > LEAST_NS else f"{abs(by_ns) * 1e-6:.0f} ms"


def sides(found: Sequence[Reset], begin_ns: int, end_ns: int) -> list[tuple[int, int]]:
    """Receive times of the stretches without a jump, the longest first, the earlier first of equally long ones."""
    edges = [begin_ns, *sorted({reset.at_ns for reset in found if begin_ns < reset.at_ns < end_ns}), end_ns]
    return sorted(itertools.pairwise(edges), key=lambda side: side[0] - side[1])


def reset_finding(found: Sequence[Reset], used: Sequence[tuple[int, int]], begin_ns: int) -> Finding:
    """What was set and what is used. used: sides, the first is.   begin_ns: the recording's start, receive time."""
    first = found[0]
    topics = list(dict.fromkeys(reset.topic for reset in found))
    way = "ahead" if first.by_ns > 0 else "back"
    (since_s, until_s), (other_since_s, other_until_s) = (
        tuple((edge_ns - begin_ns) / NS_PER_S for edge_ns in side) for side in used[:2]
    )
    times = max(sum(reset.topic == topic for reset in found) for topic in topics)
    often = f", the first of {times} times," if times > 1 else ""
    return Finding(
        code="clock.set",
        level="warning",
        text=f"The stamps on {' and '.join(topics)} jump {way} by {_amount(first.by_ns)}"
        f" {(first.at_ns - begin_ns) / NS_PER_S:.1f} s after the start{often} as when a clock is set or a playback begins anew:"
        f" only what was received from {since_s:.1f} s to {until_s:.1f} s is used.",
        evidence=(
            Clue("jump", first.by_ns / NS_PER_S, "s"),
            Clue("at", (first.at_ns - begin_ns) / NS_PER_S, "s"),
            Clue("used from", since_s, "s"),
            Clue("used until", until_s, "s"),
        ),
        consequence="the rest of the recording is left out",
        override=f"--start-s {other_since_s:.1f} --end-s {other_until_s:.1f}",
    )
