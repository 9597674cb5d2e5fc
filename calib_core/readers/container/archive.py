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
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import IO, cast

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.limits import LIMITS
from calib_core.readers.container.listed import METADATA, files_of
from calib_core.readers.container.names import (
    ARCHIVE_SUFFIXES,
    STORAGE_SUFFIXES,
    is_hidden,
    plain_name,
    some_of,
    storage_suffix,
)
from calib_core.readers.container.one_recording import is_same_recording, require_one_recording
from calib_core.readers.container.tar_stream import BoundedStream

_BLOCK = 1 << 20
#: The bit of a zip's member that needs a password.
_ENCRYPTED = 1
#: Errors that say something of the archive, a place before its start or a name without end; all others are the disk's.
_ARCHIVES_OWN = {None, errno.EINVAL, errno.ENAMETOOLONG}
#: The end of a zip's list of files: a mark, and its size and place; a comment of 64 KiB may follow.
_ZIP64_END = b"PK\x06\x06"
_ZIP_END, _ZIP_END_BYTES, _ZIP_COMMENT_BYTES = b"PK\x05\x06", 22, 1 << 16


@dataclass(slots=True)
class _Held:
    """What an archive holds.

    found: its storage files.   links: names of what is passed over since it leads elsewhere.
    lists: the metadata.yaml of each of its folders: which of them is the recording's is seen at the end.
    several: whether there are files of another recording than the first one's, which are passed over.
    """

    found: list[PurePosixPath] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    lists: dict[PurePosixPath, bytes] = field(default_factory=dict)
    several: bool = False

    def lists_both(self, first: PurePosixPath, other: PurePosixPath) -> bool:
        """Whether they are in one folder, whose list has come by now and names both."""
        text = self.lists.get(first.parent, b"").decode("utf-8", "replace")
        return first.parent == other.parent and {first.name, other.name} <= {one.name for one in files_of(text)}


def is_archive(path: Path) -> bool:
    """Whether the name says archive."""
    return path.is_file() and path.name.lower().endswith(ARCHIVE_SUFFIXES)


def unpacked_room(path: Path, folder: Path, *, most_bytes: int = LIMITS.unpacked_bytes) -> int:
    """How many bytes the file at `path` may become in `folder`."""
    by_ratio = max(LIMITS.unpacked_least_bytes, path.stat().st_size * LIMITS.unpacked_ratio)
    return min(most_bytes, by_ratio, int(shutil.disk_usage(folder).free * LIMITS.disk_share))


def unpack_archive(path: Path, folder: Path, *, max_bytes: int = LIMITS.unpacked_bytes) -> Path:
    """`folder`, filled with the archive's storage files."""
    room = unpacked_room(path, folder, most_bytes=max_bytes)
    held = _Held()
    try:
        _fill(folder, path, room, held)
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
    if not held.found:
        raise _empty(path, [link for link in held.links if storage_suffix(PurePosixPath(link)) in STORAGE_SUFFIXES])
    if held.several or not all(held.lists_both(held.found[0], file) for file in held.found):
        require_one_recording(held.found, f"The archive {path.name}", "pack one recording per archive")
    if held.found[0].parent in held.lists:
        (folder / METADATA).write_bytes(held.lists[held.found[0].parent])
    return folder


def _fill(folder: Path, path: Path, room: int, held: _Held) -> None:
    """Write the archive's storage files into the folder, at most `room` bytes.   held: what there is, added to."""
    for member, stream in _members(path, room, held.links):
        inside = PurePosixPath(member.replace("\\", "/"))
        name = plain_name(inside.name)
        if inside.name == METADATA and len(held.lists) < LIMITS.archive_lists:
            held.lists[inside.parent] = stream.read(LIMITS.archive_list_bytes)
        if is_hidden(inside) or storage_suffix(inside) not in STORAGE_SUFFIXES:
            continue
        held.found.append(inside)
        if not is_same_recording(held.found[0], inside) and not held.lists_both(held.found[0], inside):
            held.several = True
            continue  # looked through to its end to name them all, and refused
        target = folder / name
        if target.exists():
            raise UnreadableRecording(
                f"The archive {path.name} holds two files named {name[:80]}; pack one recording per archive."
            )
        room = _copy(stream, target, room, path.name)


def _empty(path: Path, links: list[str]) -> UnreadableRecording:
    """What to say of an archive without a recording.   links: those that are called as one."""
    if links:
        return UnreadableRecording(
            f"The archive {path.name} holds no recording but links to it ({some_of(links)}), which are not followed; pack the "
            "files themselves."
        )
    return UnreadableRecording(f"The archive {path.name} holds no .mcap, .db3 or .bag file; pack the bag's folder.")


def _damaged(path: Path, error: Exception) -> UnreadableRecording:
    return UnreadableRecording(f"The archive {path.name} is damaged ({_first_line(error)}); copy or pack it again.")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(":.")[:200]


def _members(path: Path, room: int, links: list[str]) -> Iterator[tuple[str, IO[bytes]]]:
    """Names and bytes of the archive's files.   links: names of what leads elsewhere and is passed over, added to."""
    members = _zip_members(path, links) if path.name.lower().endswith(".zip") else _tar_members(path, room, links)
    for count, member in enumerate(members):
        if count >= LIMITS.archive_entries:
            raise _too_many(path.name)
        yield member


def _zip_members(path: Path, links: list[str]) -> Iterator[tuple[str, IO[bytes]]]:
    _check_list_of_files(path)
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.is_dir():
                continue
            if stat.S_ISLNK(info.external_attr >> 16):
                links.append(info.filename)  # the bytes are the path that it leads to
                continue
            if info.flag_bits & _ENCRYPTED:
                raise UnreadableRecording(
                    f"The archive {path.name} is encrypted; unpack it with its password, and give the folder or pack it without."
                )
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


def _tar_members(path: Path, room: int, links: list[str]) -> Iterator[tuple[str, IO[bytes]]]:
    with path.open("rb") as file, closing(_unpacked_tar(file)) as source:
        stream = BoundedStream(source, longest_read=LIMITS.archive_header_bytes, most_bytes=room + _headroom(room))
        with tarfile.open(fileobj=stream, mode="r:") as archive:
            for member in archive:
                if member.issym() or member.islnk():
                    links.append(member.name)
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
