"""Answers that are kept for who asks the same again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.full.initialise.memoised import memoised
from calib_core.types import FloatArray


@dataclass(frozen=True)
class _Record:
    one: FloatArray
    other: FloatArray


def test_the_same_arrays_are_answered_once_and_others_anew() -> None:
    """By what they hold, not by which they are. Mutations: the shape left out; records told apart by their first array; the
    answers of all time kept; an answer of the array before.
    """
    asked: list[float] = []

    @memoised
    def total(record: _Record, more: FloatArray) -> float:
        asked.append(float(record.one.sum() + record.other.sum() + more.sum()))
        return asked[-1]

    one, two = np.arange(6.0), np.ones(3)
    for _ in range(3):
        assert total(_Record(one.copy(), two), one[::2]) == 24.0
    assert len(asked) == 1
    assert total(_Record(one, 2.0 * two), one[::2]) == 27.0
    assert total(_Record(one.reshape(2, 3), 2.0 * two), one[::2]) == 27.0
    assert len(asked) == 3
    two[:] = 5.0
    assert total(_Record(one, two), one[::2]) == 36.0
    assert total(_Record(one, np.ones(3)), one[::2]) == 24.0
    assert len(asked) == 5
    total(_Record(one, np.ones(3)), one[::2])
    total(_Record(one, two), one[::2])
    assert len(asked) == 5
