"""Archives of a bag folder: zip and tar (gz, bz2, xz), unpacked into a folder of our own.

Nothing of the archive decides where a file lands: only storage files are taken, under their bare name, and archives in
it are none. What comes out is bounded by the limits and by what the disk has, so that a bomb ends in a sentence.
"""

from __future__ import annotations

import bz2
import errno
import gzip
import lzma
import shutil
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path, PurePosixPath
from typing import IO, cast

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.limits import LIMITS
from calib_core.readers.container.one_recording import (
    STORAGE_SUFFIXES,
    is_hidden,
    is_same_recording,
    plain_name,
    require_one_recording,
    storage_suffix,
)
from calib_core.readers.container.tar_stream import BoundedStream

_TAR_SUFFIXES = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
_KEPT = (*STORAGE_SUFFIXES, ".zstd", ".zst")
_BLOCK = 1 << 20
#: Errors that say something of the archive, a place before its start or a name without end; all others are the disk's.
_ARCHIVES_OWN = {None, errno.EINVAL, errno.ENAMETOOLONG}
#: The end of a zip's list of files: a mark, and its size and place; a comment of 64 KiB may follow.
_ZIP64_END = b"PK\x06\x06"
_ZIP_END, _ZIP_END_BYTES, _ZIP_COMMENT_BYTES = b"PK\x05\x06", 22, 1 << 16


def is_archive(path: Path) -> bool:
    """Whether the name says archive."""
    return path.is_file() and path.name.lower().endswith((".zip", *_TAR_SUFFIXES))


def unpacked_room(path: Path, folder: Path, *, most_bytes: int = LIMITS.unpacked_bytes) -> int:
    """How many bytes the file at `path` may become in `folder`."""
    by_ratio = max(LIMITS.unpacked_least_bytes, path.stat().st_size * LIMITS.unpacked_ratio)
    return min(most_bytes, by_ratio, int(shutil.disk_usage(folder).free * LIMITS.disk_share))


def unpack_archive(path: Path, folder: Path, *, max_bytes: int = LIMITS.unpacked_bytes) -> Path:
    """`folder`, filled with the archive's storage files."""
    room = unpacked_room(path, folder, most_bytes=max_bytes)
    found: list[PurePosixPath] = []
    try:
        for member, stream in _members(path, room):
            inside = PurePosixPath(member.replace("\\", "/"))
            name = plain_name(inside.name)
            if is_hidden(inside) or not name.endswith(_KEPT) or storage_suffix(inside) not in STORAGE_SUFFIXES:
                continue
            found.append(inside)
            if not is_same_recording(found[0], inside):
                continue  # looked through to its end to name them all, and refused
            target = folder / name
            if target.exists():
                raise UnreadableRecording(
                    f"The archive {path.name} holds two files named {name[:80]}; pack one recording per archive."
                )
            room = _copy(stream, target, room, path.name)
    except (
        zipfile.BadZipFile,
        tarfile.TarError,
        zlib.error,
        lzma.LZMAError,
        EOFError,
        NotImplementedError,
        RuntimeError,
        struct.error,
        IndexError,  # a name of no letters, asked for its last one
        ValueError,
    ) as error:
        raise _damaged(path, error) from error
    except OSError as error:
        if error.errno not in _ARCHIVES_OWN:
            raise
        raise _damaged(path, error) from error
    if not found:
        raise UnreadableRecording(f"The archive {path.name} holds no .mcap, .db3 or .bag file; pack the bag's folder.")
    require_one_recording(found, f"The archive {path.name}", "pack one recording per archive")
    return folder


def _damaged(path: Path, error: Exception) -> UnreadableRecording:
    return UnreadableRecording(f"The archive {path.name} is damaged ({_first_line(error)}); copy or pack it again.")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(":.")[:200]


def _members(path: Path, room: int) -> Iterator[tuple[str, IO[bytes]]]:
    members = _zip_members(path) if path.name.lower().endswith(".zip") else _tar_members(path, room)
    for count, member in enumerate(members):
        if count >= LIMITS.archive_entries:
            raise _too_many(path.name)
        yield member


def _zip_members(path: Path) -> Iterator[tuple[str, IO[bytes]]]:
    _check_list_of_files(path)
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.is_dir():
                continue
            # The other methods unpack without a bound on what comes out at once.
            if info.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
                raise UnreadableRecording(f"The archive {path.name} is packed in an unusual way; pack it as plain zip.")
            with archive.open(info) as stream:
                yield info.filename, stream


def _check_list_of_files(path: Path) -> None:
    """Refuse a zip whose list of files, which is read whole, is larger than any recording needs."""
    with path.open("rb") as source:
        source.seek(max(0, path.stat().st_size - _ZIP_END_BYTES - _ZIP_COMMENT_BYTES))
        tail = source.read()
    at = tail.rfind(_ZIP_END)
    if at < 0 or at + _ZIP_END_BYTES > len(tail):
        return  # no zip, as will be said
    entries, list_bytes = struct.unpack_from("<HI", tail, at + 10)
    if (
        entries == 0xFFFF or list_bytes == 0xFFFFFFFF
    ):  # the numbers are in a second place, which has room for larger ones
        at64 = tail.rfind(_ZIP64_END, 0, at)
        if at64 < 0 or at64 + 48 > len(tail):
            raise _too_many(path.name)
        entries, list_bytes = struct.unpack_from("<QQ", tail, at64 + 32)
    if entries > LIMITS.archive_entries or list_bytes > LIMITS.archive_header_bytes:
        raise _too_many(path.name)


def _tar_members(path: Path, room: int) -> Iterator[tuple[str, IO[bytes]]]:
    with path.open("rb") as file, closing(_unpacked_tar(file)) as source:
        stream = BoundedStream(source, longest_read=LIMITS.archive_header_bytes, most_bytes=room + _headroom(room))
        with tarfile.open(fileobj=stream, mode="r:") as archive:
            for member in archive:
                if member.issparse():
                    raise UnreadableRecording(f"The archive {path.name} holds a file with holes; pack it without -S.")
                opened = archive.extractfile(member) if member.isreg() else None
                if opened is not None:
                    yield member.name, opened


def _headroom(room: int) -> int:
    """Bytes of a tar beside its files: headers and padding."""
    return max(LIMITS.archive_header_bytes, room // 100)


def _unpacked_tar(file: IO[bytes]) -> IO[bytes]:
    """The tar itself, whatever the name says it is compressed with."""
    head = file.read(6)
    file.seek(0)
    if head.startswith(b"\x1f\x8b"):
        return cast("IO[bytes]", gzip.GzipFile(fileobj=file))
    if head.startswith(b"BZh"):
        return bz2.BZ2File(file)
    if head.startswith(b"\xfd7zXZ\x00"):
        return lzma.LZMAFile(file)
    return file


def _too_many(archive_name: str) -> UnreadableRecording:
    return UnreadableRecording(
        f"The archive {archive_name} holds more than {LIMITS.archive_entries} files; pack the bag's folder alone."
    )


def _copy(stream: IO[bytes], target: Path, room: int, archive_name: str) -> int:
    """What is left of the room after the member was written."""
    with target.open("wb") as sink:
        while block := stream.read(_BLOCK):
            room -= len(block)
            if room < 0:
                raise UnreadableRecording(
                    f"The archive {archive_name} unpacks to more than there is room for, or than a recording does; "
                    "unpack it by hand and open the folder."
                )
            sink.write(block)
    return room
