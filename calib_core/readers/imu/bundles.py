"""Readings that wait in a buffer are stamped together when a driver empties it: they belong a period apart, the newest last.

A serial adapter hands over what it holds every 16 ms, some drivers send twenty readings at once. All of a bundle bear the
same stamp, or stamps as far apart as the host takes to read them. The sensor's period follows from how many readings come
in a long time, not from the usual step.

Where the stamps of all bundles are multiples of the time between two, nobody waited: a clock that ticks more slowly than the
sensor measures stamped each reading with the last tick. They belong a period apart after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.types import BoolArray, FloatArray, IntArray

#: Readings that a period is counted over: one lost, or one bundle more or less, changes it by little.
_COUNTED = 256
#: With fewer readings nothing is said.
_LEAST = 100
#: A reading stamped so much of a period after the one before it waited with it; even stamps that jitter by a third of the
#: period come so close in 2 of 100 steps, those behind a host's stalls in as many.
_TOGETHER, _USUAL_SHARE = 0.25, 0.15
#: Ticks are whole microseconds, and this share of the stamps is on them to half of one; more are where readings were lost.
_ROUND_NS, _ON_TICKS = 1000, 0.99
#: So many of an equal stamp are compared: more no buffer holds.
_MOST_EQUAL = 64


@dataclass(frozen=True, slots=True)
class Bundles:
    """Readings that are stamped together.

    stamps_ns: (Q,) spread: the newest of a bundle at the first stamp of it, the others the sensor's period before one
    another; strictly increasing.   period_ns: of the sensor.   size: readings in a bundle, mean.   largest: most.
    waited_s: longest that a reading waited for the newest of its bundle, 99 of 100 wait less.   tick_ns: of a clock that the
    readings come faster than, and were spread over from its ticks on; 0 for a buffer's.
    """

    stamps_ns: IntArray
    period_ns: float
    size: float
    largest: int
    waited_s: float
    tick_ns: int = 0


def spread(stamps_ns: IntArray) -> Bundles | None:
    """What the stamps of a driver that empties a buffer should have been; None where they do not come in bundles.

    stamps_ns: (Q,) strictly increasing.
    """
    count = len(stamps_ns)
    if count < _LEAST:
        return None
    t = np.asarray(stamps_ns - stamps_ns[0], dtype=np.float64)
    begins = np.concatenate([[True], np.diff(t) > _TOGETHER * _pace(t, np.arange(count))])
    if np.mean(~begins) < _USUAL_SHARE:
        return None
    first = np.flatnonzero(begins)
    newest = np.append(first[1:], count) - 1
    period = _pace(t[first], newest)
    bundle = np.cumsum(begins) - 1
    behind = newest[bundle] - np.arange(count)
    tick_ns = _tick_ns(stamps_ns[first])
    if tick_ns:
        behind = first[bundle] - np.arange(count)
    placed = np.rint(t[first][bundle] - behind * period).astype(np.int64)
    # No stamp is early: what would have been read after a later one was read before its stamp says.
    order = np.arange(count)
    placed = np.minimum.accumulate((placed - order)[::-1])[::-1] + order
    sizes = np.diff(np.append(first, count))
    return Bundles(
        stamps_ns[0] + placed,
        period,
        size=float(np.mean(sizes)),
        largest=int(sizes.max()),
        waited_s=float(np.percentile(np.abs(behind), 99.0)) * period * 1e-9,
        tick_ns=tick_ns,
    )


def _tick_ns(stamps_ns: IntArray) -> int:
    """The time between bundles, where their stamps (B,) are multiples of it since their epoch; else 0."""
    tick_ns = round(float(np.median(np.diff(stamps_ns)))) if len(stamps_ns) > 1 else 0
    # The reader tells equal stamps apart by nanoseconds, seconds in double precision are rounded: a hundredth is no chance of 50.
    tick_ns = round(tick_ns / _ROUND_NS) * _ROUND_NS
    if tick_ns == 0:
        return 0
    off = (stamps_ns + tick_ns // 2) % tick_ns - tick_ns // 2
    return tick_ns if np.mean(np.abs(off) <= _ROUND_NS // 2) > _ON_TICKS else 0


def _pace(t: FloatArray, number: IntArray) -> float:
    """Usual time a reading over long stretches; number: (B,) of the readings at t (B,), increasing."""
    apart = min(max(1, round(_COUNTED * len(t) / (number[-1] + 1))), max(1, len(t) // 4))
    return float(np.median((t[apart:] - t[:-apart]) / (number[apart:] - number[:-apart])))


def told_apart(stamps_ns: IntArray, readings: FloatArray) -> tuple[IntArray, IntArray]:
    """Readings in order of their stamps, without those sent twice; others of an equal stamp follow at a nanosecond each.

    stamps_ns: (Q,) as received.   readings: (Q, C).   Returns which are kept, (K,), and their stamps, strictly increasing.
    """
    order = np.argsort(stamps_ns, kind="stable")
    kept = order[_unrepeated(stamps_ns[order], readings[order])]
    place = np.arange(len(kept))
    return kept, np.asarray(np.maximum.accumulate(stamps_ns[kept] - place) + place, dtype=np.int64)


def _unrepeated(stamps_ns: IntArray, readings: FloatArray) -> BoolArray:
    """(Q,) whether no reading of the same stamp before it reads the same. In order of stamps."""
    kept = np.ones(len(stamps_ns), dtype=np.bool_)
    for apart in range(1, min(len(stamps_ns), _MOST_EQUAL)):
        shared = stamps_ns[apart:] == stamps_ns[:-apart]
        if not shared.any():
            break
        kept[apart:] &= ~(shared & (readings[apart:] == readings[:-apart]).all(axis=1))
    return kept
