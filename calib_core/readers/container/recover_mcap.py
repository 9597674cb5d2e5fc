"""An mcap file read record by record without its summary: cut, unfinished or damaged files, as far as they go.

A record is u8 opcode, u64 size, content. Messages and channels sit in chunks whose checksum, where there is one, must
agree before a message is believed. Files of another profile (ROS 1 messages converted to mcap) are read here too.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import lz4.frame

from calib_core.readers.container.compression import unpack_first, zstd
from calib_core.readers.container.limits import LIMITS
from calib_core.readers.container.storage import (
    Damage,
    RawMessage,
    StorageError,
    TopicSummary,
    foreign_to_ros,
    merged_topics,
    message_itself,
    normalised_type,
)

MAGIC = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES = LIMITS.chunk_bytes
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_KNOWN = range(0x01, 0x10)
#: Of a file's first record that names its profile: more than any profile's name takes.
_HEAD_BYTES = 64


@dataclass(frozen=True, slots=True)
class _Span:
    """A chunk, or one message outside of any chunk.   is_cut: the file ends inside it."""

    pos: int
    size: int
    start_ns: int
    end_ns: int
    is_chunk: bool
    is_cut: bool = False


def _string(content: bytes, pos: int) -> tuple[str, int]:
    (size,) = struct.unpack_from("<I", content, pos)
    end = pos + 4 + size
    if end > len(content):
        raise struct.error("string past the end")
    return content[pos + 4 : end].decode("utf-8", "replace"), end


def _chunk_records(content: bytes, *, cut: bool = False) -> bytes:
    """The records inside a chunk record; raises ValueError where they fail a check.

    cut: the file ends inside this chunk: what is there is its beginning, which no checksum covers.
    """
    _, _, size, checksum = struct.unpack_from("<QQQI", content, 0)
    compression, pos = _string(content, 28)
    (stored_size,) = struct.unpack_from("<Q", content, pos)
    stored = content[pos + 8 : pos + 8 + stored_size]
    if size > MAX_CHUNK_BYTES or (len(stored) != stored_size and not cut):
        raise ValueError("chunk size")
    if compression == "zstd":
        records = unpack_first(zstd.ZstdDecompressor, stored, size + 1)
    elif compression == "lz4":
        records = unpack_first(lz4.frame.LZ4FrameDecompressor, stored, size + 1)
    elif compression == "":
        records = stored
    else:
        raise ValueError(f"compression {compression!r}")
    if cut:
        return records
    if len(records) != size or (checksum and crc32(records) != checksum):
        raise ValueError("chunk checksum")
    return records


def _records(content: bytes) -> Iterator[tuple[int, bytes]]:
    pos = 0
    while pos + 9 <= len(content):
        op, size = struct.unpack_from("<BQ", content, pos)
        if pos + 9 + size > len(content):
            return
        yield op, content[pos + 9 : pos + 9 + size]
        pos += 9 + size


def holds_ros1(path: Path) -> bool:
    """Whether a file says in its first record that it is an mcap with messages of ROS 1, as a converted bag is."""
    with path.open("rb") as file:
        head = file.read(len(MAGIC) + _HEAD_BYTES)
    if not head.startswith(MAGIC):
        return False
    try:
        profile, _ = _string(head, len(MAGIC) + 9)
    except (struct.error, ValueError):
        return False
    return profile == "ros1"


class McapRecovery:
    """An mcap file whose summary or profile rosbags does not accept."""

    def __init__(self, path: Path, reason: str) -> None:
        self._path = path
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, TopicSummary] = {}
        self._counts: dict[int, int] = {}
        self._spans: list[_Span] = []
        self.damages: list[Damage] = []
        self._source = path.open("rb")
        if self._source.read(len(MAGIC)) != MAGIC:
            self._source.close()
            raise StorageError("the file does not start as an mcap file")
        bad_chunks, complete = self._scan(path.stat().st_size)
        self.topics = merged_topics([replace(s, count=self._counts.get(i, 0)) for i, s in self._channels.items()])
        self._spans.sort(key=lambda span: span.start_ns)
        self.start_ns = min((s.start_ns for s in self._spans), default=0)
        self.end_ns = max((s.end_ns for s in self._spans), default=0) + 1
        if bad_chunks:
            self.damages.append(Damage(path.name, f"damaged in {bad_chunks} chunk(s), left out ({reason})", "holes"))
        if not complete:
            self.damages.append(Damage(path.name, f"cut or damaged ({reason})", "cut", self.end_ns))

    def _scan(self, size: int) -> tuple[int, bool]:
        """Every readable chunk and message. Returns how many chunks failed, and whether the data section ended."""
        pos, bad_chunks = len(MAGIC), 0
        while pos + 9 <= size:
            self._source.seek(pos)
            op, record_size = struct.unpack("<BQ", self._source.read(9))
            if op == _DATA_END:
                return bad_chunks, True
            if op == _CHUNK and pos + 9 + record_size > size:
                with suppress(struct.error, ValueError, zstd.ZstdError, RuntimeError):
                    self._visit(
                        op, self._source.read(MAX_CHUNK_BYTES), _Span(pos + 9, size - pos - 9, 0, 0, True, True)
                    )
                return bad_chunks, False
            if op not in _KNOWN or pos + 9 + record_size > size:
                return bad_chunks, False
            if op in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK):
                if record_size > MAX_CHUNK_BYTES:
                    return bad_chunks, False
                content = self._source.read(record_size)
                try:
                    self._visit(op, content, _Span(pos + 9, record_size, 0, 0, op == _CHUNK))
                except (struct.error, ValueError, zstd.ZstdError, RuntimeError):
                    bad_chunks += 1
            pos += 9 + record_size
        return bad_chunks, False

    def _visit(self, op: int, content: bytes, span: _Span) -> None:
        if op == _CHUNK:
            records = _records(_chunk_records(content, cut=span.is_cut))
            inner = [(o, c) for o, c in records if o in (_SCHEMA, _CHANNEL, _MESSAGE)]
            times = [self._define_or_count(o, c) for o, c in inner]
        else:
            times = [self._define_or_count(op, content)]
        stamps = [time_ns for time_ns in times if time_ns is not None]
        if stamps:
            self._spans.append(replace(span, start_ns=min(stamps), end_ns=max(stamps)))

    def _define_or_count(self, op: int, content: bytes) -> int | None:
        """Note a schema or channel; of a message, count it and give its log time."""
        if op == _SCHEMA:
            name, pos = _string(content, 2)
            _, pos = _string(content, pos)
            self._schemas[struct.unpack_from("<H", content)[0]] = name, _string(content, pos)[0]
        elif op == _CHANNEL:
            channel, schema = struct.unpack_from("<HH", content)
            topic, pos = _string(content, 4)
            encoding, _ = _string(content, pos)
            kind, definition = self._schemas.get(schema, ("", ""))
            summary = TopicSummary(
                topic,
                normalised_type(kind),
                0,
                "ros1" if encoding == "ros1" else "cdr",
                definition,
                foreign=foreign_to_ros(encoding),
            )
            self._channels.setdefault(channel, summary)
        elif op == _MESSAGE:
            channel, _, log_ns = struct.unpack_from("<HIQ", content)
            self._counts[channel] = self._counts.get(channel, 0) + 1
            return int(log_ns)
        return None

    def _span_messages(self, span: _Span, wanted: dict[int, str]) -> list[RawMessage]:
        self._source.seek(span.pos)
        content = self._source.read(span.size)
        records = _records(_chunk_records(content, cut=span.is_cut)) if span.is_chunk else iter([(_MESSAGE, content)])
        found: list[RawMessage] = []
        for op, record in records:
            if op == _MESSAGE:
                channel, _, log_ns = struct.unpack_from("<HIQ", record)
                if channel in wanted:
                    found.append(RawMessage(wanted[channel], log_ns, message_itself(record[22:])))
        return sorted(found, key=lambda message: message.receive_ns)

    def messages(self, topics: Collection[str], start_ns: int | None, stop_ns: int | None) -> Iterator[RawMessage]:
        low = 0 if start_ns is None else start_ns
        high = 1 << 63 if stop_ns is None else stop_ns
        wanted = {i: s.name for i, s in self._channels.items() if s.name in topics}
        for span in self._spans:
            if span.end_ns >= low and span.start_ns < high:
                for message in self._span_messages(span, wanted):
                    if low <= message.receive_ns < high:
                        yield message

    def close(self) -> None:
        self._source.close()
