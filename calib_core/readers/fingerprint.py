"""SHA-256 of a recording as it was given: of the file, or of a folder's file hashes in name order."""

from __future__ import annotations

import hashlib
from pathlib import Path

_BLOCK = 1 << 22


def recording_sha256(path: Path) -> str:
    """Hexadecimal digest. A folder's is the digest of its files' hexadecimal digests, in name order, joined."""
    if path.is_file():
        return _file_sha256(path)
    files = sorted((f for f in path.rglob("*") if f.is_file()), key=lambda f: f.relative_to(path).as_posix())
    return hashlib.sha256("".join(_file_sha256(f) for f in files).encode()).hexdigest()


def _file_sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as source:
        while block := source.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()
