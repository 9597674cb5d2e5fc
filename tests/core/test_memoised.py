"""Answers that are kept for who asks the same again."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from calib_core.full.prepare import clocks
from calib_core.memoised import memoised, told_once
from calib_core.readers.scans import StoredScans
from calib_core.types import POINT_DTYPE, FloatArray, PointArray, Scan


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


def _stored(count: int) -> StoredScans:
    scans = StoredScans()
    for k in range(count):
        scans.append(Scan(k, k, np.zeros(k + 1, POINT_DTYPE)))
    return scans.finish()


def test_scans_on_disk_are_asked_once_for_as_long_as_they_are_there() -> None:
    """Those of a list each time: anybody may change it. Mutations: any sequence taken for one that stays; the answers of one
    recording given for another's; arguments' names, or one that is nothing, left out of what was asked; scans held for good.
    """
    asked: list[int] = []

    @told_once
    def points(scans: Sequence[Scan], every: int, most: int | None = None, least: int | None = None) -> int:
        asked.append(every)
        total = max(sum(len(scan.points) for scan in scans[::every]), least or 0)
        return total if most is None else min(total, most)

    one, other = _stored(4), _stored(5)
    for _ in range(2):
        assert (points(one, 1), points(other, 1), points(one, 2)) == (10, 15, 4)
    assert len(asked) == 3
    assert (points(one, 1, most=20), points(one, 1, least=20)) == (10, 20)
    few = list(one)
    assert points(few, 1) == 10
    few.pop()
    assert points(few, 1) == 6
    gone = weakref.ref(one)
    del one
    gc.collect()
    assert gone() is None


def test_what_cannot_be_told_apart_is_no_argument() -> None:
    """An object's array would be that of its address. Mutation: not looked at."""
    with pytest.raises(TypeError, match="but found object"):
        memoised(lambda _: 0)(object())


def test_a_second_solve_looks_at_no_scan_for_the_first_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the scans tell by themselves the first solve has been told. Mutation: `told_once` taken from `clocks._look`."""
    looked: list[int] = []
    look_at = clocks._look_at

    def counted(clouds: Sequence[PointArray], period_s: float) -> object:
        looked.append(len(clouds))
        return look_at(clouds, period_s)

    monkeypatch.setattr(clocks, "_look_at", counted)
    scans, stamps_ns = _stored(6), np.arange(6) * 100_000_000
    seen = [clocks._look(scans, stamps_ns.copy(), 0.1) for _ in range(2)]
    assert sum(looked) == 6
    assert list(seen[1].points) == [1, 2, 3, 4, 5, 6]
