"""A ROS 1 bag read chunk by chunk without its index: unindexed, truncated or damaged files, as far as they go.

The file is a row of records: u32 header size, header fields `name=value` each with a u32 size, u32 data size, data.
Messages and connections sit inside chunk records. After bytes that are no record the search resumes at the next
place that parses as a chunk header.
"""

from __future__ import annotations

import bz2
import heapq
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

import lz4.frame

from calib_core.readers.container.compression import unpack_first
from calib_core.readers.container.limits import LIMITS
from calib_core.readers.container.storage import (
    Damage,
    RawMessage,
    StorageError,
    TopicSummary,
    merged_topics,
    normalised_type,
)
from calib_core.readers.container.wire import NS_PER_S

MAGIC = b"#ROSBAG V2.0\n"
MAX_CHUNK_BYTES = LIMITS.chunk_bytes
MAX_HEADER_BYTES = 1 << 20
_CHUNK_MARK = b"\x04\x00\x00\x00op=\x05"
_SEARCH_BLOCK = 1 << 20


@dataclass(frozen=True, slots=True)
class _Record:
    op: int
    fields: dict[bytes, bytes]
    data_pos: int
    data_size: int


@dataclass(frozen=True, slots=True)
class _Chunk:
    data_pos: int
    data_size: int
    compression: bytes
    start_ns: int
    end_ns: int


def _parse_fields(header: bytes) -> dict[bytes, bytes] | None:
    fields: dict[bytes, bytes] = {}
    pos = 0
    while pos < len(header):
        if pos + 4 > len(header):
            return None
        (size,) = struct.unpack_from("<I", header, pos)
        pos += 4
        name, equals, value = header[pos : pos + size].partition(b"=")
        if not equals or pos + size > len(header):
            return None
        fields[name] = value
        pos += size
    return fields


def _read_record(source: BinaryIO, pos: int, size: int) -> _Record | None:
    """The record at `pos`, or None where there is none. Its data may reach past the end of the file."""
    source.seek(pos)
    head = source.read(4)
    if len(head) < 4:
        return None
    (header_size,) = struct.unpack("<I", head)
    if not 5 <= header_size <= MAX_HEADER_BYTES or pos + 8 + header_size > size:
        return None
    header = source.read(header_size)
    fields = _parse_fields(header)
    tail = source.read(4)
    if fields is None or len(fields.get(b"op", b"")) != 1 or len(tail) < 4:
        return None
    (data_size,) = struct.unpack("<I", tail)
    return _Record(fields[b"op"][0], fields, pos + header_size + 8, data_size)


def _find_chunk(source: BinaryIO, pos: int, size: int) -> int | None:
    """Position of the next chunk record at or after `pos`."""
    while pos < size:
        source.seek(pos)
        block = source.read(_SEARCH_BLOCK + 256)
        at = block.find(_CHUNK_MARK)
        while at >= 0:
            for back in range(4, min(at, 120) + 1):
                record = _read_record(source, pos + at - back, size)
                if record is not None and record.op == 5 and b"compression" in record.fields:
                    return pos + at - back
            at = block.find(_CHUNK_MARK, at + 1)
        pos += _SEARCH_BLOCK
    return None


def _decompressed(compression: bytes, stored: bytes) -> bytes:
    """The chunk's records; of a cut or damaged chunk the part before the damage."""
    if compression == b"none":
        return stored
    make = bz2.BZ2Decompressor if compression == b"bz2" else lz4.frame.LZ4FrameDecompressor
    return unpack_first(make, stored, MAX_CHUNK_BYTES, damage=(OSError, RuntimeError, EOFError))


class Ros1Recovery:
    """A ROS 1 bag whose index cannot be used."""

    def __init__(self, path: Path, reason: str) -> None:
        self._path = path
        self._reason = reason
        self._chunks: list[_Chunk] = []
        self._names: dict[int, TopicSummary] = {}
        self.damages: list[Damage] = []
        self._source = path.open("rb")
        self._size = path.stat().st_size
        if self._source.read(len(MAGIC)) != MAGIC:
            self._source.close()
            raise StorageError("the file does not start as a ROS 1 bag")
        counts: dict[int, int] = {}
        complete = self._scan(counts)
        self.topics = merged_topics([replace(s, count=counts.get(i, 0)) for i, s in self._names.items()])
        self.start_ns = min((c.start_ns for c in self._chunks), default=0)
        self.end_ns = max((c.end_ns for c in self._chunks), default=0) + 1
        if complete:
            self.damages.append(Damage(path.name, "without an index and was read chunk by chunk", "index"))
        else:
            self.damages.append(Damage(path.name, f"cut or damaged ({reason})", "cut", self.end_ns))

    def _scan(self, counts: dict[int, int]) -> bool:
        """Find every chunk and connection; count the messages. True where no byte was out of place."""
        pos = len(MAGIC)
        complete = True
        while pos < self._size:
            record = _read_record(self._source, pos, self._size)
            if record is None or record.op not in (2, 3, 4, 5, 6, 7) or not self._usable(record):
                complete = False
                found = _find_chunk(self._source, pos + 1, self._size)
                if found is None:
                    break
                pos = found
                continue
            if record.op == 5:
                complete &= self._scan_chunk(record, counts)
            elif record.op == 7:
                self._source.seek(record.data_pos)
                self._remember(record.fields, self._source.read(record.data_size))
            pos = record.data_pos + record.data_size
        return complete and pos == self._size

    def _usable(self, record: _Record) -> bool:
        return record.data_size <= (MAX_CHUNK_BYTES if record.op == 5 else MAX_HEADER_BYTES * 16)

    def _scan_chunk(self, record: _Record, counts: dict[int, int]) -> bool:
        compression = record.fields.get(b"compression", b"")
        if compression not in (b"none", b"bz2", b"lz4"):
            return False
        size = min(record.data_size, self._size - record.data_pos)
        start_ns, end_ns = 1 << 62, 0
        for connection, time_ns, payload in self._chunk_messages(record.data_pos, size, compression):
            counts[connection] = counts.get(connection, 0) + 1
            start_ns, end_ns = min(start_ns, time_ns), max(end_ns, time_ns)
            del payload
        if end_ns:
            self._chunks.append(_Chunk(record.data_pos, size, compression, start_ns, end_ns))
        return size == record.data_size

    def _chunk_messages(self, pos: int, size: int, compression: bytes) -> Iterator[tuple[int, int, bytes]]:
        self._source.seek(pos)
        records = _decompressed(compression, self._source.read(size))
        at = 0
        while at + 8 <= len(records):
            (header_size,) = struct.unpack_from("<I", records, at)
            data_at = at + 8 + header_size
            if data_at > len(records):
                return
            fields = _parse_fields(records[at + 4 : data_at - 4])
            (data_size,) = struct.unpack_from("<I", records, data_at - 4)
            # Without a kind it is no record: zeros, which would be taken for millions of them.
            if fields is None or b"op" not in fields or data_at + data_size > len(records):
                return
            op, payload = fields.get(b"op"), records[data_at : data_at + data_size]
            if op == b"\x07":
                self._remember(fields, payload)
            elif op == b"\x02" and len(fields.get(b"conn", b"")) == 4 and len(fields.get(b"time", b"")) == 8:
                seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
                yield struct.unpack("<I", fields[b"conn"])[0], seconds * NS_PER_S + nanoseconds, payload
            at = data_at + data_size

    def _remember(self, fields: dict[bytes, bytes], data: bytes) -> None:
        """A connection record: which topic and type an id stands for."""
        inner = _parse_fields(data)
        if inner is None or b"type" not in inner or len(fields.get(b"conn", b"")) != 4:
            return
        name = "/" * fields.get(b"topic", b"").startswith(b"/") + "/".join(
            part for part in fields.get(b"topic", b"").decode("utf-8", "replace").split("/") if part
        )
        kind = normalised_type(inner[b"type"].decode("utf-8", "replace"))
        definition = inner.get(b"message_definition", b"").decode("utf-8", "replace")
        digest = inner.get(b"md5sum", b"").decode("ascii", "replace")
        summary = TopicSummary(name, kind, 0, "ros1", definition, digest, latching=inner.get(b"latching", b"0") == b"1")
        self._names.setdefault(struct.unpack("<I", fields[b"conn"])[0], summary)

    def messages(self, topics: Collection[str], start_ns: int | None, stop_ns: int | None) -> Iterator[RawMessage]:
        low = 0 if start_ns is None else start_ns
        high = 1 << 63 if stop_ns is None else stop_ns
        wanted = {i: s.name for i, s in self._names.items() if s.name in topics}
        # Chunks may overlap in time by a little (several writers): hold messages back until no later chunk can
        # hold an earlier one.
        pending: list[tuple[int, int, str, bytes]] = []
        order = 0
        chunks = sorted(self._chunks, key=lambda c: c.start_ns)
        for chunk in chunks:
            while pending and pending[0][0] < chunk.start_ns:
                time_ns, _, name, payload = heapq.heappop(pending)
                yield RawMessage(name, time_ns, payload)
            if chunk.end_ns < low or chunk.start_ns >= high:
                continue
            for connection, time_ns, payload in self._chunk_messages(
                chunk.data_pos, chunk.data_size, chunk.compression
            ):
                if connection in wanted and low <= time_ns < high:
                    order += 1
                    heapq.heappush(pending, (time_ns, order, wanted[connection], payload))
        while pending:
            time_ns, _, name, payload = heapq.heappop(pending)
            yield RawMessage(name, time_ns, payload)

    def close(self) -> None:
        self._source.close()
