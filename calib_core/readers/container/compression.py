"""Decompression that ends where a limit is reached. zstd is the standard library's where it has it, else its backport."""

from __future__ import annotations

import bz2
import io
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Protocol

import lz4.frame

from calib_core.readers.container.limits import LIMITS

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = [
    "OversizedChunk",
    "bounded_bz2",
    "bounded_lz4",
    "bounded_zstd",
    "pieces",
    "unpack_bounded",
    "unpack_first",
    "zstd",
]

#: Asked of a decompressor at once: what it has not yet been asked for takes no memory.
_PIECE = 1 << 20
#: Given to one at once: what follows the end of a frame is copied for the next, and a file may be nothing but ends.
_GIVEN = 1 << 16


class OversizedChunk(ValueError):
    """Compressed bytes that unpack to more than any recorder writes."""


class _Decompressor(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    @property
    def unused_data(self) -> bytes | None: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def pieces(make: Callable[[], _Decompressor], read: Callable[[int], bytes]) -> Iterator[bytes]:
    """What compressed bytes unpack to, piece by piece; EOFError where they end early.

    make: the decompressor of one frame. Others may follow it: joined files have several, and so do those of compressors that
    work on several cores or can be read from the middle.   read: gives so many of the bytes, fewer or none at the end.
    """
    one, given = make(), read(_GIVEN)
    while True:
        piece = one.decompress(given, max_length=_PIECE)
        given = b""
        if piece:
            yield piece
        if one.eof:
            given = one.unused_data or read(_GIVEN)
            if not given:
                return
            one = make()
        elif one.needs_input:
            given = read(_GIVEN)
            if not given:
                raise EOFError("compressed bytes end early")


def unpack_bounded(make: Callable[[], _Decompressor], stored: bytes, most_bytes: int) -> bytes:
    """What the bytes unpack to, at most `most_bytes`, or OversizedChunk. make: as in `pieces`."""
    unpacked = io.BytesIO()  # grows by an eighth at most, and gives its bytes away without a copy
    for piece in pieces(make, io.BytesIO(stored).read):
        if unpacked.tell() + len(piece) > most_bytes:
            raise OversizedChunk(f"a chunk unpacks to more than {most_bytes / 1e6:.0f} MB")
        unpacked.write(piece)
    return unpacked.getvalue()


def unpack_first(
    make: Callable[[], _Decompressor],
    stored: bytes,
    most_bytes: int,
    *,
    damage: tuple[type[Exception], ...] = (EOFError,),
) -> bytes:
    """The first `most_bytes` of what the bytes unpack to, or as much as there is before the damage. make: as in `pieces`."""
    unpacked = io.BytesIO()
    with suppress(*damage):
        for piece in pieces(make, io.BytesIO(stored).read):
            unpacked.write(piece[: most_bytes - unpacked.tell()])
            if unpacked.tell() == most_bytes:
                break
    return unpacked.getvalue()


def bounded_bz2(stored: bytes, most_bytes: int = LIMITS.chunk_bytes) -> bytes:
    """What bz2 streams hold."""
    return unpack_bounded(bz2.BZ2Decompressor, stored, _declared(most_bytes))


def bounded_lz4(stored: bytes, most_bytes: int = LIMITS.chunk_bytes) -> bytes:
    """What lz4 frames hold."""
    return unpack_bounded(lz4.frame.LZ4FrameDecompressor, stored, _declared(most_bytes))


def bounded_zstd(stored: bytes, most_bytes: int = LIMITS.chunk_bytes) -> bytes:
    """What zstd frames hold."""
    return unpack_bounded(zstd.ZstdDecompressor, stored, _declared(most_bytes))


def _declared(most_bytes: int) -> int:
    """The size that is declared, which may itself be too large."""
    if most_bytes > LIMITS.chunk_bytes:
        raise OversizedChunk(f"a chunk says it unpacks to {most_bytes / 1e6:.0f} MB")
    return most_bytes
