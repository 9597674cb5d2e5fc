"""One command at a time for each output folder: two would write each other's table anew."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from calib_core.errors import InputError

LOCK_NAME = ".unsweep.lock"


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """While it lasts, no other fleet writes to the folder, which is made where it is not there. A process that dies lets go.

    Raises InputError where another one does, or where nothing can be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / LOCK_NAME).open("a", encoding="ascii")
    except OSError as error:
        raise InputError(
            f"Expected a folder for the documents at {folder}, but it cannot be made or written to ({error.strerror}); "
            "choose another."
        ) from error
    with lock:
        if not _taken(lock):
            raise InputError(
                f"Another `unsweep calibrate-many` is at work in {folder}: wait until it has ended, or choose another folder."
            )
        yield


def _taken(lock: IO[str]) -> bool:
    """Whether it is ours now. A file system that knows no locks keeps nobody away."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not isinstance(error, BlockingIOError)
    return True
