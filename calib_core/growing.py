"""Arrays that grow at their end: what many scans leave is put in place as it comes, and is never there twice.

Put together from a list, parts and whole are there at once, and the parts leave holes in the heap that nothing fits into later.
Of a long recording what is put together lies in an unnamed temporary file, whose pages are given back (`calib_core/paged.py`).
"""

from __future__ import annotations

import mmap
import tempfile
import weakref
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_core.errors import is_for_want_of_room
from calib_core.paged import give_back

#: Room for the first parts; each time there is too little, twice as much.
_FIRST_BYTES = 2**20
#: What is larger, all columns together, goes to files, which takes four times as long: that of a minute or two.
_IN_MEMORY_BYTES = 64 * 2**20


class Growing:
    """Some arrays of records of one kind, each (N, ..), one record's after another's."""

    def __init__(self, *names: str) -> None:
        self._names, self._parts = names, 0
        self._alone: tuple[NDArray[Any], ...] = ()
        self._columns: tuple[_Column, ...] = ()

    def append(self, record: object) -> None:
        """Put these arrays of a record behind those of all before."""
        parts = tuple(np.asarray(getattr(record, name)) for name in self._names)
        self._parts += 1
        if self._parts == 1:
            self._alone = parts
            return
        if not self._columns:
            self._columns = tuple(_Column(part) for part in self._alone)
            self._alone = ()
        data = [column.octets(part) for column, part in zip(self._columns, parts, strict=True)]
        large = sum(column.size for column in self._columns) + sum(map(len, data)) > _IN_MEMORY_BYTES
        for column, own in zip(self._columns, data, strict=True):
            column.append(own, to_file=large)

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The whole, by name, () where no record came; nothing can be appended then. Of one record its own arrays."""
        return self._alone if self._parts <= 1 else tuple(column.array() for column in self._columns)


class _Column:
    """One array: in memory while it is small, then in a file; in memory again where the disk is full."""

    def __init__(self, first: NDArray[Any]) -> None:
        self._dtype, self._row = first.dtype, first.shape[1:]
        self._store: _InMemory | _InFile = _InMemory(self.octets(first))
        self._has_disk = True

    @property
    def size(self) -> int:
        """Octets so far."""
        return self._store.size

    def octets(self, part: NDArray[Any]) -> memoryview:
        """(N,) of a part, as numbers of the first one's kind: where they lie, if they are that already."""
        return np.ascontiguousarray(part, self._dtype).reshape(-1).view(np.uint8).data

    def append(self, data: memoryview, *, to_file: bool) -> None:
        """to_file: all of it, from now on."""
        if self._has_disk and to_file and self._store.size:  # an empty file has no pages
            try:
                if isinstance(self._store, _InMemory):
                    self._store = _InFile(self._store.octets())
                self._store.append(data)
                return
            except OSError as error:
                if not is_for_want_of_room(error):
                    raise
                self._has_disk = False
                if isinstance(self._store, _InFile):
                    self._store = _InMemory(self._store.octets())
        self._store.append(data)

    def array(self) -> NDArray[Any]:
        count = self._store.size // self._dtype.itemsize
        return np.frombuffer(self._store.pages(), self._dtype, count).reshape(-1, *self._row)


class _InMemory:
    """Octets in pages of their own beside the heap: the system moves them where it needs more, and has them back at the end."""

    def __init__(self, first: memoryview) -> None:
        self._pages = mmap.mmap(-1, _FIRST_BYTES, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self.size = 0
        self.append(first)

    def append(self, data: memoryview) -> None:
        end = self.size + len(data)
        if end > len(self._pages):
            self._pages.resize(max(end, 2 * len(self._pages)))
            if hasattr(
                mmap, "MADV_HUGEPAGE"
            ):  # a quarter of the time: a page is made at its first touch, and these are larger
                with suppress(OSError):  # of a system without
                    self._pages.madvise(mmap.MADV_HUGEPAGE)
        self._pages[self.size : end] = data
        self.size = end

    def pages(self) -> mmap.mmap:
        return self._pages

    def octets(self) -> memoryview:
        return memoryview(self._pages)[: self.size]


class _InFile:
    """Octets in an unnamed temporary file, which vanishes with the last array over it."""

    def __init__(self, first: memoryview) -> None:
        self._file = tempfile.TemporaryFile(prefix="unsweep-moments-", buffering=0)  # noqa: SIM115 - lives as long as it is mapped
        weakref.finalize(self, self._file.close)
        self.size = 0
        self.append(first)

    def append(self, data: memoryview) -> None:
        rest = data
        while rest:
            rest = rest[self._file.write(rest) :]
        self.size += len(data)

    def pages(self) -> mmap.mmap:
        return give_back(mmap.mmap(self._file.fileno(), self.size))

    def octets(self) -> memoryview:
        return memoryview(self.pages())
