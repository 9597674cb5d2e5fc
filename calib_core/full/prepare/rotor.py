r"""What a rotor wanders by, beside what the stamps of its turns jitter.

A motor keeps its speed as well as its controller does: over minutes it is ahead of an even turning, and behind it, by more than
an arriving packet is late, and from turn to turn by next to nothing. What a stamp jitters by is anew each time. So of errors y_i
about a line, the wander x is what is smooth,

    x = argmin  sum_i u_i (y_i - x_i)^2 + lambda sum_i (x_{i-1} - 2 x_i + x_{i+1})^2,

a speed that walks at random (Whittaker's smoother), with the lambda that is likeliest: with A = diag(u) + lambda D' D
and n stamps used,

    -2 log L = (n - 2) log(y' (u y - u x) / (n - 2)) + log |A| - (N - 2) log lambda

but for a constant (restricted likelihood). Where no lambda is much likelier than the largest, the rotor turns evenly.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from calib_core.full.prepare.settings import ROTOR
from calib_core.types import BoolArray, FloatArray, IntArray


def wander_of(number: IntArray, off_s: FloatArray, used: BoolArray) -> FloatArray:
    """By how much (N,) [s] turns with these numbers (N,), ascending, are off an even turning; zeros where that is nothing.

    off_s: (N,) what stamps are off a line.   used: (N,) without a host's stalls, three at least.
    """
    at = number - number[0]
    there = np.zeros(int(at[-1]) + 1)
    y = there.copy()
    there[at[used]], y[at[used]] = 1.0, off_s[used]
    n, turns = int(used.sum()), len(y)
    longest = math.log(ROTOR.longest * turns)
    periods = np.exp(np.arange(longest, math.log(ROTOR.shortest), -math.log(ROTOR.step)))
    tried = [_smoothed(y, there, float((period / (2.0 * np.pi)) ** 4), n) for period in periods]
    even, best = tried[0], min(tried, key=lambda one: one[1])
    return best[0][at] if best[1] < even[1] - ROTOR.likelier else np.zeros(len(at))


def _smoothed(y: FloatArray, there: FloatArray, weight: float, n: int) -> tuple[FloatArray, float]:
    """X (N,) for a lambda, and -2 log L of it. y: (N,), 0 where nothing is there."""
    turns = len(y)
    bands = np.zeros((3, turns))  # of A, the main one first
    for row, pairs in enumerate(_PAIRS):
        for a, b in pairs:
            bands[row, a : turns - 2 + a] += weight * _SECOND[a] * _SECOND[b]
    bands[0] += there
    factor = scipy.linalg.cholesky_banded(bands, lower=True)
    x = scipy.linalg.cho_solve_banded((factor, True), there * y)
    squares = max(float(y @ (there * (y - x))), np.finfo(float).tiny)
    told = (
        (n - 2) * math.log(squares / (n - 2)) + 2.0 * float(np.sum(np.log(factor[0]))) - (turns - 2) * math.log(weight)
    )
    return np.asarray(x), told


#: Second differences, and which two of the three columns meet on each diagonal of their square.
_SECOND = (1.0, -2.0, 1.0)
_PAIRS = (((0, 0), (1, 1), (2, 2)), ((0, 1), (1, 2)), ((0, 2),))
