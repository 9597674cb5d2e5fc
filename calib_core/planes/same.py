"""Whether two planes are one: how far they may be turned and lie apart is for whoever asks to say."""

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
