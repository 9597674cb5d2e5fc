"""A tar's bytes on their way to the library that reads them, which believes whatever size a header claims."""

from __future__ import annotations

import io
import tarfile
from typing import IO


class BoundedStream(io.RawIOBase):
    """The bytes of `source`: refused where one read asks for more than `longest_read`, or goes past `most_bytes`.

    tarfile reads every header with a single read of the size it declares: names and attributes of gigabytes end here.
    Getting past a member that nobody wants means unpacking it: a seek counts like a read.
    """

    def __init__(self, source: IO[bytes], *, longest_read: int, most_bytes: int) -> None:
        self._source = source
        self._longest_read = longest_read
        self._most_bytes = most_bytes

    def read(self, size: int = -1, /) -> bytes:
        """The next bytes."""
        if not 0 <= size <= self._longest_read:
            raise tarfile.ReadError(f"a header of {size} bytes")
        self._check_end(self._source.tell() + size)
        return self._source.read(size)

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Go to a place."""
        if whence == io.SEEK_SET:
            self._check_end(offset)
        return self._source.seek(offset, whence)

    def tell(self) -> int:
        """Where it is."""
        return self._source.tell()

    def readable(self) -> bool:
        """It is."""
        return True

    def seekable(self) -> bool:
        """It is."""
        return True

    def _check_end(self, end: int) -> None:
        if end > self._most_bytes:
            raise tarfile.ReadError("it unpacks to more than there is room for, or than a recording does")
