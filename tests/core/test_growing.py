"""Arrays that grow at their end, against NumPy's own way of putting parts together."""

from __future__ import annotations

import mmap
from dataclasses import dataclass

import numpy as np
import pytest

from calib_core import growing
from calib_core.growing import Growing
from calib_core.types import Float32Array, IntArray


@dataclass(frozen=True)
class Record:
    """Numbers, and rows of another kind."""

    number: IntArray
    moment: Float32Array


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_the_whole_is_all_parts_in_a_row(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Empty ones among them, through several enlargements; what comes out may be changed. Oracle: `np.concatenate`.

    Mutations: each part in the first one's place; two parts taken for one; all of the pages for the array.
    """
    monkeypatch.setattr(growing, "_FIRST_BYTES", mmap.PAGESIZE)
    rng = np.random.default_rng(count)
    sizes = rng.integers(0, 300, count)
    parts = [Record(rng.integers(0, 9, n), rng.normal(size=(n, 3, 2)).astype(np.float32)) for n in sizes]
    grown = Growing("number", "moment")
    for part in parts:
        grown.append(part)
    if count == 0:
        assert grown.arrays() == ()
        return
    number, moment = grown.arrays()
    assert (number.dtype, moment.dtype) == (np.int64, np.float32)
    np.testing.assert_array_equal(number, np.concatenate([part.number for part in parts]))
    np.testing.assert_array_equal(moment, np.concatenate([part.moment for part in parts]))
    moment[:] = 1.0
    assert moment.sum() == moment.size


def test_parts_of_another_kind_of_number_are_taken_as_the_first() -> None:
    """Mutation: bytes as they are."""
    grown = Growing("number")
    for number in (np.arange(3), np.arange(2, dtype=np.int32)):
        grown.append(Record(number, np.zeros(0, np.float32)))
    assert grown.arrays()[0].tolist() == [0, 1, 2, 0, 1]
