"""Readings of an IMU that is shaken."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray
from tests.core.imu.instants import NOISE, PERIOD_S, readings_at

#: Of the sampling rate: an engine's lines, the last one faster than half of it.
LINES = (0.17, 0.29, 0.41, 0.23, 0.37, 0.61)


def shaken_at(t: FloatArray, rng: np.random.Generator, lines: tuple[float, ...] = LINES[:5]) -> FloatArray:
    """(N, 6) a hand's motion and what shakes it: a hundred times the noise, every line on every axis."""
    out = readings_at(t, rng)
    for line in lines:
        phase, size = rng.uniform(0.0, 2.0 * np.pi, 6), rng.uniform(0.7, 1.3, 6)
        out += 100.0 * NOISE * size * np.sin(2.0 * np.pi * line / PERIOD_S * t[:, None] + phase)
    return np.asarray(out)
