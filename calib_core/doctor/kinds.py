"""What a plane is to someone who stands upright: floor, ceiling, wall, or a slope between."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Literal

import numpy as np

from calib_core.types import FloatArray

Kind = Literal["floor", "ceiling", "wall", "slanted", "plane"]

#: Steeper than this no floor, and leaning more than this no wall.
_LEVEL_DEG = 25.0
_UPRIGHT_DEG = 65.0


def kind_of(normal: FloatArray, up: FloatArray | None) -> tuple[Kind, float | None]:
    """The kind, and the tilt [deg] against the horizontal. normal: (3,) towards the lidar.   up: (3,) unit; None: unknown.

    The tilt is rounded where it is shown: what is rounded twice is not what the page shows, which knows it as it is.
    """
    if up is None:
        return "plane", None
    upward = float(normal @ up)
    tilt = float(np.degrees(np.arccos(min(abs(upward), 1.0))))
    if tilt < _LEVEL_DEG:
        return ("floor" if upward > 0 else "ceiling"), tilt
    return ("wall" if tilt > _UPRIGHT_DEG else "slanted"), tilt


def names_of(kinds: Sequence[Kind]) -> list[str]:
    """A name for each: what it is, numbered in their order where there are several of a kind."""
    several = {kind for kind, count in Counter(kinds).items() if count > 1 or kind == "plane"}
    seen: Counter[Kind] = Counter()
    names = []
    for kind in kinds:
        seen[kind] += 1
        word = "slope" if kind == "slanted" else kind
        names.append(f"{word} {seen[kind]}" if kind in several else word)
    return names
