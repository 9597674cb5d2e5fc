"""A bounds-checked cursor over one serialized ROS message, ROS 1 and CDR (ROS 2) alike.

ROS 1 packs members without gaps. CDR puts 4 bytes of encapsulation first, aligns every primitive to its own size
counted from after them, and ends strings with a NUL that the length includes.
"""

from __future__ import annotations

import struct
from typing import Literal

Encoding = Literal["ros1", "cdr"]

#: Longest frame id or field name that is believed; longer means the bytes are not what the type says.
MAX_STRING_BYTES = 4096
NS_PER_S = 1_000_000_000


class MalformedMessage(ValueError):
    """The bytes are not a message of the declared type. Counted and reported by the loader, never shown raw."""


class Wire:
    """A cursor; every read moves it and raises MalformedMessage where the bytes end too early."""

    __slots__ = ("_base", "_order", "buffer", "encoding", "pos")

    def __init__(self, payload: bytes | bytearray | memoryview, encoding: Encoding) -> None:
        self.buffer = memoryview(payload)
        self.encoding = encoding
        self._order = "<"
        self.pos = 0
        self._base = 0
        if encoding == "cdr":
            if len(self.buffer) < 4 or self.buffer[0] != 0 or self.buffer[1] not in (0, 1):
                raise MalformedMessage("no CDR encapsulation header")
            self._order = "<" if self.buffer[1] == 1 else ">"
            self.pos = self._base = 4

    @property
    def order(self) -> str:
        """Byte order as struct and NumPy write it: "<" or ">"."""
        return self._order

    @property
    def remaining(self) -> int:
        """Bytes not yet read."""
        return len(self.buffer) - self.pos

    def align(self, size: int) -> None:
        """Skip CDR's padding before a primitive of `size` bytes; nothing in ROS 1."""
        if self.encoding == "cdr":
            self.pos += -(self.pos - self._base) % size

    def unpack(self, code: str, size: int) -> int | float:
        """One primitive of struct's format `code`."""
        self.align(size)
        end = self.pos + size
        if end > len(self.buffer):
            raise MalformedMessage(f"message ends after {len(self.buffer)} bytes, {end} needed")
        values: tuple[int | float] = struct.unpack_from(self._order + code, self.buffer, self.pos)
        self.pos = end
        return values[0]

    def u8(self) -> int:
        return int(self.unpack("B", 1))

    def u32(self) -> int:
        return int(self.unpack("I", 4))

    def i32(self) -> int:
        return int(self.unpack("i", 4))

    def u64(self) -> int:
        return int(self.unpack("Q", 8))

    def view(self, size: int) -> memoryview:
        """The next `size` bytes, not copied."""
        if size < 0 or size > self.remaining:
            raise MalformedMessage(f"{size} bytes declared, {self.remaining} left")
        part = self.buffer[self.pos : self.pos + size]
        self.pos += size
        return part

    def string(self) -> str:
        """A string; undecodable bytes are replaced, an absurd length refused."""
        size = self.u32()
        if size > MAX_STRING_BYTES:
            raise MalformedMessage(f"string of {size} bytes")
        return bytes(self.view(size)).rstrip(b"\0").decode("utf-8", "replace")

    def stamp_ns(self) -> int:
        """Builtin time: seconds and nanoseconds, as int64 nanoseconds."""
        seconds = self.u32() if self.encoding == "ros1" else self.i32()
        nanoseconds = self.u32()
        if nanoseconds >= NS_PER_S:
            raise MalformedMessage(f"stamp with {nanoseconds} ns past the second")
        return seconds * NS_PER_S + nanoseconds

    def header(self) -> tuple[int, str]:
        """std_msgs/Header: stamp in ns, frame id."""
        if self.encoding == "ros1":
            self.u32()  # seq, dropped in ROS 2
        stamp_ns = self.stamp_ns()
        return stamp_ns, self.string()
