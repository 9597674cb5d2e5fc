"""Whether two planes are one: they face the same way, and lie near each other. How nearly is for whoever asks to say.

Near is what the one who asks can see: where a patch's middle lies (`same_place`), where all of its points lie (`same_points`),
or, of planes of one room whose points nobody has, how far they are from the same origin (`same_surface`).
"""

from __future__ import annotations

import numpy as np

from calib_core.types import BoolArray, FloatArray


def same_place(
    normals: FloatArray,
    offsets_m: FloatArray,
    normal: FloatArray,
    centre: FloatArray,
    *,
    within_deg: float,
    within_m: float | FloatArray,
) -> BoolArray:
    """Which planes (P,) a patch may be of: turned by less than within_deg, and within_m from its middle at the most.

    normals: (P, 3), offsets_m: (P,), n . x + w = 0.   normal, centre: (3,) of the patch.   within_m: for all or each.
    """
    return _facing(normals, normal, within_deg) & (np.abs(normals @ centre + offsets_m) < within_m)


def same_points(
    normals: FloatArray, normal: FloatArray, apart_m: FloatArray, *, within_deg: float, within_m: float
) -> BoolArray:
    """Which planes (P,) a patch is of by all of its points: one that lies slantwise, or bends, is farther than its middle.

    normals: (P, 3).   normal: (3,) of the patch.   apart_m: (P,) of its points from each plane, `apart`.
    """
    return _facing(normals, normal, within_deg) & (apart_m < within_m)


def apart(normals: FloatArray, offsets_m: FloatArray, points_m: FloatArray) -> FloatArray:
    """(P,) [m] how far points (N, 3) lie from each plane, root mean square."""
    return np.asarray(np.sqrt(np.mean((points_m @ normals.T + offsets_m) ** 2, axis=0)))


def same_surface(
    normals: FloatArray,
    offsets_m: FloatArray,
    of: tuple[FloatArray, FloatArray],
    *,
    within_deg: float,
    within_m: float,
) -> BoolArray:
    """(P, Q) which planes are those of another set, parallel and near: of a room, seen about the same origin.

    normals: (P, 3), offsets_m: (P,).   of: normals (Q, 3), offsets (Q,).
    """
    return _facing(normals, of[0].T, within_deg) & (np.abs(offsets_m[:, None] - of[1]) < within_m)


def _facing(normals: FloatArray, others: FloatArray, within_deg: float) -> BoolArray:
    return np.asarray(normals @ others > np.cos(np.radians(within_deg)))
