"""Where files live. Every path is made of ids this program drew; nothing a user typed becomes a path.

uploads/{recording}             bytes as they arrive, with their state beside them (partial.py)
recordings/{recording}/source.bag      a finished upload or sample (with the suffix that it came with)
recordings/{recording}/cache/{key}/    arrays read from it; the key is a hash of all their inputs
recordings/{recording}/unpacked/       what an archive holds, while jobs read it
jobs/{job}/                     events.jsonl, worker.log, and what the job made
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Collection
from contextlib import ExitStack, suppress
from pathlib import Path

from app.errors import BadRequest, Conflict, DiskFull, NotFound, Unavailable
from app.settings import AppSettings
from app.storage.atomic import write_text
from app.storage.lock import sole_use
from app.storage.partial import PartialFile
from app.storage.records import RecordingChanges, RecordingRecord
from app.storage.sizes import source_stamp, tree_size
from calib_core import api
from calib_core.errors import InputError

#: Room for the store's transactions when the disk is full: a deletion writes a few pages of 4 KiB.
RESERVE_BYTES = 8 * 2**20
RESERVE_NAME = "reserve"
#: The code of a refusal: what is read in place is another file than the one that was inspected.
SOURCE_CHANGED = "recording.source_changed"
#: Where the data directory was made, which the keys of its arrays are made of.
PLACE_NAME = "place"


def suffix_of(name: str) -> str:
    """The suffix of a user's file name, which is kept: the reader goes by it."""
    suffix = api.recording_suffix(name)
    if not suffix:
        raise BadRequest(
            "upload.suffix",
            f"A recording's name ends in {api.recording_names()}; {display_name(name)!r} does not: choose a bag, or an "
            "archive of a bag's folder.",
        )
    return suffix


def display_name(name: str) -> str:
    """A user's file name as shown to people: its last part, without control characters, at most 200 long."""
    return shown_name(name.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]) or "recording"


def shown_name(name: str) -> str:
    """A name that a person gives, as it is shown: without control characters, at most 200 long; "" where nothing is left."""
    return "".join(character for character in name if character.isprintable()).strip()[:200]


class DataFolder:
    """The data directory."""

    def __init__(self, settings: AppSettings) -> None:
        self.root = settings.data_dir
        self._min_free_bytes = settings.min_free_bytes
        self._quota_bytes = settings.quota_bytes
        self._held = ExitStack()

    def prepare(self) -> None:
        """Make the folders, readable by their owner only, and keep other servers out of them until `release`."""
        try:
            for folder in (self.root, self.uploads, self.root / "recordings", self.root / "jobs"):
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise Unavailable(
                "data_dir.unusable",
                f"The data directory {self.root} cannot be made ({error.strerror}): name another with --data-dir.",
            ) from error
        self._held.enter_context(sole_use(self.root))
        self._note_place()
        self.keep_reserve()

    def release(self) -> None:
        """Let another server use the folders."""
        self._held.close()

    def _note_place(self) -> None:
        """Write down, once, where the data directory is; on a full disk the next start does it."""
        place = self.root / PLACE_NAME
        if not place.exists():
            with suppress(InputError):
                write_text(place, str(self.root))

    def keep_reserve(self) -> None:
        """Hold back some room, or give it away where there is none left: deleting and failing need a few pages too.

        Called before every transaction of the store; looking costs microseconds.
        """
        reserve = self.root / RESERVE_NAME
        try:
            free = shutil.disk_usage(self.root).free
            if free < RESERVE_BYTES:
                reserve.unlink(missing_ok=True)
            elif free > 4 * RESERVE_BYTES and not reserve.exists():
                with reserve.open("wb") as file:
                    os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
        except OSError:
            return  # another program was faster; the next look decides anew

    def remove_all_unpacked(self) -> None:
        """Delete what jobs had unpacked that a server's end has cut off."""
        for folder in (self.root / "recordings").glob("*/unpacked"):
            api.discard_archives(folder)

    def check_writable(self) -> None:
        """Raise Unavailable unless a file can be made, filled and removed: rights, space and the disk itself."""
        try:
            with tempfile.TemporaryFile(dir=self.uploads) as file:
                file.write(b"0" * 4096)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise Unavailable(
                "data_dir.unusable",
                f"The data directory {self.root} cannot be written ({error.strerror}): check its rights and its disk.",
            ) from error

    @property
    def uploads(self) -> Path:
        """The folder of bytes as they arrive."""
        return self.root / "uploads"

    def partial(self, recording_id: str) -> PartialFile:
        """The file an upload arrives in."""
        return PartialFile(self.uploads / recording_id)

    def recording(self, recording_id: str) -> Path:
        """The recording's folder."""
        return self.root / "recordings" / recording_id

    def source(self, record: RecordingRecord) -> Path:
        """The recording itself: our own copy, or the file or folder it was opened from."""
        return Path(record.source) if record.origin == "folder" else self.recording(record.id) / record.source

    def unpacked(self, recording_id: str) -> Path:
        """The folder into which the jobs of a recording unpack its archive."""
        return self.recording(recording_id) / "unpacked"

    def cache(self, record: RecordingRecord) -> Path:
        """The folder of arrays that belong to the recording as it is read now."""
        return self.recording(record.id) / "cache" / self.cache_key(record)

    def cache_key(self, record: RecordingRecord) -> str:
        """A hash of everything the arrays depend on: the source's bytes (by size and time) and the read settings.

        A folder's own time says nothing of what is written into its files: those written since it was opened count too.
        Conflict while there are no such bytes yet or others than were inspected, NotFound where there are none any more.
        """
        source = self.source(record)
        try:
            self._require_unchanged(record)
            stat = source.stat()
            inside = [(path.name, path.stat()) for path in sorted(source.iterdir())] if source.is_dir() else []
            opened_ns = int(record.created_at.timestamp() * 1e9)
        except OSError as error:
            if record.state == "receiving":
                raise Conflict(
                    "recording.receiving", f"The recording {record.name} is still arriving; ask again when it is here."
                ) from error
            raise NotFound(
                "recording.source_missing",
                f"The recording {record.name} is no longer at {source}: put it back, or delete the entry.",
            ) from error
        inputs = f"1|{self._named(record)}|{stat.st_size}|{stat.st_mtime_ns}|{record.read_settings_json}"
        written = [(name, one) for name, one in inside if one.st_mtime_ns > opened_ns]
        inputs += "".join(f"|{name}|{one.st_size}|{one.st_mtime_ns}" for name, one in written)
        return hashlib.sha256(inputs.encode()).hexdigest()[:32]

    def has_changed(self, record: RecordingRecord) -> bool:
        """Whether what is read in place is another file or folder than the one that was inspected; False where it is gone."""
        if record.origin != "folder" or not record.source_stamp:
            return False
        with suppress(OSError):
            return source_stamp(self.source(record)) != record.source_stamp
        return False

    def as_it_is_now(self, record: RecordingRecord) -> RecordingChanges:
        """The columns that tell what is there to inspect now, of a recording that is read in place; of others they stay."""
        source = self.source(record)
        if record.origin != "folder" or not source.exists():
            return {}
        return {"size_bytes": tree_size(source), "source_stamp": source_stamp(source)}

    def _require_unchanged(self, record: RecordingRecord) -> None:
        if self.has_changed(record):
            raise Conflict(
                SOURCE_CHANGED,
                f"{record.name} was changed or replaced in the recordings folder since it was inspected: the report and the "
                "planes are of the earlier one. Have it inspected again, which gives up what was chosen of the earlier one's "
                "planes, or put that back.",
            )

    def _named(self, record: RecordingRecord) -> Path:
        """The source as it was called where the data directory was made: a copy elsewhere has the same keys."""
        if record.origin == "folder":
            return Path(record.source)
        place = self.root / PLACE_NAME
        try:
            made_at = Path(place.read_text(encoding="utf-8"))
        except OSError:
            made_at = self.root
        return made_at / "recordings" / record.id / record.source

    def job(self, job_id: str) -> Path:
        """The job's folder."""
        return self.root / "jobs" / job_id

    def check_room(self, incoming_bytes: int, *, promised_bytes: int = 0) -> None:
        """Raise DiskFull unless so many more bytes leave enough disk free.   promised_bytes: to uploads under way."""
        free = shutil.disk_usage(self.root).free - promised_bytes
        if free - incoming_bytes < self._min_free_bytes:
            raise DiskFull(
                "upload.disk_full",
                f"{incoming_bytes / 1e9:.2f} GB more do not fit: the data directory's disk has {max(free, 0) / 1e9:.2f} GB "
                f"to give and keeps {self._min_free_bytes / 1e9:.2f} GB free; delete recordings, or take a larger disk.",
            )

    def check_quota(self, incoming_bytes: int, *, promised_bytes: int = 0) -> None:
        """Raise DiskFull unless so many more bytes leave the data directory within its quota, where it has one."""
        if self._quota_bytes is None:
            return
        left = self._quota_bytes - tree_size(self.root) - promised_bytes
        if incoming_bytes > left:
            raise DiskFull(
                "upload.quota",
                f"{incoming_bytes / 1e9:.2f} GB more do not fit: of the {self._quota_bytes / 1e9:.2f} GB that this server "
                f"may take {max(left, 0) / 1e9:.2f} GB are left; delete recordings.",
            )

    def remove_recording(self, recording_id: str, job_ids: list[str]) -> None:
        """Delete all files of a recording and its jobs."""
        for path in (self.recording(recording_id), *(self.job(job_id) for job_id in job_ids)):
            shutil.rmtree(path, ignore_errors=True)
        self.remove_upload(recording_id)

    def remove_upload(self, recording_id: str) -> None:
        """Delete the bytes of an upload and what is known of them."""
        self.partial(recording_id).remove()

    def keep_only_uploads(self, recording_ids: Collection[str]) -> None:
        """Delete what belongs to no upload of these recordings: of finished ones, and of earlier versions."""
        kept = [self.partial(recording_id) for recording_id in recording_ids]
        names = {path for partial in kept for path in (partial.path, partial.state_path)}
        for path in self.uploads.iterdir():
            if path in names:
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
