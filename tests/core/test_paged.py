"""Large arrays in unnamed files: as arrays in memory, but that their pages are given back."""

from __future__ import annotations

import errno
import gc
import mmap
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calib_core import paged as module
from calib_core.paged import Shelf, heed_pages, paged, set_aside
from calib_core.types import POINT_DTYPE
from tests.core.held_pages import held_of_files_kb

_SHAPES = (20_000, 3, 3), (0, 3), (20_000, 9), (7,)


def test_large_arrays_are_zeros_apart_from_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """In memory and in a file, by so much as a byte. Mutations: all of them at the file's beginning; never a file; always."""
    n_bytes = 8 * sum(int(np.prod(shape)) for shape in _SHAPES)
    for limit, in_file in ((n_bytes, False), (n_bytes - 1, True)):
        monkeypatch.setattr(module, "_IN_MEMORY_BYTES", limit)
        before_kb = held_of_files_kb()
        arrays = paged(*_SHAPES)
        assert [each.shape for each in arrays] == [*_SHAPES]
        assert not any(each.any() for each in arrays)
        for k, each in enumerate(arrays):
            each[:] = k + np.arange(each.size).reshape(each.shape)
        for k, each in enumerate(arrays):
            np.testing.assert_array_equal(each.ravel(), k + np.arange(each.size))
        assert (held_of_files_kb() - before_kb >= n_bytes // 1024) == in_file
        del arrays, each


def test_pages_are_given_back_after_so_much_and_nothing_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: pages never given back; each time that they are gone through."""
    monkeypatch.setattr(module, "_IN_MEMORY_BYTES", 0)
    monkeypatch.setattr(module, "_HELD_BYTES", 2 * 2**20)
    monkeypatch.setattr(module._Held, "n_bytes", 0)
    (numbers,) = paged((300_000,))
    numbers[:] = np.arange(300_000)
    held_kb = held_of_files_kb()
    heed_pages(2**20)
    assert held_of_files_kb() == held_kb
    heed_pages(2**20 + 1)
    assert held_of_files_kb() <= held_kb - numbers.nbytes // 1024
    numbers[::1000] *= -1.0
    heed_pages(2**21 + 1)
    np.testing.assert_array_equal(np.abs(numbers), np.arange(300_000))
    assert (numbers < 0).sum() == 299


@pytest.mark.parametrize("of", [np.arange(40_000), np.arange(40_000.0).reshape(-1, 4)[::2], np.ones((0, 3))])
def test_what_is_set_aside_is_the_same_in_a_file(of: NDArray[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Where it is large; else it is the array itself. Mutations: zeros; numbers of another kind; small ones in files too."""
    monkeypatch.setattr(module, "_IN_MEMORY_BYTES", of.nbytes)
    assert set_aside(of) is of
    monkeypatch.setattr(module, "_IN_MEMORY_BYTES", max(of.nbytes - 1, 0))
    before_kb = held_of_files_kb()
    kept = set_aside(of)
    np.testing.assert_array_equal(kept, of)
    assert (kept.dtype, kept.shape) == (of.dtype, of.shape)
    assert (held_of_files_kb() > before_kb) == (of.size > 0)


def test_what_is_put_on_a_shelf_stays_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of several kinds, every second of some, and such as are larger than the shelf's files, or empty; in files after the first.

    Mutations: the array itself instead of a copy; each at a file's beginning; where an array begins counted in numbers.
    """
    monkeypatch.setattr(module, "_IN_MEMORY_BYTES", 5000)
    monkeypatch.setattr(module, "_SHELF_BYTES", 4 * mmap.PAGESIZE)
    rng, shelf, before_kb = np.random.default_rng(0), Shelf(), held_of_files_kb()
    given, put = [], []
    for n in (100, 0, 1, 333, 900, 5000, 40, 700):
        points = np.zeros(n, POINT_DTYPE)
        points["xyz"], points["offset_ns"] = rng.normal(size=(n, 3)), rng.integers(0, 9, n)
        for each in (points[::2], rng.normal(size=(n, 2)), rng.integers(0, 9, n).astype(np.uint16)):
            given.append(each.copy())
            put.append(shelf.put(each))
            each[:] = np.zeros((), each.dtype)
    for one, other in zip(given, put, strict=True):
        np.testing.assert_array_equal(one, other)
        assert (one.dtype, one.shape) == (other.dtype, other.shape)
    assert held_of_files_kb() > before_kb
    put.clear()
    del other
    shelf = Shelf()
    gc.collect()
    assert held_of_files_kb() == before_kb


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EOPNOTSUPP])
def test_where_the_disk_has_no_room_all_of_it_is_in_memory(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: an error; a file that has no room of its own, which would be the end of the process at the first full page."""
    monkeypatch.setattr(module, "_IN_MEMORY_BYTES", 0)

    def full(*_: int) -> None:
        raise OSError(number, "no room")

    monkeypatch.setattr(module.os, "posix_fallocate", full)
    before_kb = held_of_files_kb()
    one, other = paged((40_000,), (3, 3))
    one[:], other[:] = 1.0, 2.0
    kept = Shelf().put(np.arange(9.0))
    assert (one.sum(), other.sum(), kept.sum()) == (40_000.0, 18.0, 36.0)
    assert held_of_files_kb() == before_kb


def test_another_error_of_the_disk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: every error taken for a full disk."""
    monkeypatch.setattr(module, "_IN_MEMORY_BYTES", 0)

    def broken(*_: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(module.os, "posix_fallocate", broken)
    with pytest.raises(OSError, match="Input/output"):
        paged((9,))
