"""Lone readings that no body can have moved by: a byte lost on a serial line, a bit turned over.

A body that is struck swings on; a reading that leaps away and is back in the next one, between neighbours that agree, is damage.
One of 3 m/s2 in 10 ms is 3 cm/s that nothing moved by, where a calibration feels a tenth of a millimetre a second.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from calib_core.types import BoolArray, FloatArray

#: A leap is the distance from the median of so many readings, itself in the middle: one spike, or two, do not move it.
_WINDOW = 5
#: A spike leaps so many times as far as all but one in fifty readings do: white noise would in none of 10^70; what shakes
#: the rig all the time is its own measure.
_TIMES, _USUAL_PERCENT = 8.0, 98.0
#: And so many times as far as its neighbours bend: a blow goes on in those after it, a motion changes its slope by little.
_LONE = 12.0
#: No leap smaller than this is worth a word, whatever else rests: steps of coarse sensors are smaller.
LEAST_GYRO_RAD_S = 0.1
LEAST_ACCEL_M_S2 = 1.0
#: With more of them than this the sensor is like that, and leaving them out would not help.
_MOST_SHARE = 0.01


def spikes(gyro_rad_s: FloatArray, accel_m_s2: FloatArray) -> BoolArray:
    """(Q,) which readings are lone leaps on any channel; none where too many would be. Each (Q, 3), in order of their stamps."""
    leapt = _lone(gyro_rad_s, LEAST_GYRO_RAD_S) | _lone(accel_m_s2, LEAST_ACCEL_M_S2)
    return leapt if np.mean(leapt) <= _MOST_SHARE else np.zeros_like(leapt)


def _lone(channels: FloatArray, least: float) -> BoolArray:
    """(Q,) of (Q, 3): a leap beyond the usual ones, whose two neighbours on each side lie on one line."""
    half = _WINDOW // 2
    if len(channels) < 10 * _WINDOW:
        return np.zeros(len(channels), dtype=np.bool_)
    around = sliding_window_view(channels, _WINDOW, axis=0)
    leap = np.abs(around[..., half] - np.median(around, axis=-1))
    slopes = around[..., 1] - around[..., 0], 0.5 * (around[..., 3] - around[..., 1]), around[..., 4] - around[..., 3]
    bend = np.ptp(slopes, axis=0)
    beyond = np.maximum(_TIMES * np.percentile(leap, _USUAL_PERCENT, axis=0), least)
    found = np.zeros(len(channels), dtype=np.bool_)
    found[half:-half] = ((leap > beyond) & (leap > _LONE * bend)).any(axis=1)
    return found
