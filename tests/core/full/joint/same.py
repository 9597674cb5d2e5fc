"""Whether two records are the same to the last digit."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np


def same(one: object, other: object) -> bool:
    """Whether two values are the same all the way down, types included."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    return one == other
