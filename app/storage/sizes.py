"""How much a recording takes on disk. Apart from files.py, so that workers need not load a web framework for it."""

from __future__ import annotations

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
