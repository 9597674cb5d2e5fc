"""Loops over the lasers' clusters for the assessment, compiled. Each has a NumPy twin in the tests.

What noise allows N unknowns is (.., N, N), or (.., N) of each by itself; which of them is known when a loop is compiled.
"""

from __future__ import annotations

import numba
import numpy as np

from calib_core.factors.laser_kernels import Clusters, rows_before, vector_before
from calib_core.types import Float32Array, FloatArray, IntArray


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sum_by_kernel(values: FloatArray, cluster: IntArray, total: FloatArray) -> None:
    """Adds each row of values (F, M) to that of its cluster (F,) in total (.., M), in their order; none where it is negative."""
    for i in range(cluster.shape[0]):
        k = cluster[i]
        if k >= 0:
            for c in range(values.shape[1]):
                total[k, c] += values[i, c]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_influences_kernel(
    clusters: Clusters,
    a: FloatArray,
    Q: FloatArray,
    F: FloatArray,
    change: FloatArray,
    moved: FloatArray,
    allowed: FloatArray,
) -> None:
    """Adds to each bin's moved (Q, N) and allowed what where its lasers' points lie has moved and allowed.

    a: (Q, 5), Q: (Q, 4, N) of the bins.   F: (L, A, N), change: (L, A) of the lasers.
    """
    features, unknowns, cross = F.shape[1], F.shape[2], clusters.cross
    seen, by, of_bin, of_pose = np.empty(5), np.empty((4, unknowns)), -1, -1
    by_cross = np.empty((4, unknowns))
    pull, push, mixed = np.empty(features), np.empty(4), np.empty((unknowns, unknowns))
    for b in range(cross.shape[0]):
        q, pose, j = clusters.bins[b], clusters.pose[b], clusters.laser[b]
        if q != of_bin or pose != of_pose:
            vector_before(clusters, pose, a[q], seen)
            rows_before(clusters, pose, Q[q], by)
            of_bin, of_pose = q, pose
        push[:], by_cross[:] = 0.0, 0.0
        for f in range(features):
            total, moved_by = 0.0, change[j, f]
            for c in range(4):
                value = cross[b, f, c]
                total += value * seen[c]
                push[c] += value * moved_by
                for s in range(unknowns):
                    by_cross[c, s] += value * F[j, f, s]
            pull[f] = total + cross[b, f, 4] * seen[4]
        for s in range(unknowns):
            total = 0.0
            for f in range(features):
                total += F[j, f, s] * pull[f]
            for c in range(4):
                total += by[c, s] * push[c]
            moved[q, s] -= total
        if allowed.ndim == 2:
            for c in range(4):
                for s in range(unknowns):
                    allowed[q, s] += 2.0 * by[c, s] * by_cross[c, s]
        else:
            for s in range(unknowns):
                for t in range(unknowns):
                    mixed[s, t] = (
                        by[0, s] * by_cross[0, t] + by[1, s] * by_cross[1, t] + by[2, s] * by_cross[2, t]
                        + by[3, s] * by_cross[3, t]
                    )  # fmt: skip
            for s in range(unknowns):
                for t in range(unknowns):
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
    """Adds to them what the lasers' features have by themselves. gram: (U, A (A + 1) / 2), bins, laser: (U,) of each."""
    features, unknowns = F.shape[1], F.shape[2]
    own, by_gram = np.empty((features, features)), np.empty((features, unknowns))
    for u in range(gram.shape[0]):
        q, j, place = bins[u], laser[u], 0
        for f in range(features):
            for e in range(f, features):
                own[f, e] = own[e, f] = gram[u, place]
                place += 1
        for f in range(features):
            pull = 0.0
            by_gram[f] = 0.0
            for e in range(features):
                value = own[f, e]
                pull += value * change[j, e]
                for s in range(unknowns):
                    by_gram[f, s] += value * F[j, e, s]
            for s in range(unknowns):
                moved[q, s] -= F[j, f, s] * pull
        if allowed.ndim == 2:
            for f in range(features):
                for s in range(unknowns):
                    allowed[q, s] += F[j, f, s] * by_gram[f, s]
        else:
            for s in range(unknowns):
                for t in range(s + 1):
                    both = 0.0
                    for f in range(features):
                        both += F[j, f, s] * by_gram[f, t]
                    allowed[q, s, t] += both
                    if t < s:
                        allowed[q, t, s] += both


@numba.njit(cache=True, nogil=True, error_model="numpy")
def laser_influences_kernel(
    clusters: Clusters,
    a: FloatArray,
    Q: FloatArray,
    F: FloatArray,
    change: FloatArray,
    moved: FloatArray,
    allowed: FloatArray,
) -> None:
    """Adds to each laser's moved (L, N) and allowed what the means of its points have moved and allowed.

    As above, but `laser` may count square * L + laser, as F and change do.   moments may be (B, 1, 5), of a 1 alone.
    """
    features, unknowns, lasers, cross = F.shape[1], F.shape[2], moved.shape[0], clusters.cross
    response, ones = np.empty(unknowns), np.empty(5)
    seen, by, of_bin, of_pose = np.empty(5), np.empty((4, unknowns)), -1, -1
    for b in range(cross.shape[0]):
        q, pose, j = clusters.bins[b], clusters.pose[b], clusters.laser[b]
        if q != of_bin or pose != of_pose:
            vector_before(clusters, pose, a[q], seen)
            rows_before(clusters, pose, Q[q], by)
            of_bin, of_pose = q, pose
        for c in range(5):
            ones[c] = np.float64(cross[b, 0, c]) + (cross[b, 4, c] if features > 4 else 0.0)
        weight = ones[3]
        if weight <= 0.0:
            continue
        residual, mine = 0.0, j % lasers
        response[:] = 0.0
        for c in range(5):
            mean = ones[c] / weight
            residual += mean * seen[c]
            if c < 4:
                for s in range(unknowns):
                    response[s] += mean * by[c, s]
        for f in range(features):
            mean = cross[b, f, 3] / weight
            residual += mean * change[j, f]
            for s in range(unknowns):
                response[s] += mean * F[j, f, s]
        for s in range(unknowns):
            pull = weight * response[s]
            moved[mine, s] -= pull * residual
            if allowed.ndim == 2:
                allowed[mine, s] += pull * response[s]
            else:
                for t in range(unknowns):
                    allowed[mine, s, t] += pull * response[t]
