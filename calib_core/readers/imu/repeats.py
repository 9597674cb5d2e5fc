"""Readings that a driver sends again until the sensor has a new one: the first of each is the sensor's, the others nobody took.

A loop that publishes at 200 Hz what a gyroscope measures at 100 Hz makes a staircase, which lags behind the motion by half
a step: as measured readings they would put the time offset off by that, and say nothing of it.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from calib_core.readers.imu.bundles import Bundles, spread
from calib_core.stamp_rate import GAP_PERIODS
from calib_core.types import BoolArray, FloatArray, IntArray

#: Readings that a share is taken over: a sensor that rests repeats itself in coarse steps, one that is moved does not.
_STRETCH = 128
#: A driver repeats all the time: even where fewest are, so many of a stretch are repeats, beyond those that are by chance.
_LEAST_SHARE = 0.15
#: Where more of them are, no driver repeats but a sensor is stuck, or never moved and has no noise.
_MOST_SHARE = 0.96
#: Stretches that may have fewer: where messages were lost.
_SPARED = 0.05


def first_of_each(gyro: FloatArray, accel: FloatArray) -> BoolArray | None:
    """(Q,) which readings are no repeats of the one before; None where the driver does not repeat.

    gyro, accel: (Q, 3) in order of their stamps, any unit. Where whole readings repeat, these alone are repeats: a gyroscope that
    reads in coarse steps, and nought of slow turns, is alike for longer. Where they do not, the gyroscope is asked: one that is
    slower than the accelerometer is repeated alone.
    """
    if len(gyro) < 2 * _STRETCH:
        return None
    turned, pushed = (values[1:] == values[:-1] for values in (gyro, accel))
    for alike in (np.hstack([turned, pushed]), turned):
        beyond, usual = _shares(alike)
        if beyond >= _LEAST_SHARE and usual <= _MOST_SHARE:
            return np.concatenate([[True], ~alike.all(axis=1)])
    return None


def _shares(alike: BoolArray) -> tuple[float, float]:
    """Of stretches, the share of readings that are as the one before: where fewest are, beyond chance; the usual one.

    alike: (Q - 1, C) channel by channel. In coarse steps each channel stays where it is for a while, and by chance all do,
    as often as the product of how often each does. A driver repeats all of them at once. Where none ever changes, nothing tells.
    """
    each = sliding_window_view(alike, _STRETCH, axis=0)[:: _STRETCH // 2].mean(axis=2)
    together = sliding_window_view(alike.all(axis=1), _STRETCH)[:: _STRETCH // 2].mean(axis=1)
    chance = each.prod(axis=1)
    telling = chance < 1.0
    if not telling.any():
        return 0.0, 1.0
    beyond = (together[telling] - chance[telling]) / (1.0 - chance[telling])
    return float(np.quantile(beyond, _SPARED)), float(np.median(together))


def as_sensed(
    gyro: FloatArray, accel: FloatArray, stamps_ns: IntArray
) -> tuple[BoolArray | None, Bundles | None, IntArray]:
    """Which readings are no repeats, None for all; the bundles in which they came, None where in none; when those were taken.

    A driver that repeats may hand over what it repeats in bundles: each has its place among all that were sent, where nobody sees
    it any more once the repeats are gone. Where it only sends each reading twice at once, all that were sent seem bundles of two,
    and those that are kept are even as they are. So of both ways the one that gives the more even row is taken.

    gyro, accel: (Q, 3), stamps_ns: (Q,) strictly increasing.
    """
    fresh, sent = first_of_each(gyro, accel), spread(stamps_ns)
    if fresh is None:
        return None, sent, stamps_ns if sent is None else sent.stamps_ns
    alone = spread(stamps_ns[fresh])
    taken_ns = stamps_ns[fresh] if alone is None else alone.stamps_ns
    if sent is not None and unevenness(sent.stamps_ns[fresh]) < unevenness(taken_ns):
        return fresh, sent, sent.stamps_ns[fresh]
    return fresh, alone, taken_ns


def unevenness(stamps_ns: IntArray) -> float:
    """What the steps of a row scatter by, of their mean: those beside gaps, which would outweigh all others."""
    steps = np.diff(stamps_ns).astype(np.float64)
    steps = steps[steps <= GAP_PERIODS * np.median(steps)]
    return float(np.std(steps) / max(float(np.mean(steps)), 1.0))
