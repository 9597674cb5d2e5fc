"""Clicks on planes that lie behind each other: the same place clicked again means the next one.

A first click toggles the plane in front. A second one at the same place puts that right again and toggles the next, and
so on; after the last one all are as they were.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from app.scene.items import Sheet
from calib_core.types import FloatArray

#: Rays that differ by less than this are the same place: a hand that does not move clicks within a few pixels.
SAME_PLACE_RAD = 0.008
#: A camera that has moved less looks from the same place.
SAME_EYE_M = 0.02


def pierced(sheets: Sequence[Sheet], origin_m: FloatArray, direction: FloatArray) -> list[int]:
    """The patches whose sheets a ray goes through, nearest first.   origin_m: (3,).   direction: (3,), any length but zero."""
    found: list[tuple[float, int]] = []
    for sheet in sheets:
        depth = None if sheet.patch is None else _depth(sheet, origin_m, direction)
        if depth is not None and sheet.patch is not None:
            found.append((depth, sheet.patch))
    return [patch for _, patch in sorted(found)]


def _depth(sheet: Sheet, origin_m: FloatArray, direction: FloatArray) -> float | None:
    """How far along the ray, in its lengths, it first meets one of the triangles; None where it meets none.

    A point of the ray is o + t d = a + u (b - a) + v (c - a), with u, v >= 0 and u + v <= 1 inside of the triangle.
    """
    a, b, c = (sheet.vertices[sheet.faces[:, k]].astype(np.float64) for k in range(3))
    system = np.stack([b - a, c - a, np.broadcast_to(-direction, a.shape)], axis=2)
    hit = np.abs(np.linalg.det(system)) > 1e-12
    if not hit.any():
        return None
    u, v, t = np.linalg.solve(system[hit], (origin_m - a[hit])[:, :, None])[:, :, 0].T
    inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
    return float(t[inside].min()) if inside.any() else None


@dataclass
class Cycle:
    """What was clicked last, and how often."""

    origin_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    direction: FloatArray = field(default_factory=lambda: np.zeros(3))
    hits: tuple[int, ...] = ()
    turn: int = 0

    def click(self, patch: int, hits: Sequence[int], origin_m: FloatArray, direction: FloatArray) -> list[int]:
        """The patches to toggle now, in this order.   patch: what the browser says was hit.   hits: all, nearest first."""
        ray = direction / np.linalg.norm(direction)
        again = (
            tuple(hits) == self.hits
            and float(np.linalg.norm(origin_m - self.origin_m)) < SAME_EYE_M
            and float(np.linalg.norm(ray - self.direction)) < SAME_PLACE_RAD
        )
        self.origin_m, self.direction, self.hits = origin_m, ray, tuple(hits)
        if len(hits) < 2 or patch not in hits:
            self.turn = 0
            return [patch]
        self.turn = (self.turn + 1) % (len(hits) + 1) if again else 1
        before = hits[self.turn - 2 if self.turn else -1]
        if self.turn == 1:
            return [hits[0]]
        return [before] if self.turn == 0 else [before, hits[self.turn - 1]]
