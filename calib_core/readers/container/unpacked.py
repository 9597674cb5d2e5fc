"""Where an archive is unpacked: into a folder that goes when it is closed, or into one that several readers share.

    with sharing(folder):                    # this and other processes name the same folder
        open_recording(Path("room.zip"))     # whoever comes first unpacks, the others wait for it and read the same files

A lock file in the shared folder is held alone while unpacking and together while reading. The kernel lets go of it
when a process dies, and what was half unpacked has another name, so that a crash leaves nothing that would be
believed. `discard` removes the files unless somebody reads them.
"""

from __future__ import annotations

import fcntl
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import IO

from calib_core.readers.container.archive import unpack_archive

_LOCK = "lock"
_SHARED: ContextVar[Path | None] = ContextVar("shared", default=None)


@contextmanager
def sharing(folder: Path) -> Iterator[None]:
    """While it lasts, archives opened in this thread are unpacked into `folder`, and stay there."""
    token = _SHARED.set(folder)
    try:
        yield
    finally:
        _SHARED.reset(token)


@contextmanager
def kept_unpacked() -> Iterator[None]:
    """While it lasts, an archive that this thread opens again and again is unpacked once; gone afterwards, if not shared."""
    if _SHARED.get() is not None:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="unsweep-") as own, sharing(Path(own)):
        yield


@contextmanager
def unpacked_archive(archive: Path) -> Iterator[Path]:
    """A folder with the archive's storage files, there as long as the context lasts."""
    folder = _SHARED.get()
    if folder is None:
        with tempfile.TemporaryDirectory(prefix="unsweep-") as own:
            yield unpack_archive(archive, Path(own))
        return
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    with (folder / _LOCK).open("w", encoding="utf-8") as lock:
        yield _held(archive, folder, lock)


def discard(folder: Path) -> bool:
    """Remove what was unpacked into a shared folder; whether it could be: nothing is touched while it is read."""
    if not folder.is_dir():
        return True
    with (folder / _LOCK).open("w", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        _clear(folder)
    return True


def _held(archive: Path, folder: Path, lock: IO[str]) -> Path:
    """The unpacked files, locked against removal until `lock` is closed."""
    stat = archive.stat()
    files = folder / f"{stat.st_size}-{stat.st_mtime_ns}"
    while True:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not files.is_dir():
            _clear(folder)  # of another archive, or half of this one
            part = Path(tempfile.mkdtemp(prefix="part-", dir=folder))
            unpack_archive(archive, part).rename(files)
        fcntl.flock(lock, fcntl.LOCK_SH)
        # Between the two locks there is a moment with none, in which the files may have been discarded.
        if files.is_dir():
            return files


def _clear(folder: Path) -> None:
    for entry in folder.iterdir():
        if entry.is_dir():
            shutil.rmtree(entry)
