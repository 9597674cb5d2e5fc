"""SciPy's signal package is the oracle that a calibration does not wait for."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import detrend, windows

from calib_core.full.prepare.tapers import slepian_tapers, without_line


@pytest.mark.parametrize(("size", "half_bandwidths", "count"), [(256, 6.0, 7), (1001, 4.0, 3)])
def test_tapers_are_scipys_but_for_their_sign(size: int, half_bandwidths: float, count: int) -> None:
    """Mutations: the least concentrated of them; half the bandwidth; worst first."""
    ours, theirs = slepian_tapers(size, half_bandwidths, count), windows.dpss(size, half_bandwidths, count)
    signs = np.sign(np.sum(ours * theirs, axis=1, keepdims=True))
    np.testing.assert_allclose(signs * ours, theirs, atol=1e-9)


def test_the_line_through_each_channel_is_taken_out() -> None:
    """Mutation: the mean alone."""
    values = np.random.default_rng(0).normal(size=(101, 3)) + np.arange(101)[:, None] * [0.1, -2.0, 0.0]
    np.testing.assert_allclose(without_line(values), detrend(values, axis=0), atol=1e-10)
