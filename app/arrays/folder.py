"""Folders that are either whole or absent: written beside, then renamed into place."""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A fresh folder to fill; it becomes `path` at the end, unless an equal one was faster or something failed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.name}.{uuid.uuid4().hex}.part")
    fresh.mkdir()
    try:
        yield fresh
        if not path.exists():  # what is there is open in other processes, and equal
            fresh.rename(path)
    finally:
        shutil.rmtree(fresh, ignore_errors=True)
