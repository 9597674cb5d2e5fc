"""Stamps that cannot be: headers minutes away from all others of their topic, and headers that nobody ever set."""

from __future__ import annotations

import numpy as np

from calib_core.types import BoolArray, Evidence, Finding, IntArray

#: A header this far from its topic's usual distance to the receive time is a damaged number.
MAX_DEVIATION_NS = 60_000_000_000
#: Where more than this share deviates it is no damage but a clock that was set; then nothing is left out.
MAX_SHARE = 0.05


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
    """Whether the headers stand still: a driver that leaves them at zero, or at one instant."""
    return header_ns.size >= 5 and np.unique(header_ns).size <= 0.1 * header_ns.size


def unset_finding(topic: str) -> Finding:
    """What follows from headers that stand still."""
    return Finding(
        code="clock.unset",
        level="warning",
        text=f"The headers on {topic} all carry one stamp: nobody set them, and the receive times take their place.",
        evidence=(Evidence("different stamps", "a tenth of the messages or fewer"),),
        confidence=1.0,
        consequence="the time offset includes the recorder's latency, and its jitter limits the result; let the driver"
        " set the stamps",
        override="--stamps receive",
    )
