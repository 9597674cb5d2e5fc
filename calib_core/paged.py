"""Large arrays in unnamed temporary files, whose pages are given back from time to time.

Some arrays of a long recording are gone through again and again, part after part, and would be most of what a solve holds. They
lie in files without a name, which vanish with the last array over them. Whoever goes through such an array says so
(`heed_pages`), and after so many bytes the pages of all of them are given back: they stay in the system's cache for as long as
it has room, but count as nobody's. Where the disk has no room, all of it stays in memory.
"""

from __future__ import annotations

import errno
import math
import mmap
import os
import tempfile
import threading
import weakref
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from calib_core.errors import NO_ROOM
from calib_core.types import FloatArray

#: Arrays that are smaller, or what is put away together, stay in memory: those of a minute or two.
_IN_MEMORY_BYTES = 12 * 2**20
#: So much is gone through before the pages of all files are given back.
_HELD_BYTES = 32 * 2**20
#: What is put away on a shelf shares files of this size.
_SHELF_BYTES = 8 * 2**20
#: Where an array may begin in such a file: on a line of the processor's cache.
_LINE_BYTES = 64
#: A file system that reserves no room ahead is none to write to by its pages: where it is full, there is nobody to tell.
_NO_FILE = NO_ROOM | {errno.EOPNOTSUPP, errno.EINVAL}


def paged(*shapes: tuple[int, ...]) -> tuple[FloatArray, ...]:
    """Zeros of each of these shapes, which share a file where they are large together."""
    sizes = [math.prod(shape) for shape in shapes]
    n_bytes = sum(sizes) * np.dtype(np.float64).itemsize
    pages = None if n_bytes <= _IN_MEMORY_BYTES else _pages_of_a_file(n_bytes)
    if pages is None:
        return tuple(np.zeros(shape) for shape in shapes)
    parts = np.split(np.frombuffer(pages, np.float64), np.cumsum(sizes)[:-1])
    return tuple(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True))


def set_aside(array: NDArray[Any]) -> NDArray[Any]:
    """The same array (..); a copy of it where it is large."""
    pages = None if array.nbytes <= _IN_MEMORY_BYTES else _pages_of_a_file(array.nbytes)
    if pages is None:
        return array
    out = np.frombuffer(pages, array.dtype, array.size).reshape(array.shape)
    out[...] = array
    heed_pages(array.nbytes)
    return out


class Shelf:
    """Many small arrays side by side. Threads may ask for room at the same time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._put_bytes = 0
        self._pages: mmap.mmap | None = None
        self._at = 0

    def put(self, array: NDArray[Any]) -> NDArray[Any]:
        """A copy (..) of an array."""
        out = self.room(array.shape, array.dtype)
        out[...] = array
        return out

    def room(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """An array (..) to be filled."""
        size, kind = math.prod(shape), np.dtype(dtype)
        n_bytes = size * kind.itemsize
        with self._lock:
            self._put_bytes += n_bytes
            if self._put_bytes <= _IN_MEMORY_BYTES or not 0 < n_bytes <= _SHELF_BYTES:
                return np.empty(shape, kind)
            if self._pages is None or self._at + n_bytes > len(self._pages):
                self._pages, self._at = _pages_of_a_file(_SHELF_BYTES), 0
            if self._pages is None:
                return np.empty(shape, kind)
            at = self._at
            self._at += -(-n_bytes // _LINE_BYTES) * _LINE_BYTES
            return np.frombuffer(self._pages, kind, size, at).reshape(shape)


def _pages_of_a_file(n_bytes: int) -> mmap.mmap | None:
    """So many zeros; None where the disk has no room for them."""
    if not hasattr(os, "posix_fallocate"):  # macOS has none
        return None
    try:
        with tempfile.TemporaryFile(prefix="unsweep-arrays-", buffering=0) as file:
            os.posix_fallocate(file.fileno(), 0, n_bytes)
            return give_back(mmap.mmap(file.fileno(), n_bytes))
    except OSError as error:
        if error.errno not in _NO_FILE:
            raise
        return None


#: Arrays that lie in files.
_mapped: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()


class _Held:
    """How much was gone through since pages were given back last: roughly, as threads do not wait for one another to count."""

    n_bytes = 0


def give_back(pages: mmap.mmap) -> mmap.mmap:
    """These pages of a file, to be given back with all others from now on."""
    _mapped.add(pages)
    return pages


def heed_pages(n_bytes: int) -> None:
    """Told by whoever goes through so much of arrays that may lie in files: pages that were read long ago are given back.

    Nothing is lost, and who still reads there gets them from the system's cache: they are the files' own.
    """
    if not _mapped:
        return
    _Held.n_bytes += n_bytes
    if _Held.n_bytes > _HELD_BYTES:
        _Held.n_bytes = 0
        for pages in list(_mapped):
            pages.madvise(mmap.MADV_DONTNEED)
