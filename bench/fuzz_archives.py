"""Archives whose headers lie, and compressed chunks that are cut and flipped and declared to be of any size."""

from __future__ import annotations

import bz2
import io
import random
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import lz4.frame

from bench.spoilt import SIZES, content, require, spoilt
from calib_core.errors import InputError
from calib_core.readers.container.archive import unpack_archive
from calib_core.readers.container.compression import OversizedChunk, bounded_bz2, bounded_lz4, bounded_zstd, zstd

MIB = 1 << 20
#: What an archive of this run may unpack to.
ROOM_BYTES = MIB
NAMES = (
    "room/room_0.mcap",
    "room_0.db3",
    "../../out.mcap",
    "/var/out.mcap",
    "room/../../x.bag",
    "C:\\room.bag",
    "a" * 3000 + ".bag",
    "ro\nom.bag",
    "\u202ebag.x.bag",
    ".bag",
    "room.txt",
    "again.zip",
    "",
)
TAR_SUFFIXES = (("room.tar", "w:"), ("room.tar.gz", "w:gz"), ("room.tar.bz2", "w:bz2"), ("room.tar.xz", "w:xz"))
TAR_TYPES = (
    tarfile.REGTYPE,
    tarfile.REGTYPE,
    tarfile.REGTYPE,
    tarfile.SYMTYPE,
    tarfile.LNKTYPE,
    tarfile.CHRTYPE,
    tarfile.FIFOTYPE,
    tarfile.DIRTYPE,
    tarfile.GNUTYPE_SPARSE,
    tarfile.XHDTYPE,
    tarfile.GNUTYPE_LONGNAME,
)


def zipped(folder: Path, chance: random.Random) -> Path:
    """A zip with odd members."""
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", chance.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name in chance.sample(NAMES[: chance.choice((3, len(NAMES)))], chance.randrange(4)):
            info = zipfile.ZipInfo(name)
            info.compress_type = archive.compression
            archive.writestr(info, content(chance))
    path = folder / "room.zip"
    path.write_bytes(spoilt(raw.getvalue(), chance))
    return path


def tarred(folder: Path, chance: random.Random) -> Path:
    """A tar with odd members; spoilt before it is packed, or after."""
    name, mode = chance.choice(TAR_SUFFIXES)
    plain = io.BytesIO()
    with tarfile.open(
        fileobj=plain, mode="w:", format=chance.choice((tarfile.PAX_FORMAT, tarfile.GNU_FORMAT))
    ) as archive:
        for _ in range(chance.randrange(4)):
            member, body = tarfile.TarInfo(chance.choice(NAMES) or "x"), content(chance)
            member.size, member.type = len(body), chance.choice(TAR_TYPES)
            member.linkname = chance.choice(("", "/etc/passwd", "room_0.mcap"))
            if chance.random() < 0.2:
                member.pax_headers = {
                    chance.choice(("path", "size", "GNU.sparse.map", "x")): chance.choice(("9" * 30, "-1", "é"))
                }
            archive.addfile(member, io.BytesIO(body))
    inside = plain.getvalue()
    before = chance.random() < 0.5
    packed = packer(mode)(spoilt(inside, chance) if before else inside)
    path = folder / name
    path.write_bytes(packed if before else spoilt(packed, chance))
    return path


def packer(mode: str) -> Callable[[bytes], bytes]:
    """What packs a tar so."""
    import gzip
    import lzma

    pack: dict[str, Callable[[bytes], bytes]] = {
        "w:": bytes,
        "w:gz": lambda raw: gzip.compress(raw, 1),
        "w:bz2": lambda raw: bz2.compress(raw, 1),
        "w:xz": lambda raw: lzma.compress(raw, preset=0),
    }
    return pack[mode]


def archives(folder: Path, chance: random.Random) -> str:
    """An archive unpacked into a folder of its own."""
    path = chance.choice((zipped, tarred))(folder, chance)
    target = folder / "to"
    target.mkdir()
    try:
        unpack_archive(path, target, max_bytes=ROOM_BYTES)
        outcome = "taken"
    except InputError as error:
        require("\n" not in str(error), f"more than one line: {error}")
        outcome = "refused"
    left = {each.name for each in folder.iterdir()}
    require(left == {path.name, "to"}, f"beside the folder: {left}")
    files = list(target.rglob("*"))
    require(all(file.is_file() and not file.is_symlink() and file.parent == target for file in files), f"odd: {files}")
    require(all(file.name.isprintable() for file in files), f"names that break a line: {files}")
    total = sum(file.stat().st_size for file in files)
    require(total <= ROOM_BYTES + MIB, f"{total} bytes unpacked")
    return outcome


PACKED: tuple[tuple[Callable[[bytes], bytes], Callable[[bytes, int], bytes]], ...] = (
    (lambda raw: bz2.compress(raw, 1), bounded_bz2),
    (lz4.frame.compress, bounded_lz4),
    (zstd.compress, bounded_zstd),
)


def chunks(_: Path, chance: random.Random) -> str:
    """A compressed chunk, spoilt, and unpacked to a size that is right or is not."""
    honest = content(chance) * chance.choice((1, 1, 1, 10))
    pack, unpack = chance.choice(PACKED)
    packed = pack(honest)
    bytes_given = spoilt(packed, chance)
    most_bytes = chance.choice((len(honest), len(honest), max(0, len(honest) - 1), *SIZES))
    try:
        got = unpack(bytes_given, most_bytes)
    except (OversizedChunk, EOFError, OSError, RuntimeError, ValueError, zstd.ZstdError):
        # Of nothing, lz4's frames do not say that they end.
        fits = 0 < len(honest) <= most_bytes < 2**28
        require(bytes_given != packed or not fits, "an honest chunk was refused")
        return "refused"
    require(len(got) <= most_bytes, f"{len(got)} bytes of at most {most_bytes}")
    require(bytes_given != packed or got == honest, "an honest chunk came out otherwise")
    return "taken"
