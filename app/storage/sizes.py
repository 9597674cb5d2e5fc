"""How much a recording takes on disk. Apart from files.py, so that workers need not load a web framework for it."""

from __future__ import annotations

from pathlib import Path


def tree_size(path: Path) -> int:
    """Bytes of a file, or of all files below a folder."""
    if path.is_file():
        return path.stat().st_size
    return sum(entry.stat().st_size for entry in path.rglob("*") if entry.is_file())
