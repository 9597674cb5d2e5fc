"""Which source point a click means: the nearest one in front of the camera within a narrow cone around its ray."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib_core.types import BoolArray, Float32Array, FloatArray

#: Which of some points (N, 3) are seen: one looks, and clicks, through what is cut away.
Drawn = Callable[[Float32Array], BoolArray]

#: Half opening of the cone: about the size of a finger's pixel on the canvas.
CONE_RAD = 0.01
#: Points this much behind the first one hit still count as the same surface.
SURFACE_DEPTH_M = 0.3


def pick(
    points_m: Float32Array, origin_m: FloatArray, direction: FloatArray, drawn: Drawn | None = None
) -> FloatArray | None:
    """The picked point (3,), or None where the ray passes all."""
    place = pick_place(points_m, origin_m, direction, drawn)
    if place is None:
        return None
    picked: FloatArray = points_m[place].astype(np.float64)
    return picked


def pick_place(
    points_m: Float32Array,
    origin_m: FloatArray,
    direction: FloatArray,
    drawn: Drawn | None = None,
) -> int | None:
    """The place of the picked point, or None where the ray passes all.

    points_m: (N, 3).   origin_m: (3,).   direction: (3,), any length but zero.   drawn: which of some points count.
    Of the points inside the cone the surface nearest to the camera wins, and on it the point nearest to the ray.
    """
    length = float(np.linalg.norm(direction))
    if len(points_m) == 0 or not np.isfinite(length) or length == 0.0:
        return None
    ray = (direction / length).astype(np.float32)
    relative = points_m - origin_m.astype(np.float32)
    along_m = relative @ ray
    off_m = np.sqrt(np.maximum(np.einsum("ij,ij->i", relative, relative) - along_m**2, 0.0))
    candidates = np.flatnonzero((along_m > 0.05) & (off_m <= np.tan(CONE_RAD) * along_m))
    if drawn is not None:
        candidates = candidates[drawn(points_m[candidates])]
    if len(candidates) == 0:
        return None
    near = candidates[along_m[candidates] <= along_m[candidates].min() + SURFACE_DEPTH_M]
    return int(near[np.argmin(off_m[near] / along_m[near])])
