"""What a plane is to someone who stands upright: floor, ceiling, wall, or a slope between; and what it is called."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from calib_core.types import FloatArray, Plane

#: What the search for planes calls its finds, which says nothing to a person.
PLAIN_NAME = re.compile(r"plane \d+")

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


def next_name(kind: Kind, taken: Collection[str]) -> str:
    """What one more plane is called: its kind, with the next number where there are some. taken: the names there are."""
    (word,) = names_of([kind])
    if kind == "plane":
        word = "plane"
    elif word not in taken and f"{word} 1" not in taken:
        return word
    return next(
        name for number in itertools.count(1 if kind == "plane" else 2) if (name := f"{word} {number}") not in taken
    )


def called(planes: Sequence[Plane], up: FloatArray, first: int) -> list[Plane]:
    """The planes, those that nobody has named called what they are. up: (3,) unit, in their frame.

    first: so many were found together, and are numbered together; others follow one by one.
    """
    kinds = [kind_of(plane.normal, up)[0] for plane in planes]
    names = names_of(kinds[:first])
    given = {plane.name for plane in planes if not PLAIN_NAME.fullmatch(plane.name)}
    for kind in kinds[first:]:
        names.append(next_name(kind, {*names, *given}))
    return [
        replace(plane, name=name) if PLAIN_NAME.fullmatch(plane.name) else plane
        for plane, name in zip(planes, names, strict=True)
    ]
