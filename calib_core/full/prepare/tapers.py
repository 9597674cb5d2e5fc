"""Slepian tapers and the line through a stretch of readings, without SciPy's signal package: it is a quarter of all imports."""

from __future__ import annotations

import numpy as np
import scipy

from calib_core.types import FloatArray


def slepian_tapers(size: int, half_bandwidths: float, count: int) -> FloatArray:
    """The `count` sequences (count, size) of unit length that keep most of their power within so many half bandwidths.

    Eigenvectors of the tridiagonal matrix that commutes with the concentration problem (Slepian 1978); best first, each of
    either sign.
    """
    n = np.arange(size)
    diagonal = ((size - 1 - 2 * n) / 2.0) ** 2 * np.cos(2.0 * np.pi * half_bandwidths / size)
    beside = n[1:] * (size - n[1:]) / 2.0
    _, vectors = scipy.linalg.eigh_tridiagonal(diagonal, beside, select="i", select_range=(size - count, size - 1))
    return np.ascontiguousarray(vectors[:, ::-1].T, dtype=np.float64)


def without_line(values: FloatArray) -> FloatArray:
    """Values (N, C) less the straight line through each channel."""
    t = np.arange(len(values)) - 0.5 * (len(values) - 1)
    centred = values - values.mean(axis=0)
    return np.asarray(centred - t[:, None] * (t @ centred / (t @ t)))
