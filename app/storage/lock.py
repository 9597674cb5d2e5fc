"""One server for each data directory: a second one would take the first one's running jobs for lost."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.errors import Unavailable

LOCK_NAME = "server.lock"


@contextmanager
def sole_use(root: Path) -> Iterator[None]:
    """While it lasts, no other server can use the data directory. The kernel lets go of it when the process dies."""
    try:
        lock = (root / LOCK_NAME).open("a", encoding="ascii")
    except OSError as error:
        raise Unavailable(
            "data_dir.unusable", f"The data directory {root} cannot be used ({error.strerror}): check its rights."
        ) from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise Unavailable(
                "data_dir.in_use",
                f"Another unsweep server uses the data directory {root}: stop it, or name another with --data-dir.",
            ) from None
        yield
