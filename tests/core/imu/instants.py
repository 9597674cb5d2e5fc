"""Readings whose instants are known, and stamps of them that jitter."""

from __future__ import annotations

import numpy as np

from calib_core.imu.sampling import Sampling, study_sampling
from calib_core.types import FloatArray, IntArray

EPOCH_NS = 1_700_000_000_000_000_000
PERIOD_S = 0.01
JITTER_S = 0.001
NOISE = np.array([1.2e-3] * 3 + [0.012] * 3)


def even_instants(rng: np.random.Generator, count: int = 2000, *, lost: float = 0.0) -> FloatArray:
    """True times of an even row, some of them lost."""
    t = 0.0037 + PERIOD_S * np.arange(count)
    return np.asarray(t[rng.random(count) >= lost], dtype=np.float64)


def readings_at(t: FloatArray, rng: np.random.Generator, pace: float = 1.0) -> FloatArray:
    """Six channels of smooth motion as a hand makes it, and white noise."""
    phase = np.arange(6)
    rate = 2.0 * np.pi * pace * np.array([0.21, 0.37, 0.53, 0.3, 0.45, 0.6])
    size = np.array([0.5, 0.6, 0.7, 1.0, 1.2, 1.4])
    return np.asarray(
        size * np.sin(rate * t[:, None] + phase) + NOISE * rng.standard_normal((len(t), 6)), dtype=np.float64
    )


def in_ns(t: FloatArray) -> IntArray:
    return EPOCH_NS + np.rint(t * 1e9).astype(np.int64)


def uniform_jitter(rng: np.random.Generator, count: int) -> FloatArray:
    return np.asarray(rng.uniform(-JITTER_S, JITTER_S, count), dtype=np.float64)


def off_line_s(sampling: Sampling, t: FloatArray) -> FloatArray:
    """How far the even stamps are from the true times."""
    return np.asarray((sampling.even_ns - in_ns(t)) * 1e-9, dtype=np.float64)


def studied(stamps_ns: IntArray, values: FloatArray) -> Sampling:
    sampling = study_sampling(stamps_ns, values)
    assert sampling is not None
    return sampling
