"""Archives of a bag folder: zip and tar (gz, bz2, xz), unpacked into a folder of our own.

Nothing of the archive decides where a file lands: only storage files are taken, under their bare name. The size
unpacked is bounded by what the disk has and by MAX_UNPACKED_BYTES, so a bomb ends in a sentence.
"""

from __future__ import annotations

import lzma
import shutil
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from calib_core.errors import UnreadableRecording

MAX_UNPACKED_BYTES = 200 * (1 << 30)
_TAR_SUFFIXES = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
_KEPT = (".bag", ".mcap", ".db3", ".zstd", ".zst")
_BLOCK = 1 << 20


def is_archive(path: Path) -> bool:
    """Whether the name says archive."""
    return path.is_file() and path.name.lower().endswith((".zip", *_TAR_SUFFIXES))


def unpack_archive(path: Path, folder: Path, *, max_bytes: int = MAX_UNPACKED_BYTES) -> Path:
    """`folder`, filled with the archive's storage files."""
    budget = min(max_bytes, int(shutil.disk_usage(folder).free * 0.95))
    found = 0
    try:
        for member, stream in _members(path):
            name = PurePosixPath(member.replace("\\", "/")).name
            if name.startswith(".") or not name.endswith(_KEPT):
                continue
            target = folder / name
            if target.exists():
                raise UnreadableRecording(
                    f"The archive {path.name} holds two files named {name}; pack one recording per archive."
                )
            budget = _copy(stream, target, budget, path.name)
            found += 1
    except (
        zipfile.BadZipFile,
        tarfile.TarError,
        zlib.error,
        lzma.LZMAError,
        EOFError,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise UnreadableRecording(
            f"The archive {path.name} is damaged ({_first_line(error)}); copy or pack it again."
        ) from error
    if not found:
        raise UnreadableRecording(f"The archive {path.name} holds no .mcap, .db3 or .bag file; pack the bag's folder.")
    return folder


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0].rstrip(":.")


def _members(path: Path) -> Iterator[tuple[str, IO[bytes]]]:
    if path.name.lower().endswith(".zip"):
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                if not info.is_dir():
                    with archive.open(info) as stream:
                        yield info.filename, stream
        return
    with tarfile.open(path) as archive:
        for member in archive:
            opened = archive.extractfile(member) if member.isreg() else None
            if opened is not None:
                yield member.name, opened


def _copy(stream: IO[bytes], target: Path, budget: int, archive_name: str) -> int:
    """What is left of the budget after the member was written."""
    with target.open("wb") as sink:
        while block := stream.read(_BLOCK):
            budget -= len(block)
            if budget < 0:
                raise UnreadableRecording(
                    f"The archive {archive_name} unpacks to more than there is room for; unpack it by"
                    f" hand and open the folder."
                )
            sink.write(block)
    return budget
