"""Folders that are either whole or absent: written beside, hashed, on the disk, then renamed into place.

checksums.json    size and SHA-256 of every other file, written last

A folder counts as there when every file has its size, which a look at the folder tells; its bytes are hashed when they
are first read by a process. Half a file, an overwritten one and a folder of an earlier version are absent, and made again.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from app.storage.atomic import sync_folder

CHECKSUMS = "checksums.json"
#: Bytes hashed at once.
_BLOCK = 1 << 20
#: What this process has hashed: folders, and when each of their files was last written.
_VERIFIED: dict[Path, tuple[int, ...]] = {}


class DamagedArrays(Exception):
    """What lies in the folder is not what was written."""


class _File(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    size_bytes: int
    sha256: str


class _Checksums(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    files: dict[str, _File]


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A fresh folder to fill; it becomes `path` at the end, unless a whole one was faster or something failed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.name}.{uuid.uuid4().hex}.part")
    fresh.mkdir()
    try:
        yield fresh
        files = {file.name: _summed(file) for file in sorted(fresh.iterdir())}
        (fresh / CHECKSUMS).write_text(_Checksums(files=files).model_dump_json(), encoding="utf-8")
        _sync_file(fresh / CHECKSUMS)
        sync_folder(fresh)
        if is_whole(path):  # open in other processes, and equal
            return
        discard(path)
        fresh.rename(path)
        sync_folder(path.parent)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def is_whole(path: Path) -> bool:
    """Whether the folder is there with all its files, as far as their sizes tell."""
    checksums = _read(path)
    try:
        return checksums is not None and all(
            (path / name).stat().st_size == file.size_bytes for name, file in checksums.files.items()
        )
    except OSError:
        return False


def verify(path: Path) -> None:
    """Raise DamagedArrays unless every file of the folder has the bytes it was written with."""
    checksums = _read(path)
    if checksums is None:
        raise DamagedArrays(f"{path} has no list of its files")
    try:
        written_ns = tuple((path / name).stat().st_mtime_ns for name in (CHECKSUMS, *checksums.files))
        if _VERIFIED.get(path) == written_ns:
            return
        damaged = [name for name, file in checksums.files.items() if _hashed(path / name) != file.sha256]
    except OSError as error:
        raise DamagedArrays(f"a file of {path} cannot be read") from error
    if damaged:
        raise DamagedArrays(f"{damaged[0]} of {path} is not what was written")
    _VERIFIED[path] = written_ns


def forget_verified(above: Path) -> None:
    """Hash what lies below it when it is next read: it is deleted, and may never be."""
    for path in [path for path in list(_VERIFIED) if path.is_relative_to(above)]:
        _VERIFIED.pop(path, None)


def discard(path: Path) -> bool:
    """Remove the folder, so that it is made again; whether there was one. Who has its files open keeps them."""
    _VERIFIED.pop(path, None)
    lost = path.with_name(f"{path.name}.{uuid.uuid4().hex}.lost")
    try:
        path.rename(lost)
    except OSError:
        return False
    shutil.rmtree(lost, ignore_errors=True)
    return True


def _read(path: Path) -> _Checksums | None:
    try:
        return _Checksums.model_validate_json((path / CHECKSUMS).read_text(encoding="utf-8"))
    except (OSError, ValueError, ValidationError):
        return None


def _summed(file: Path) -> _File:
    _sync_file(file)
    return _File(size_bytes=file.stat().st_size, sha256=_hashed(file))


def _hashed(file: Path) -> str:
    hasher = hashlib.sha256()
    with file.open("rb") as source:
        while block := source.read(_BLOCK):
            hasher.update(block)
    return hasher.hexdigest()


def _sync_file(file: Path) -> None:
    with file.open("rb") as source:
        os.fsync(source.fileno())
