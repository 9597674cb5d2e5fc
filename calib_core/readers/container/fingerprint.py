"""SHA-256 of a recording as it was given: of the file, or of a folder's file hashes in name order."""

from __future__ import annotations

import hashlib
from pathlib import Path

from calib_core.events import ShouldCancel, never_cancel

_BLOCK = 1 << 22


def recording_sha256(path: Path, *, should_stop: ShouldCancel = never_cancel) -> str:
    """Hexadecimal digest. A folder's is the digest of its files' hexadecimal digests, in name order, joined.

    should_stop: polled between blocks; once it says so, the digest is of what was read by then.
    """
    if path.is_file():
        return _file_sha256(path, should_stop)
    files = sorted((f for f in path.rglob("*") if f.is_file()), key=lambda f: f.relative_to(path).as_posix())
    return hashlib.sha256("".join(_file_sha256(f, should_stop) for f in files).encode()).hexdigest()


def _file_sha256(path: Path, should_stop: ShouldCancel) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as source:
        while not should_stop() and (block := source.read(_BLOCK)):
            digest.update(block)
    return digest.hexdigest()
