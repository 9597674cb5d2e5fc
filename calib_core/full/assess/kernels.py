"""Loops over the lasers' clusters for the assessment, compiled. Each has a NumPy twin in the tests."""

from __future__ import annotations

import numba
import numpy as np

from calib_core.types import Float32Array, FloatArray, IntArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_influences_kernel(
    bins: IntArray,
    laser: IntArray,
    cross: FloatArray,
    a: FloatArray,
    Q: FloatArray,
    F: FloatArray,
    change: FloatArray,
    moved: FloatArray,
    allowed: FloatArray,
) -> None:
    """Adds to each bin's moved (Q, 7) and allowed (Q, 7, 7) what where its lasers' points lie has moved and allowed.

    bins, laser: (B,).   cross: (B, 8, 5).   a: (Q, 5), Q: (Q, 4, 7) of the bins.   F: (L, 8, 7), change: (L, 8) of the lasers.
    """
    features, seven = F.shape[1], F.shape[2]
    by_cross = np.empty((4, seven))
    pull, push, mixed = np.empty(features), np.empty(4), np.empty((seven, seven))
    for b in range(bins.shape[0]):
        q, j = bins[b], laser[b]
        push[:], by_cross[:] = 0.0, 0.0
        for f in range(features):
            total, by = 0.0, change[j, f]
            for c in range(4):
                value = cross[b, f, c]
                total += value * a[q, c]
                push[c] += value * by
                for s in range(seven):
                    by_cross[c, s] += value * F[j, f, s]
            pull[f] = total + cross[b, f, 4] * a[q, 4]
        for s in range(seven):
            total = 0.0
            for f in range(features):
                total += F[j, f, s] * pull[f]
            for c in range(4):
                total += Q[q, c, s] * push[c]
            moved[q, s] -= total
            for t in range(seven):
                mixed[s, t] = (
                    Q[q, 0, s] * by_cross[0, t] + Q[q, 1, s] * by_cross[1, t] + Q[q, 2, s] * by_cross[2, t]
                    + Q[q, 3, s] * by_cross[3, t]
                )  # fmt: skip
        for s in range(seven):
            for t in range(seven):
                allowed[q, s, t] += mixed[s, t] + mixed[t, s]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_own_influences_kernel(
    bins: IntArray,
    laser: IntArray,
    gram: Float32Array,
    F: FloatArray,
    change: FloatArray,
    moved: FloatArray,
    allowed: FloatArray,
) -> None:
    """Adds to them what the lasers' features have by themselves. gram: (U, 8, 8), bins, laser: (U,) of each."""
    features, seven = F.shape[1], F.shape[2]
    by_gram = np.empty((features, seven))
    for u in range(gram.shape[0]):
        q, j = bins[u], laser[u]
        for f in range(features):
            pull = 0.0
            by_gram[f] = 0.0
            for e in range(features):
                value = gram[u, f, e]
                pull += value * change[j, e]
                for s in range(seven):
                    by_gram[f, s] += value * F[j, e, s]
            for s in range(seven):
                moved[q, s] -= F[j, f, s] * pull
        for s in range(seven):
            for f in range(features):
                way = F[j, f, s]
                for t in range(seven):
                    allowed[q, s, t] += way * by_gram[f, t]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def laser_influences_kernel(
    bins: IntArray,
    laser: IntArray,
    cross: FloatArray,
    a: FloatArray,
    Q: FloatArray,
    F: FloatArray,
    change: FloatArray,
    moved: FloatArray,
    allowed: FloatArray,
) -> None:
    """Adds to each laser's moved (L, 7) and allowed (L, 7, 7) what the means of its points have moved and allowed.

    As above, but `laser` may count patch * L + laser, as F and change do.
    """
    features, seven, lasers = F.shape[1], F.shape[2], moved.shape[0]
    response = np.empty(seven)
    for b in range(bins.shape[0]):
        q, j = bins[b], laser[b]
        weight = cross[b, 0, 3] + cross[b, 4, 3]
        if weight <= 0.0:
            continue
        residual, mine = 0.0, j % lasers
        response[:] = 0.0
        for c in range(5):
            mean = (cross[b, 0, c] + cross[b, 4, c]) / weight
            residual += mean * a[q, c]
            if c < 4:
                for s in range(seven):
                    response[s] += mean * Q[q, c, s]
        for f in range(features):
            mean = cross[b, f, 3] / weight
            residual += mean * change[j, f]
            for s in range(seven):
                response[s] += mean * F[j, f, s]
        for s in range(seven):
            pull = weight * response[s]
            moved[mine, s] -= pull * residual
            for t in range(seven):
                allowed[mine, s, t] += pull * response[t]
