r"""What a rotor wanders by, beside what the stamps of its turns jitter.

A motor keeps its speed as well as its controller does: over minutes it is ahead of an even turning, and behind it, by more than
an arriving packet is late, and from turn to turn by next to nothing. What a stamp jitters by is anew each time. So of errors y_i
about a line, the wander x is what is smooth,

    x = argmin  sum_i u_i (y_i - x_i)^2 + lambda sum_i (x_{i-1} - 2 x_i + x_{i+1})^2,

a speed that walks at random (Whittaker's smoother), with the lambda that is likeliest: with A = diag(u) + lambda D' D
and n stamps used,

    -2 log L = (n - 2) log(y' (u y - u x) / (n - 2)) + log |A| - (N - 2) log lambda

but for a constant (restricted likelihood). Where lambda is infinite, x is a line, and with X = [1, i] of those used

    -2 log L = (n - 2) log(y' (y - x) / (n - 2)) + log |X' X|;

where none is much likelier than that, the rotor turns evenly. A pause counts as no more turns than a smoother can go over with
all its digits: what a rotor did in an hour without a scan, nobody knows.
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
    at = np.cumsum(np.minimum(np.diff(number, prepend=number[0]), ROTOR.pause_turns))
    there = np.zeros(int(at[-1]) + 1)
    y = there.copy()
    there[at[used]], y[at[used]] = 1.0, off_s[used]
    longest = math.log(min(ROTOR.longest * len(y), ROTOR.most_turns))
    periods = np.exp(np.arange(longest, math.log(ROTOR.shortest), -math.log(ROTOR.step)))
    tried = [_smoothed(y, there, float((period / (2.0 * np.pi)) ** 4)) for period in periods]
    best = min(tried, key=lambda one: one[1])
    return best[0][at] if best[1] < _evenly(y, there) - ROTOR.likelier else np.zeros(len(at))


def _evenly(y: FloatArray, there: FloatArray) -> float:
    """-2 log L of a line. y, there: as `_smoothed` has them."""
    seen = np.flatnonzero(there)
    X = np.stack([np.ones(len(seen)), seen - seen.mean()], axis=1)
    left = y[seen] - X @ np.linalg.lstsq(X, y[seen], rcond=None)[0]
    return _likelihood(float(left @ left), len(seen)) + float(np.linalg.slogdet(X.T @ X)[1])


def _smoothed(y: FloatArray, there: FloatArray, weight: float) -> tuple[FloatArray, float]:
    """The smooth part (N,) for a lambda, and -2 log L of it. y: (N,), 0 where nothing is.   there: (N,) 1 where something is."""
    turns = len(y)
    bands = np.zeros((3, turns))  # of A, the main one first
    for row, pairs in enumerate(_PAIRS):
        for a, b in pairs:
            bands[row, a : turns - 2 + a] += weight * _SECOND[a] * _SECOND[b]
    bands[0] += there
    factor = scipy.linalg.cholesky_banded(bands, lower=True)
    x = scipy.linalg.cho_solve_banded((factor, True), there * y)
    told = 2.0 * float(np.sum(np.log(factor[0]))) - (turns - 2) * math.log(weight)
    return np.asarray(x), _likelihood(float(y @ (there * (y - x))), int(there.sum())) + told


def _likelihood(squares: float, n: int) -> float:
    """What n stamps add to -2 log L by what is left of them."""
    return (n - 2) * math.log(max(squares, np.finfo(float).tiny) / (n - 2))


#: Second differences, and which two of the three columns meet on each diagonal of their square.
_SECOND = (1.0, -2.0, 1.0)
_PAIRS = (((0, 0), (1, 1), (2, 2)), ((0, 1), (1, 2)), ((0, 2),))
