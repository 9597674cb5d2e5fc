"""Stamps that cannot be: headers minutes away from all others of their topic, and headers that nobody ever set."""

from __future__ import annotations

import numpy as np

from calib_core.types import BoolArray, Clue, Finding, IntArray

#: A header this far from its topic's usual distance to the receive time is a damaged number.
MAX_DEVIATION_NS = 60_000_000_000
#: Where more than this share deviates it is no damage but a clock that was set; then nothing is left out.
MAX_SHARE = 0.05
#: Fewer stamps tell nothing of a driver.
FEWEST = 5
#: Where no more than this share of the stamps is different, they stand still, or come in bundles; no driver keeps readings back
#: for longer than a bundle.
STANDING_SHARE, LONGEST_BUNDLE_NS = 0.1, 300_000_000


def plausible_stamps(header_ns: IntArray, receive_ns: IntArray) -> BoolArray:
    """(Q,) False for the few headers that are minutes away from where the others say they must be."""
    if header_ns.size < 3:
        return np.ones(header_ns.size, bool)
    # float64 is exact enough here: what counts is a minute in 1e18 ns
    lag = receive_ns.astype(np.float64) - header_ns.astype(np.float64)
    good: BoolArray = np.abs(lag - np.median(lag)) <= MAX_DEVIATION_NS
    if np.count_nonzero(~good) > MAX_SHARE * good.size:
        return np.ones(header_ns.size, bool)
    return good


def never_set(header_ns: IntArray) -> bool:
    """Whether the headers stand still: a driver that leaves them at zero, or at one instant, or at whole seconds.

    Readings that a driver sends ten or twenty at once share a stamp, too, but that one goes on.
    """
    if header_ns.size < FEWEST:
        return False
    different = np.unique(header_ns)
    if different.size > STANDING_SHARE * header_ns.size:
        return False
    return different.size < FEWEST or float(np.median(np.diff(different))) > LONGEST_BUNDLE_NS


def unset_finding(topic: str) -> Finding:
    """What follows from headers that stand still."""
    return Finding(
        code="clock.unset",
        level="warning",
        text=f"The headers on {topic} all carry one stamp: the driver did not set them, so the receive times are used instead.",
        evidence=(Clue("different stamps", "a tenth of the messages or fewer"),),
        confidence=1.0,
        consequence="the time offset includes the recorder's latency, and its jitter limits the result; let the driver"
        " set the stamps",
        override="--stamps receive",
    )


def unevenness_ns(stamps_ns: IntArray) -> float:
    """How unevenly stamps come: the usual deviation of their steps from the step in the middle."""
    steps_ns = np.diff(stamps_ns)
    return float(np.median(np.abs(steps_ns - np.median(steps_ns)))) if steps_ns.size else 0.0
