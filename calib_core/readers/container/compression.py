"""Decompression that ends where a limit is reached. zstd is the standard library's where it has it, else its backport."""

from __future__ import annotations

import bz2
import io
import sys
from typing import Protocol

import lz4.frame

from calib_core.readers.container.limits import LIMITS

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ["OversizedChunk", "bounded_bz2", "bounded_lz4", "bounded_zstd", "unpack_bounded", "unpack_first", "zstd"]

#: Asked of a decompressor at once: what it has not yet been asked for takes no memory.
_PIECE = 1 << 20


class OversizedChunk(ValueError):
    """Compressed bytes that unpack to more than any recorder writes."""


class _Decompressor(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def unpack_bounded(decompressor: _Decompressor, stored: bytes, most_bytes: int) -> bytes:
    """What the bytes unpack to, at most `most_bytes`, or OversizedChunk."""
    unpacked = io.BytesIO()  # grows by an eighth at most, and gives its bytes away without a copy
    source = stored
    while not decompressor.eof:
        piece = decompressor.decompress(source, max_length=_PIECE)
        source = b""
        if unpacked.tell() + len(piece) > most_bytes:
            raise OversizedChunk(f"a chunk unpacks to more than {most_bytes / 1e6:.0f} MB")
        unpacked.write(piece)
        if not piece and decompressor.needs_input:
            raise EOFError("a compressed chunk ends early")
    return unpacked.getvalue()


def unpack_first(decompressor: _Decompressor, stored: bytes, most_bytes: int) -> bytes:
    """The first `most_bytes` of what the bytes unpack to, or as much as there is."""
    unpacked = io.BytesIO()
    source = stored
    while not decompressor.eof and unpacked.tell() < most_bytes:
        piece = decompressor.decompress(source, max_length=min(_PIECE, most_bytes - unpacked.tell()))
        source = b""
        unpacked.write(piece)
        if not piece and decompressor.needs_input:
            break
    return unpacked.getvalue()


def bounded_bz2(stored: bytes, most_bytes: int = LIMITS.chunk_bytes) -> bytes:
    """One bz2 stream."""
    return unpack_bounded(bz2.BZ2Decompressor(), stored, _declared(most_bytes))


def bounded_lz4(stored: bytes, most_bytes: int = LIMITS.chunk_bytes) -> bytes:
    """One lz4 frame."""
    return unpack_bounded(lz4.frame.LZ4FrameDecompressor(), stored, _declared(most_bytes))


def bounded_zstd(stored: bytes, most_bytes: int = LIMITS.chunk_bytes) -> bytes:
    """One zstd frame."""
    return unpack_bounded(zstd.ZstdDecompressor(), stored, _declared(most_bytes))


def _declared(most_bytes: int) -> int:
    """The size that is declared, which may itself be too large."""
    if most_bytes > LIMITS.chunk_bytes:
        raise OversizedChunk(f"a chunk says it unpacks to {most_bytes / 1e6:.0f} MB")
    return most_bytes
