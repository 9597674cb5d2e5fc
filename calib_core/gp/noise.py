"""White-noise level of sampled signals, from what no smooth motion can explain.

The k-th divided difference over k + 1 consecutive stamps, sum_j c_j y_j with c_j = 1 / prod_{i != j} (t_j - t_i), is
zero for every polynomial below degree k whatever the spacing. Scaled to unit length of c it has exactly the readings'
standard deviation if they are white. A sine of frequency f sampled at interval h passes with the gain
(2 sin(pi f h))^k / |binomials|: k = 6, f = 3 Hz, h = 10 ms gives 1.4e-6.
"""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray

#: Order of the difference. Each more costs a little efficiency and divides what leaks of motion by about ten at 100 Hz.
_ORDER = 6
#: The standard deviation of a normal variable per unit of its median absolute value.
MAD_TO_STD = 1.482602218505602


def high_frequency_noise(stamps_s: FloatArray, values: FloatArray) -> FloatArray:
    """Standard deviation of each channel's white noise.

    stamps_s: (Q,) strictly increasing [s], Q > 6.   values: (Q, C).   Returns (C,) in the values' unit.
    By the median, so that knocks and outliers below a few per cent do not count; stretches with a gap are left out.
    A sensor's own low-pass filter makes noise that is not white: then this is less than the density's value.
    """
    if stamps_s.shape[0] <= _ORDER:
        raise ValueError(f"{stamps_s.shape[0]} readings, at least {_ORDER + 1} are needed for a noise level")
    stack = np.arange(stamps_s.shape[0] - _ORDER)[:, None] + np.arange(_ORDER + 1)
    times = stamps_s[stack]
    span = times[:, -1] - times[:, 0]
    kept = span < 1.5 * np.median(span)
    times = times[kept]
    # In units of the typical interval: raw seconds to the sixth power would lose the range of a double at kHz rates.
    gaps = (times[:, :, None] - times[:, None, :]) / (np.median(span) / _ORDER)
    gaps[:, np.arange(_ORDER + 1), np.arange(_ORDER + 1)] = 1.0
    coefficients = 1.0 / np.prod(gaps, axis=2)
    coefficients /= np.linalg.norm(coefficients, axis=1, keepdims=True)
    differences = np.einsum("nk,nkc->nc", coefficients, values[stack[kept]])
    typical: FloatArray = np.median(np.abs(differences), axis=0)
    return MAD_TO_STD * typical
