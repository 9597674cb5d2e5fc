"""Arrays that grow at their end, against NumPy's own way of putting parts together."""

from __future__ import annotations

import errno
import mmap
import tempfile
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from calib_core import growing, paged
from calib_core.growing import Growing
from calib_core.types import Float32Array, IntArray
from tests.core.held_pages import held_of_files_kb


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


def _grown(sizes: list[int]) -> tuple[Growing, IntArray]:
    parts = [np.arange(n, dtype=np.int64) + 1000 * k for k, n in enumerate(sizes)]
    grown = Growing("number")
    for part in parts:
        grown.append(Record(part, np.zeros(0, np.float32)))
    return grown, np.concatenate(parts)


def test_what_is_large_lies_in_a_file_and_its_pages_are_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is read after that, and what was written before, is the same. Oracle: what the system says of this process's pages.

    Mutations: never to a file; what was in memory left behind; pages that nobody gives back.
    """
    monkeypatch.setattr(growing, "_IN_MEMORY_BYTES", 64 * 1024)
    monkeypatch.setattr(paged, "_HELD_BYTES", 2 * 2**20)
    grown, expected = _grown([3000, 5000, 200_000, 7, 0, 90_000])
    (number,) = grown.arrays()
    np.testing.assert_array_equal(number, expected)
    number[::1000] = -1
    expected[::1000] = -1
    held_kb = held_of_files_kb()
    paged.heed_pages(2**21 + 1)
    assert held_of_files_kb() <= held_kb - number.nbytes // 1024
    np.testing.assert_array_equal(number, expected)


def test_columns_that_are_large_together_go_to_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones too, from the part on with which they are; none before. Mutations: each column by its own size; the part that is
    about to come not counted.
    """
    parts = [Record(np.full(100, k), np.full((100, 3, 2), k, np.float32)) for k in range(3)]
    n_bytes = 2 * sum(part.number.nbytes + part.moment.nbytes for part in parts[:1])
    monkeypatch.setattr(growing, "_IN_MEMORY_BYTES", n_bytes)
    for count, files in ((2, 0), (3, 2)):
        made: list[object] = []
        in_file = growing._InFile
        monkeypatch.setattr(
            growing, "_InFile", lambda first, made=made, kind=in_file: made.append(first) or kind(first)
        )
        grown = Growing("number", "moment")
        for part in parts[:count]:
            grown.append(part)
        monkeypatch.setattr(growing, "_InFile", in_file)
        assert len(made) == files
        for name, array in zip(("number", "moment"), grown.arrays(), strict=True):
            np.testing.assert_array_equal(array, np.concatenate([getattr(part, name) for part in parts[:count]]))


@pytest.mark.parametrize(("full_at", "number"), [(0, errno.ENOSPC), (1, errno.EDQUOT), (3, errno.EFBIG)])
def test_where_the_disk_is_full_all_stays_in_memory(full_at: int, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the first write on, or later; or a file may not be larger. Mutations: an error; what the file held lost; written to
    the file again; one of the errors for a defect.
    """
    monkeypatch.setattr(growing, "_IN_MEMORY_BYTES", 64 * 1024)
    written: list[int] = []

    class Full:
        def __init__(self) -> None:
            self.file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115

        def close(self) -> None:
            self.file.close()

        def fileno(self) -> int:
            return self.file.fileno()

        def write(self, data: memoryview) -> int:
            written.append(len(data))
            if len(written) > full_at:
                self.file.write(data[:100])
                raise OSError(number, "No space left on device")
            return self.file.write(data)

    monkeypatch.setattr(growing, "tempfile", SimpleNamespace(TemporaryFile=lambda **_: Full()))
    grown, expected = _grown([9000, 5000, 20_000, 7, 90_000])
    np.testing.assert_array_equal(grown.arrays()[0], expected)
    assert len(written) == full_at + 1


def test_another_error_of_the_disk_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: every error taken for a full disk."""
    monkeypatch.setattr(growing, "_IN_MEMORY_BYTES", 1024)

    def broken(**_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(growing, "tempfile", SimpleNamespace(TemporaryFile=broken))
    with pytest.raises(OSError, match="Input/output"):
        _grown([9000, 5000])
