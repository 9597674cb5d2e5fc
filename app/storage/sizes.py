"""How much a recording takes on disk, and whether it is what it was. Apart from files.py: workers need no web framework."""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path


def tree_size(path: Path) -> int:
    """Bytes of a file, or of all files below a folder."""
    if path.is_file():
        return path.stat().st_size
    total = 0
    for folder, _, names in os.walk(path):
        for name in names:
            with suppress(OSError):  # gone while it was looked at
                total += Path(folder, name).stat().st_size
    return total


def source_stamp(path: Path) -> str:
    """What tells a recording from another one that is put in its place: sizes and times, of a folder's files too.

    Raises OSError where there is nothing.
    """
    seen = hashlib.sha256()
    for one in [path, *(sorted(path.iterdir()) if path.is_dir() else ())]:
        with suppress(FileNotFoundError):  # a link in the folder that leads nowhere
            stat = one.stat()
            seen.update(f"|{stat.st_size}|{stat.st_mtime_ns}|".encode() + os.fsencode(one.name))
    path.stat()
    return seen.hexdigest()[:32]
