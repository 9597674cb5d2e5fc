r"""Whether a shaken sensor's stamps jitter or its sampling does: what `sampling.py` asks, where shaking hides it.

What shakes a rig is far above what cubics between neighbours follow, and what they leave of it buries everything; a filter
that was fitted to it (reading_prediction.py) leaves little. Where readings were taken late by beta tau_i, they are off by their
slope times that, each of them by its own, and what is left of one is

    e_i = y_i - sum_j c_j y_{i+j} = beta (ydot_i tau_i - sum_j c_j ydot_{i+j} tau_{i+j}) + noise,

the slopes being those of what is expected: noise has none. Shaking that is faster than half the sampling rate shows slopes that
are not its own; beta is 0 all the same where only the stamps jitter. Of jitter that is slower than a filter is long it says
nothing: it is asked where cubics do not tell.
"""

from __future__ import annotations

import numpy as np

from calib_core.imu.reading_prediction import SPAN, forecast, forecast_filter
from calib_core.types import FloatArray, IntArray

#: judged: readings in a block; beta's standard deviation is that of the sums over blocks, many and longer than a filter.
_BLOCK, _FEWEST_BLOCKS = 100, 10


def shaken_share(centre: IntArray, tau: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Beta and its standard deviation; (0.5, infinite) where nothing that shakes tells.

    centre: (N,) readings with three times SPAN neighbours on either side, and none missing.   tau: (Q,) samples by which stamps
    are late.   values: (Q, C).
    """
    blocks = len(centre) // _BLOCK
    if blocks < _FEWEST_BLOCKS:
        return 0.5, np.inf
    centre = centre[: blocks * _BLOCK]
    xx, xe = np.zeros(blocks), np.zeros(blocks)
    for channel in range(values.shape[1]):
        y = values[:, channel] - values[centre, channel].mean()
        c = forecast_filter(y, centre)
        e = y[centre] - forecast(y, c)[centre]
        noise = float(np.mean(e**2))
        if noise <= 0.0:
            continue
        off = _slopes(forecast(y, c)) * tau
        x = (off - forecast(off, c))[centre]
        xx += np.sum((x * x).reshape(blocks, _BLOCK), axis=1) / noise
        xe += np.sum((x * e).reshape(blocks, _BLOCK), axis=1) / noise
    size = float(xx.sum())
    if size <= 0.0:
        return 0.5, np.inf
    share = float(xe.sum()) / size
    return share, float(np.sqrt(np.sum((xe - share * xx) ** 2))) / size


def _slopes(y: FloatArray) -> FloatArray:
    """(Q,) per sample, of all that is slower than most of half the sampling rate: the ideal differentiator, tapered."""
    steps = np.arange(1, SPAN + 1)
    half = np.where(steps % 2 == 0, -1.0, 1.0) / steps * np.cos(0.5 * np.pi * steps / (SPAN + 1)) ** 2
    return forecast(y, np.concatenate([-half[::-1], [0.0], half]))
