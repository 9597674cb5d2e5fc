r"""Whether a shaken sensor's stamps jitter or its sampling does: what `sampling.py` asks, where shaking hides it.

What shakes a rig is far above what cubics between neighbours follow, and what they leave of it buries everything. But engines,
rotors and roads shake in lines and bands, and those are their own best forecast: of each channel the filter is taken that
expects a reading best from so many on either side,

    e_i = y_i - sum_j c_j y_{i+j},      c by least squares,

which leaves of lines nothing and of bands little. Where readings were taken late by beta tau_i, they are off by their slope
times that, each of them by its own:

    e_i = beta (ydot_i tau_i - sum_j c_j ydot_{i+j} tau_{i+j}) + noise,

the slopes being those of what is expected: noise has none. Shaking that is faster than half the sampling rate shows slopes that
are not its own; beta is 0 all the same where only the stamps jitter. Of jitter that is slower than a filter is long it says
nothing: it is asked where cubics do not tell.
"""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray, IntArray

#: judged: readings on either side by which one is expected: two for each line, and bands take more. Twice as many tell the same.
SPAN = 16
#: judged: readings in a block; beta's standard deviation is that of the sums over blocks, many and longer than a filter.
_BLOCK, _FEWEST_BLOCKS = 100, 10
#: derived: of the readings' own squares: keeps the filter finite where lines are fewer than it has numbers.
_RIDGE = 1e-9


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
        c = _filter(y, centre)
        e = y[centre] - _expected(y, c)[centre]
        noise = float(np.mean(e**2))
        if noise <= 0.0:
            continue
        off = _slopes(_expected(y, c)) * tau
        x = (off - _expected(off, c))[centre]
        xx += np.sum((x * x).reshape(blocks, _BLOCK), axis=1) / noise
        xe += np.sum((x * e).reshape(blocks, _BLOCK), axis=1) / noise
    size = float(xx.sum())
    if size <= 0.0:
        return 0.5, np.inf
    share = float(xe.sum()) / size
    return share, float(np.sqrt(np.sum((xe - share * xx) ** 2))) / size


def _filter(y: FloatArray, centre: IntArray) -> FloatArray:
    """(2 SPAN + 1,) that expects the readings at `centre` best from their neighbours; none from itself."""
    steps = np.array([step for step in range(-SPAN, SPAN + 1) if step])
    around = y[centre[:, None] + steps]
    normal = around.T @ around
    normal[np.diag_indices_from(normal)] += _RIDGE * np.trace(normal)
    return np.insert(np.linalg.solve(normal, around.T @ y[centre]), SPAN, 0.0)


def _expected(y: FloatArray, c: FloatArray) -> FloatArray:
    """(Q,) what a filter expects of each reading; of those at either end less than of others."""
    return np.convolve(y, c[::-1], mode="same")


def _slopes(y: FloatArray) -> FloatArray:
    """(Q,) per sample, of all that is slower than most of half the sampling rate: the ideal differentiator, tapered."""
    steps = np.arange(1, SPAN + 1)
    half = np.where(steps % 2 == 0, -1.0, 1.0) / steps * np.cos(0.5 * np.pi * steps / (SPAN + 1)) ** 2
    return _expected(y, np.concatenate([-half[::-1], [0.0], half]))
