"""Colours that colour-blind people can tell apart: eight hues for planes, a sequential and a diverging scale.

The hues are those of Okabe and Ito (2008) without black. The sequential scale runs from dark blue to bright yellow,
so lightness alone carries it; the diverging one from blue through near-white, or near-black on a light background, to orange.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib_core.types import Float32Array

Colors = NDArray[np.uint8]
Rgb = tuple[int, int, int]

PLANE_HUES: tuple[Rgb, ...] = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (86, 180, 233),
    (213, 94, 0),
    (240, 228, 66),
)
NO_PLANE: Rgb = (140, 140, 145)
RAW: Rgb = (213, 94, 0)
DESKEWED: Rgb = (0, 114, 178)
OLD: Rgb = (204, 121, 167)
PATH: Rgb = (0, 158, 115)

#: How much of its colour something dropped keeps.
FAINT_SHARE = 0.3

_SEQUENTIAL = np.array(
    [(20, 30, 100), (60, 90, 140), (120, 125, 125), (190, 165, 85), (253, 231, 55)], dtype=np.float64
)
#: By whether the background is dark: the middle has to stand off it, for what is right would be drawn in the background's colour.
_DIVERGING = {
    True: np.array([(0, 90, 170), (110, 170, 215), (235, 235, 230), (240, 170, 90), (200, 80, 0)], dtype=np.float64),
    False: np.array([(0, 110, 225), (20, 75, 140), (45, 48, 52), (130, 70, 20), (205, 80, 0)], dtype=np.float64),
}
#: What the middle is called.
ZERO = {True: "white", False: "black"}


def plane_rgb(place: int) -> Rgb:
    """The colour at a place of the palette; after one round the hues come again, darker."""
    hue, rounds = PLANE_HUES[place % len(PLANE_HUES)], place // len(PLANE_HUES)
    darker = 0.65**rounds
    return round(hue[0] * darker), round(hue[1] * darker), round(hue[2] * darker)


def plane_hex(place: int) -> str:
    """The colour at a place of the palette, as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*plane_rgb(place))


def faint(rgb: Rgb) -> Rgb:
    """A trace of the colour: near enough to grey to recede, not so near that it is lost which plane it was."""
    red, green, blue = (
        round(FAINT_SHARE * part + (1 - FAINT_SHARE) * grey) for part, grey in zip(rgb, NO_PLANE, strict=True)
    )
    return red, green, blue


def by_label(labels: NDArray[np.int16], hues: Sequence[Rgb]) -> Colors:
    """(N, 3) colours of points by their patch. labels: (N,), -1 for none.   hues: the colour of each patch."""
    table = np.array([*hues, NO_PLANE], dtype=np.uint8)
    colors: Colors = table[labels]
    return colors


def sequential(values: Float32Array, low: float, high: float) -> Colors:
    """(N, 3) colours of values (N,) between low and high; what is outside takes the end's colour."""
    return _scale(_SEQUENTIAL, values, low, high)


def diverging(values: Float32Array, half: float, *, dark: bool = True) -> Colors:
    """(N, 3) colours of signed values (N,) between -half and half; NaN is grey. dark: the background is."""
    return _scale(_DIVERGING[dark], values, -half, half)


def uniform(count: int, rgb: Rgb) -> Colors:
    """(N, 3) of one colour."""
    return np.broadcast_to(np.array(rgb, dtype=np.uint8), (count, 3)).copy()


def lit(rgb: Colors, lightness: Float32Array) -> Colors:
    """(N, 3) colours, each so much lighter or darker: what gives flat colours depth. lightness: (N,), 1 leaves as it is."""
    lighter: Colors = np.clip(rgb * lightness[:, None], 0.0, 255.0).astype(np.uint8)
    return lighter


def _scale(table: NDArray[np.float64], values: Float32Array, low: float, high: float) -> Colors:
    width = high - low if high > low else 1.0
    place = np.clip((values.astype(np.float64) - low) / width, 0.0, 1.0) * (len(table) - 1)
    known = np.isfinite(place)
    place = np.where(known, place, 0.0)
    below = np.minimum(place.astype(np.int64), len(table) - 2)
    share = (place - below)[:, None]
    colors = np.round(table[below] * (1 - share) + table[below + 1] * share).astype(np.uint8)
    colors[~known] = NO_PLANE
    return colors
