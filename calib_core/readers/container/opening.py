"""One recording, whatever it is stored in: topics, time span, messages in receive order.

path ── archive? ── its files (unpacked.py) ───────┐
     ── folder? ── its storage files ──────────────┼── each file: rosbags, else recovery ── OpenRecording
     ── file ──────────────────────────────────────┘
"""

from __future__ import annotations

import heapq
import re
import tempfile
from collections.abc import Collection, Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

from calib_core.errors import UnreadableRecording, is_for_want_of_room
from calib_core.readers.container.archive import is_archive, unpacked_room
from calib_core.readers.container.compression import pieces, zstd
from calib_core.readers.container.files import ACCEPTED, RecordingFiles, recording_files
from calib_core.readers.container.listed import METADATA
from calib_core.readers.container.names import bare_name, is_compressed, some_of, storage_suffix
from calib_core.readers.container.recover_mcap import McapRecovery, holds_ros1
from calib_core.readers.container.recover_ros1 import Ros1Recovery
from calib_core.readers.container.recover_sqlite import SqliteRecovery
from calib_core.readers.container.storage import (
    Damage,
    RawMessage,
    RosbagsStorage,
    Storage,
    StorageError,
    TopicSummary,
    merged_topics,
)
from calib_core.readers.container.unpacked import unpacked_archive

RecordingKind = Literal["ros1", "ros2"]


class OpenRecording:
    """An opened recording. A context manager; iterate `messages` as often as needed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.name = path.name
        self._stack = ExitStack()
        try:
            self._storages = self._open_all()
        except BaseException:
            self._stack.close()
            raise
        self.topics: tuple[TopicSummary, ...] = tuple(merged_topics([t for s in self._storages for t in s.topics]))
        filled = [s for s in self._storages if any(topic.count for topic in s.topics)]
        self.start_ns = min((s.start_ns for s in filled), default=0)
        self.end_ns = max((s.end_ns for s in filled), default=0)

    @property
    def kind(self) -> RecordingKind:
        """Whose messages it holds."""
        return _kind(self.files)

    @property
    def size_bytes(self) -> int:
        """Bytes of the recording as it was given."""
        if self.path.is_file():
            return self.path.stat().st_size
        return sum(file.stat().st_size for file in self.path.rglob("*") if file.is_file())

    @property
    def duration_s(self) -> float:
        """Seconds between the first and the last message's receive times."""
        return max(0, self.end_ns - self.start_ns) * 1e-9

    @property
    def damages(self) -> tuple[Damage, ...]:
        """What is damaged, as far as it is known by now: iterating may add to it."""
        of_files = tuple(damage for storage in self._storages for damage in storage.damages)
        return (*missing_parts(self.name, self._found), *of_files)

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of the files in its folder that its list does not have: they were left out."""
        return tuple(file.name for file in self._found.beside)

    def topic(self, name: str) -> TopicSummary | None:
        """The topic of this name, or None."""
        return next((topic for topic in self.topics if topic.name == name), None)

    def messages(
        self, topics: Collection[str], *, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """Messages of these topics with start_ns <= receive time < stop_ns, in receive order."""
        streams = [s.messages(topics, start_ns, stop_ns) for s in self._storages]
        if len(streams) == 1:
            yield from streams[0]
        else:
            yield from heapq.merge(*streams, key=lambda message: message.receive_ns)

    def _open_all(self) -> list[Storage]:
        path = self.path
        if is_archive(path):
            path = self._stack.enter_context(unpacked_archive(path))
        self._found = recording_files(path)
        self.files = self._found.files
        storages: list[Storage] = []
        for file in self.files:
            storage = self._open_file(file)
            self._stack.enter_context(closing(storage))
            storages.append(storage)
        return storages

    def _open_file(self, file: Path) -> Storage:
        if is_compressed(file):
            folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="unsweep-"))
            file = decompressed_file(file, Path(folder))
        if file.suffix != file.suffix.lower():  # libraries go by the suffix, in lower case
            folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="unsweep-"))
            called = Path(folder) / f"{bare_name(file)}{storage_suffix(file)}"
            called.symlink_to(file.resolve())
            file = called
        if file.stat().st_size == 0:
            raise UnreadableRecording(f"The file {file.name} is empty; record or copy it again.")
        try:
            return RosbagsStorage(file, partial(recovered, file))
        except StorageError as error:
            reason = plain_reason(error)
        try:
            return recovered(file, reason)
        except (StorageError, OSError) as error:
            raise UnreadableRecording(
                f"The file {file.name} is no readable recording ({plain_reason(error)}); expected {ACCEPTED}."
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()


def open_recording(path: Path) -> OpenRecording:
    """The recording at `path`, opened; a context manager. Raises UnreadableRecording with one sentence."""
    with _told_as_unreadable(path):
        return OpenRecording(path)


def kind_of(path: Path) -> RecordingKind:
    """Whose messages the recording at `path` holds, by its files' names and an mcap's first words: no more of them is read."""
    with _told_as_unreadable(path), unpacked_archive(path) if is_archive(path) else nullcontext(path) as folder:
        return _kind(recording_files(folder).files)


def _kind(files: list[Path]) -> RecordingKind:
    return "ros1" if files and (storage_suffix(files[0]) == ".bag" or holds_ros1(files[0])) else "ros2"


@contextmanager
def _told_as_unreadable(path: Path) -> Iterator[None]:
    """What the system says against a file becomes one sentence. What is no file or folder is not asked: a pipe may not answer."""
    if path.exists() and not path.is_file() and not path.is_dir():
        raise UnreadableRecording(
            f"Expected a file or a folder at {path}, but found a pipe or a device; copy the recording into a file."
        )
    try:
        yield
    except PermissionError as error:
        raise UnreadableRecording(
            f"The file {error.filename} may not be read by this user; change its mode."
        ) from error
    except OSError as error:
        if is_for_want_of_room(error):
            raise UnreadableRecording(
                f"The recording {path.name} cannot be unpacked: the disk for it is full; free some space, or point TMPDIR at a "
                "disk with room.",
                code="disk.full",
            ) from error
        raise UnreadableRecording(f"The recording {path.name} cannot be read: {error.strerror or error}.") from error


def plain_reason(error: Exception) -> str:
    """What an error says, without the marks of the errors that it was made from: ('...',) becomes its text."""
    return re.sub(r"\(?['\"]([^'\"]*?)\.?['\"],?\)", r"\1", str(error)).rstrip(".")


def recovered(file: Path, reason: str) -> Storage:
    """The file read without its index. Raises StorageError where nothing of it can be read.   reason: why."""
    if storage_suffix(file) == ".bag":
        return Ros1Recovery(file, reason)
    return McapRecovery(file, reason) if storage_suffix(file) == ".mcap" else SqliteRecovery(file, reason)


def missing_parts(name: str, found: RecordingFiles) -> tuple[Damage, ...]:
    """That files are not there which the list of the recording called `name` has."""
    if not found.missing:
        return ()
    names = some_of([one.name for one in found.missing])
    known_s = [one.duration_s for one in found.missing if one.duration_s is not None]
    lost = f", {sum(known_s):.1f} s of it" if len(known_s) == len(found.missing) else ""
    text = f"{len(found.missing)} of the {found.listed} files that its {METADATA} lists, {names}{lost}"
    return (Damage(name, text, "missing"),)


def decompressed_file(file: Path, folder: Path) -> Path:
    """A zstd-compressed storage file unpacked into `folder`; a cut file as far as it goes."""
    out = folder / file.stem
    room = unpacked_room(file, folder)
    with file.open("rb") as source, out.open("wb") as sink:
        try:
            for piece in pieces(zstd.ZstdDecompressor, source.read):
                sink.write(piece)
                if sink.tell() > room:
                    raise UnreadableRecording(
                        f"The file {file.name} unpacks to more than {room / 1e9:.2f} GB, more than there is room for or "
                        "than a recording does; unpack it by hand."
                    )
        except (zstd.ZstdError, EOFError) as error:  # of what there is the storage's reader says what is missing
            if sink.tell() == 0:
                raise UnreadableRecording(f"The file {file.name} is not valid zstd; copy it again.") from error
    return out
