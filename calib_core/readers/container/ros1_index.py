"""ROS 1 bags by their index, through rosbags: bounded where a chunk unpacks, and quick where nothing is compressed.

rosbags takes every record's header apart, field by field, while nothing else in the process can go on. Here the records of a
connection are known by the first one, which rosbags has read: one that differs in more than its time is rosbags' again.
"""

from __future__ import annotations

import copy
import heapq
import struct
from collections.abc import Collection, Generator
from io import BytesIO
from itertools import repeat
from typing import NamedTuple, Self

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader
from rosbags.rosbag1 import reader as ros1

from calib_core.readers.container.compression import bounded_bz2, bounded_lz4

# rosbags unpacks a chunk whole, however large it comes out (7 kB of bz2 become 6.6 GB), and has no setting for it.
_DECOMPRESSORS = {**ros1.decompressors, "bz2": bounded_bz2, "lz4": bounded_lz4}
_BOUNDED = {unbounded: _DECOMPRESSORS[name] for name, unbounded in ros1.decompressors.items()}
_AS_STORED = ros1.decompressors["none"]
#: A record's field of the time, but for the time: its length, its name.
_TIME_FIELD = b"\x0d\x00\x00\x00time="
_TIME, _SIZE = struct.Struct("<LL"), struct.Struct("<L")
_NS_PER_S = 1_000_000_000

_Message = tuple[Connection, int, bytes]


class _Shape(NamedTuple):
    """A record's header with its length, before the time and after it."""

    before: bytes
    after: bytes

    @staticmethod
    def of(chunk: bytes, offset: int) -> _Shape | None:
        """Of the record there, None where it bears no time."""
        end = offset + _SIZE.size + _SIZE.unpack_from(chunk, offset)[0]
        at = chunk.find(_TIME_FIELD, offset, end)
        if at < 0:
            return None
        at += len(_TIME_FIELD)
        return _Shape(chunk[offset:at], chunk[at + _TIME.size : end])

    def payload(self, chunk: bytes, offset: int, time_ns: int) -> bytes | None:
        """What the record there holds, None where it is not of this shape or time, or not all there."""
        at = offset + len(self.before)
        after = at + _TIME.size
        if not (chunk.startswith(self.before, offset) and chunk.startswith(self.after, after)):
            return None
        begin = after + len(self.after) + _SIZE.size
        if begin > len(chunk) or chunk[at:after] != _TIME.pack(*divmod(time_ns, _NS_PER_S)):
            return None
        end = begin + _SIZE.unpack_from(chunk, begin - _SIZE.size)[0]
        return chunk[begin:end] if end <= len(chunk) else None


class Ros1Index(Reader):
    """An indexed bag."""

    def open(self) -> None:
        """Open it and read its index."""
        super().open()
        chunks = self.chunks
        self._as_stored = all(chunk.decompressor is _AS_STORED for chunk in chunks.values())
        chunks.update({k: chunk._replace(decompressor=_BOUNDED[chunk.decompressor]) for k, chunk in chunks.items()})

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[_Message, None, None]:
        """Messages of the connections (of none: of all) with start <= receive time < stop, in receive order.

        Raises what rosbags raises, where it would.
        """
        if not self._as_stored:
            yield from super().messages(connections, start, stop)
            return
        indexes = [zip(self.indexes[known.id], repeat(known)) for known in connections or self.connections]
        rosbags = self._twin()
        shapes: dict[int, _Shape] = {}
        held, chunk = -1, b""
        for entry, connection in heapq.merge(*indexes, key=lambda pair: pair[0].time):
            time_ns, chunk_pos, offset = entry
            if start is not None and time_ns < start:
                continue
            if stop is not None and time_ns >= stop:
                return
            if chunk_pos != held:
                chunk = b""  # let go before the next one is read into its place
                held, chunk = chunk_pos, self._chunk(chunk_pos)
            shape = shapes.get(connection.id)
            payload = None if shape is None else shape.payload(chunk, offset, time_ns)
            if payload is not None:
                yield connection, time_ns, payload
                continue
            rosbags.indexes = {connection.id: [entry]}
            for message in Reader.messages(rosbags, [connection]):
                yield message
                seen = _Shape.of(chunk, offset) if chunk and message[0] is connection else None
                if seen is not None:
                    shapes[connection.id] = seen

    def _twin(self) -> Self:
        """Another reader of the same open file, with a chunk of its own."""
        twin = copy.copy(self)
        twin.current_chunk = (-1, BytesIO())
        return twin

    def _chunk(self, pos: int) -> bytes:
        """A chunk's bytes; none where the file ends before it does."""
        known = self.chunks[pos]
        if self.bio is None:  # closed meanwhile, which rosbags then says
            return b""
        self.bio.seek(known.datapos)
        stored = self.bio.read(known.datasize)
        return stored if len(stored) == known.datasize else b""
