"""What the fuzzers of bytes stand on: bytes spoilt at random, and what must hold of whatever becomes of them."""

from __future__ import annotations

import random
import struct

#: Of sizes, counts and lengths: nothing, the edges of their types, and a lie by one.
SIZES = (0, 1, 2, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63)


def spoilt(whole: bytes, chance: random.Random) -> bytes:
    """The bytes with some flipped, replaced by sizes, cut, doubled or moved; sometimes as they are."""
    damaged = bytearray(whole)
    for _ in range(chance.choice((0, 1, 1, 2, 5, 30))):
        if not damaged:
            break
        at = chance.randrange(len(damaged)) if chance.random() < 0.5 else chance.randrange(min(512, len(damaged)))
        way = chance.random()
        if way < 0.5:
            damaged[at] = chance.randrange(256)
        elif way < 0.75:
            raw = struct.pack("<Q", chance.choice(SIZES))[: chance.choice((2, 4, 8))]
            damaged[at : at + len(raw)] = raw
        elif way < 0.85:
            damaged[at:at] = damaged[at : at + chance.randrange(64)]
        elif len(damaged) > at + 1:
            del damaged[at : at + chance.randrange(1, 64)]
    if damaged and chance.random() < 0.2:
        del damaged[chance.randrange(len(damaged) + 1) :]
    return bytes(damaged) or b"\0"


def content(chance: random.Random) -> bytes:
    """Some bytes, which pack well or badly."""
    size = chance.choice((0, 1, 500, 20_000))
    return chance.randbytes(size) if chance.random() < 0.5 else bytes(size)


class DefectError(Exception):
    """Something that must not be."""


def require(holds: bool, text: str) -> None:
    """It must hold."""
    if not holds:
        raise DefectError(text)
