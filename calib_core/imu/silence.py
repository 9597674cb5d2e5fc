"""Where an IMU fell silent: of the motion meanwhile it tells nothing, and what lies between its readings there is no reading.

A straight line from the last reading before to the first one after would be taken for the turns of a hand over half a second.
"""

from __future__ import annotations

import numpy as np

from calib_core.types import BoolArray, FloatArray

#: Steps between readings longer than both of these are a silence: of 0.06 s, as a hand turns evenly for so long, and of six
#: usual ones, as a slow IMU is not silent.
_LEAST_S = 0.06
_PERIODS = 6.0


def longest_step_s(stamps_s: FloatArray) -> float:
    """The longest step between two readings that is no silence [s]. stamps_s: (Q,) increasing."""
    return max(_LEAST_S, _PERIODS * float(np.median(np.diff(stamps_s)))) if len(stamps_s) > 1 else np.inf


def spans_silence(stamps_s: FloatArray, start_s: FloatArray, end_s: FloatArray) -> BoolArray:
    """(N,) whether spans of time share any of it with a silence. stamps_s: (Q,) increasing.   start_s, end_s: (N,)."""
    silent = np.flatnonzero(np.diff(stamps_s) >= longest_step_s(stamps_s))
    begun = np.searchsorted(stamps_s[silent], end_s, side="left")
    over = np.searchsorted(stamps_s[silent + 1], start_s, side="right")
    return np.asarray(begun > over)
