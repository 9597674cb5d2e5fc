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

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.archive import is_archive, unpacked_room
from calib_core.readers.container.compression import pieces, zstd
from calib_core.readers.container.one_recording import (
    STORAGE_SUFFIXES,
    is_hidden,
    require_one_recording,
    storage_suffix,
)
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
_ACCEPTED = "a ROS 1 .bag, a ROS 2 folder, .mcap or .db3, or a .zip or .tar.gz of a bag folder"


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
        return tuple(damage for storage in self._storages for damage in storage.damages)

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
        self.files = storage_files(path)
        storages: list[Storage] = []
        for file in self.files:
            storage = self._open_file(file)
            self._stack.enter_context(closing(storage))
            storages.append(storage)
        return storages

    def _open_file(self, file: Path) -> Storage:
        if file.suffix in (".zstd", ".zst"):
            folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="unsweep-"))
            file = decompressed_file(file, Path(folder))
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
                f"The file {file.name} is no readable recording ({plain_reason(error)}); expected {_ACCEPTED}."
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
        return _kind(storage_files(folder))


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
        raise UnreadableRecording(f"The recording {path.name} cannot be read: {error.strerror or error}.") from error


def plain_reason(error: Exception) -> str:
    """What an error says, without the marks of the errors that it was made from: ('...',) becomes its text."""
    return re.sub(r"\(?['\"]([^'\"]*?)\.?['\"],?\)", r"\1", str(error)).rstrip(".")


def recovered(file: Path, reason: str) -> Storage:
    """The file read without its index. Raises StorageError where nothing of it can be read.   reason: why."""
    if storage_suffix(file) == ".bag":
        return Ros1Recovery(file, reason)
    return McapRecovery(file, reason) if file.suffix == ".mcap" else SqliteRecovery(file, reason)


def storage_files(path: Path) -> list[Path]:
    """The storage files of a recording: the file itself, or those of a folder in name order.

    The folder's metadata.yaml is not asked for their order: recorders that were killed leave none, and splits are named in order.
    Raises UnreadableRecording where there is none, or where there are several recordings'.
    """
    if not path.exists():
        raise UnreadableRecording(f"There is no file or folder {path}; give the path of {_ACCEPTED}.")
    if path.is_file():
        if storage_suffix(path) not in STORAGE_SUFFIXES:
            raise UnreadableRecording(f"The file {path.name} is no recording; expected {_ACCEPTED}.")
        return [path]
    found = _found(path)
    if not _listed(found):
        require_one_recording([f.relative_to(path) for f in found], f"The folder {path.name}", "give one of them")
    for suffix in STORAGE_SUFFIXES:
        files = [f for f in found if storage_suffix(f) == suffix]
        if files:
            return sorted(files, key=_split_order)
    raise UnreadableRecording(f"The folder {path.name} holds no .mcap, .db3 or .bag file; expected {_ACCEPTED}.")


def _found(path: Path) -> list[Path]:
    """The storage files in a folder; where it has none, those in the folders in it: what lies below a recording was made of it.

    A folder that is closed to this user counts where no other has any.
    """
    found: list[Path] = []
    closed: PermissionError | None = None
    for folder in (path, *sorted(p for p in path.iterdir() if p.is_dir() and not is_hidden(p.relative_to(path)))):
        if found and found[0].parent == path:
            break
        try:
            inside = list(folder.iterdir())
        except PermissionError as error:
            closed = error
            continue
        found += [
            f for f in inside if storage_suffix(f) in STORAGE_SUFFIXES and not f.name.startswith(".") and f.is_file()
        ]
    if closed is not None and not found:
        raise closed
    return found


def _listed(files: list[Path]) -> bool:
    """Whether a metadata.yaml beside all of these names them, whatever they are called: then they are one recording."""
    folders = {file.parent for file in files}
    if len(folders) != 1:
        return False
    try:
        text = (folders.pop() / "metadata.yaml").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return all(file.name in text for file in files)


def _split_order(file: Path) -> tuple[str, int, str]:
    """bag_2 before bag_10: the recorder numbers splits without leading zeros."""
    stem = file.name.split(".")[0]
    head, _, number = stem.rpartition("_")
    return (head, int(number), file.name) if number.isdigit() else (stem, -1, file.name)


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
