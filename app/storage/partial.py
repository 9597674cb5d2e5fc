"""An upload on disk while it arrives: its bytes, and how many of them are known to be there.

{id}         the bytes; the file's length is the offset
{id}.state   "DURABLE SHA256": how many bytes had reached the disk at the last sync, and what they should hash to

Whoever goes on with an upload first cuts the file to DURABLE: after a power cut a file may be longer than what was
written into it. The state is of fixed width and written in place, so that noting it needs no room on a full disk and
lies within one sector. All calls block.
"""

from __future__ import annotations

import hashlib
import os
from datetime import UTC, datetime
from pathlib import Path

from app.storage.atomic import sync_folder

#: Bytes hashed at once.
HASH_BYTES = 2**20
_NO_HASH = "-" * 64


class PartialFile:
    """The two files of an upload."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.state_path = path.with_name(f"{path.name}.state")

    def create(self, sha256: str | None) -> None:
        """Make an upload of no bytes.   sha256: what the whole will hash to, where the sender says so."""
        self.path.touch(mode=0o600)
        self.state_path.write_text(_state(0, sha256), encoding="ascii")
        with self.state_path.open("rb") as state:
            os.fsync(state.fileno())
        sync_folder(self.path.parent)

    def durable_bytes(self) -> int:
        """How many bytes are safely there; 0 where nothing says so."""
        durable, _ = self._read()
        try:
            return min(durable, self.path.stat().st_size)
        except OSError:
            return 0

    def is_what_was_sent(self) -> bool:
        """Whether the bytes hash to what their sender said; true where it said nothing."""
        _, expected = self._read()
        if expected is None:
            return True
        hasher = hashlib.sha256()
        with self.path.open("rb") as source:
            while block := source.read(HASH_BYTES):
                hasher.update(block)
        return hasher.hexdigest() == expected

    def note(self, durable_bytes: int) -> None:
        """Write down that so many bytes are on the disk, and wait until that is there too."""
        _, expected = self._read()
        descriptor = os.open(self.state_path, os.O_WRONLY)
        try:
            os.pwrite(descriptor, _state(durable_bytes, expected).encode("ascii"), 0)
            os.fdatasync(descriptor)
        finally:
            os.close(descriptor)

    def changed_at(self) -> datetime | None:
        """When bytes last came; None where there is no such upload."""
        try:
            return datetime.fromtimestamp(self.state_path.stat().st_mtime, UTC)
        except OSError:
            return None

    def remove(self) -> None:
        """Delete both files."""
        self.path.unlink(missing_ok=True)
        self.state_path.unlink(missing_ok=True)

    def _read(self) -> tuple[int, str | None]:
        try:
            durable, sha256 = self.state_path.read_text(encoding="ascii").split()
            return int(durable), None if sha256 == _NO_HASH else sha256
        except (OSError, ValueError):
            return 0, None


class Appender:
    """Bytes going into an upload behind those that are durable."""

    def __init__(self, partial: PartialFile) -> None:
        self._partial = partial
        self._descriptor = os.open(partial.path, os.O_WRONLY)
        self.durable_bytes = partial.durable_bytes()
        self.written_bytes = 0
        self.roll_back()

    def append(self, block: bytes | bytearray) -> None:
        """Write the block. Where that fails, `written_bytes` says how far it came."""
        rest = memoryview(block)
        while len(rest) > 0:
            written = os.write(self._descriptor, rest)
            self.written_bytes += written
            rest = rest[written:]

    def sync(self) -> None:
        """Make durable what was written."""
        if self.written_bytes == self.durable_bytes:
            return
        os.fdatasync(self._descriptor)
        self._partial.note(self.written_bytes)
        self.durable_bytes = self.written_bytes

    def roll_back(self) -> None:
        """Forget what was written after the last sync."""
        os.ftruncate(self._descriptor, self.durable_bytes)
        os.lseek(self._descriptor, self.durable_bytes, os.SEEK_SET)
        self.written_bytes = self.durable_bytes

    def was_deleted(self) -> bool:
        """Whether the upload is gone from its folder."""
        return os.fstat(self._descriptor).st_nlink == 0

    def close(self) -> None:
        """Let go of the file; what was not made durable is cut off."""
        if self.written_bytes != self.durable_bytes:
            self.roll_back()
        os.close(self._descriptor)


def _state(durable_bytes: int, sha256: str | None) -> str:
    return f"{durable_bytes:020d} {sha256 or _NO_HASH}\n"
