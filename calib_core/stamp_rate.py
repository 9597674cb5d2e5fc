"""How often a row of stamps comes: the one number for it that anybody is shown.

A median step is off by a thousandth where stamps jitter, the mean one where some are missing. Steps of ten samples hold a whole
number of them, whatever is missing, and a late stamp between two such steps makes one longer and the next shorter: the line
through every tenth stamp, by the samples that passed, is the rate.
"""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray, IntArray

#: A step longer than this many usual ones is a gap: how many samples it hides is no longer sure.
GAP_PERIODS = 3.5
#: Samples of a long step: few enough for a median step to tell how many they are, enough for jitter not to.
_SAMPLES = 10


def usual_step_ns(stamps_ns: IntArray) -> float:
    """Distance [ns] of stamps none of which is missing; 0 where there are fewer than two.   stamps_ns: (Q,) increasing."""
    steps = np.diff(stamps_ns).astype(np.float64)
    median = float(np.median(steps)) if steps.size else 0.0
    at = np.arange(0, len(stamps_ns), _SAMPLES)
    if median <= 0.0 or len(at) < 2:
        return median
    broken = np.cumsum(steps > GAP_PERIODS * median)[at[1:] - 1]
    whole = np.diff(broken, prepend=0) == 0
    lengths = np.diff(stamps_ns[at]).astype(np.float64)
    stretch = np.concatenate([[0], np.cumsum(~whole)])
    number = _centred(np.concatenate([[0.0], np.cumsum(np.rint(lengths / median))]), stretch)
    time_ns = _centred(np.concatenate([[0.0], np.cumsum(lengths)]), stretch)
    spread = float(number @ number)
    return float(number @ time_ns) / spread if spread > 0.0 else median


def _centred(values: FloatArray, stretch: IntArray) -> FloatArray:
    """Values (K,) less the mean of their stretch (K,)."""
    return np.asarray(values - (np.bincount(stretch, values) / np.maximum(np.bincount(stretch), 1))[stretch])


def rate_hz(stamps_ns: IntArray) -> float:
    """Stamps a second where none is missing; 0 where there are fewer than two.   stamps_ns: (Q,) increasing."""
    step_ns = usual_step_ns(stamps_ns)
    return 1e9 / step_ns if step_ns > 0.0 else 0.0
