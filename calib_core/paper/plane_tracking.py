"""Planes followed from scan to scan by their normals (paper section II-E, figure 4).

Both sets of normals, the previous scan's and this one's, lose their centroid before nearest neighbours are sought. For
three near-orthogonal planes seen from inside, a turn moves all normals alike and the centroid with them: what is left
points along the triangle's corners, 120 degrees apart instead of 90, and a match survives larger turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from calib_core.types import FloatArray, IntArray

#: Detected planes considered for a match; more are furniture.
_MAX_CANDIDATES = 8


def match_normals(previous: FloatArray, current: FloatArray, *, max_turn_rad: float = 0.5) -> IntArray | None:
    """For each plane followed, the index of the plane of this scan that continues it; None where one is lost.

    previous: (P, 3) unit normals of the followed planes, in the previous scan's frame.   current: (D, 3) of the
    detected ones, in this scan's, largest first.   All point to the side from which they are seen.   Returns (P,)
    distinct indices. Of every choice of P detected planes the closest in the sum of squares is taken; it must be each
    plane's nearest neighbour, and no normal may have turned by more than max_turn_rad.
    """
    n_followed = previous.shape[0]
    best: IntArray | None = None
    best_cost = np.inf
    centred = previous - previous.mean(axis=0)
    for chosen in _choices(min(current.shape[0], _MAX_CANDIDATES), n_followed):
        some = current[chosen]
        distance = np.linalg.norm(centred[:, None] - (some - some.mean(axis=0))[None], axis=2)
        nearest = np.argmin(distance, axis=1)
        cost = float(np.sum(distance[np.arange(n_followed), nearest] ** 2))
        if np.unique(nearest).size == n_followed and cost < best_cost:
            best, best_cost = chosen[nearest], cost
    if best is None:
        return None
    turn = np.arccos(np.clip(np.einsum("pi,pi->p", previous, current[best]), -1.0, 1.0))
    return best if np.all(turn < max_turn_rad) else None


def _choices(n_detected: int, n_followed: int) -> Iterator[IntArray]:
    for chosen in combinations(range(n_detected), n_followed):
        yield np.array(chosen, dtype=np.int64)
