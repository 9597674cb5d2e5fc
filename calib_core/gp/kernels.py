"""Matern correlation functions of one variable, for the half-integer smoothness values that have a closed form.

With u = |t - t'| / l:

    1/2   exp(-u)                                     continuous
    3/2   (1 + a) exp(-a),            a = sqrt(3) u   once differentiable
    5/2   (1 + a + a^2/3) exp(-a),    a = sqrt(5) u   twice differentiable

A kernel is the correlation times signal_std^2. "Isotropic" in the paper means one length scale l for the
one input, time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, assert_never

import numpy as np

from calib_core.types import FloatArray

Smoothness = Literal["1/2", "3/2", "5/2"]
Correlation = Callable[[FloatArray], FloatArray]


def matern_12(scaled_distance: FloatArray) -> FloatArray:
    """Correlation of a Matern 1/2 process. scaled_distance: (...) |t - t'| / length scale. Returns (...)."""
    return np.exp(-scaled_distance, dtype=np.float64)


def matern_32(scaled_distance: FloatArray) -> FloatArray:
    """Correlation of a Matern 3/2 process. scaled_distance: (...) |t - t'| / length scale. Returns (...)."""
    a = np.sqrt(3.0) * scaled_distance
    return _times_decay(1.0 + a, a)


def matern_52(scaled_distance: FloatArray) -> FloatArray:
    """Correlation of a Matern 5/2 process. scaled_distance: (...) |t - t'| / length scale. Returns (...)."""
    a = np.sqrt(5.0) * scaled_distance
    polynomial = a / 3.0
    polynomial += 1.0
    polynomial *= a
    polynomial += 1.0
    return _times_decay(polynomial, a)


def _times_decay(polynomial: FloatArray, a: FloatArray) -> FloatArray:
    """The product polynomial * exp(-a), in the memory of both: fresh arrays made this the regression's slowest line."""
    np.negative(a, out=a)
    np.exp(a, out=a)
    polynomial *= a
    return polynomial


def correlation(smoothness: Smoothness) -> Correlation:
    """The correlation function of that smoothness."""
    match smoothness:
        case "1/2":
            return matern_12
        case "3/2":
            return matern_32
        case "5/2":
            return matern_52
        case _:
            assert_never(smoothness)
