"""Arrays that grow at their end: what many scans leave is put in place as it comes, and is never there twice.

Put together from a list, parts and whole are there at once, and the parts leave holes in the heap that nothing fits into later.
"""

from __future__ import annotations

import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Room for the first parts; each time there is too little, twice as much.
_FIRST_BYTES = 2**20


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
        for column, part in zip(self._columns, parts, strict=True):
            column.append(part)

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """The whole, by name, () where no record came; nothing can be appended then. Of one record its own arrays."""
        return self._alone if self._parts <= 1 else tuple(column.array() for column in self._columns)


class _Column:
    """One array, in pages of its own beside the heap: the system moves them where it needs more, and has them back at the end."""

    def __init__(self, first: NDArray[Any]) -> None:
        self._dtype, self._row = first.dtype, first.shape[1:]
        self._used = 0
        self._pages = mmap.mmap(-1, _FIRST_BYTES, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self.append(first)

    def append(self, part: NDArray[Any]) -> None:
        data = np.ascontiguousarray(part, self._dtype).tobytes() if part.size else b""
        end = self._used + len(data)
        if end > len(self._pages):
            self._pages.resize(max(end, 2 * len(self._pages)))
        self._pages[self._used : end] = data
        self._used = end

    def array(self) -> NDArray[Any]:
        count = self._used // self._dtype.itemsize
        return np.frombuffer(self._pages, self._dtype, count).reshape(-1, *self._row)
