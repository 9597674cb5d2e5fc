"""How much there is of what, and for how long: the quota, what nobody uses any more, arrays that nothing reads."""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta

from app.errors import ApiError, Conflict, NotFound
from app.jobs.service import JobService
from app.jobs.state_machine import FINAL
from app.logs import about
from app.recordings.service import RecordingService
from app.schemas.storage import RecordingUse, StorageUse
from app.settings import AppSettings
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingRecord
from app.storage.sizes import tree_size
from app.storage.store import RecordingStore

_LOG = logging.getLogger("unsweep")
#: So often it is looked what has become old; days are what it is about.
SWEEP_S = 3600.0
#: What is due stays for so long, by a clock that nobody can set: a wrong date, put right in time, removes nothing.
DUE_S = 6 * 3600.0


class Keeping:
    """What is kept of all recordings."""

    def __init__(
        self,
        store: RecordingStore,
        files: DataFolder,
        jobs: JobService,
        recordings: RecordingService,
        *,
        settings: AppSettings,
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._steady_s = steady_s
        self._due_since_s: dict[str, float] = {}
        self._store = store
        self._files = files
        self._jobs = jobs
        self._recordings = recordings
        self._settings = settings
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._sweep_for_ever, name="keeping", daemon=True)

    def start(self) -> None:
        """Look now and then, beside everything else."""
        self._thread.start()

    def close(self) -> None:
        """Look no more."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()

    def use(self) -> StorageUse:
        """What takes room."""
        disk = shutil.disk_usage(self._files.root)
        uses = [self._use_of(record) for record in self._store.all_newest_first()]
        return StorageUse(
            disk_total_bytes=disk.total,
            disk_free_bytes=disk.free,
            kept_free_bytes=self._settings.min_free_bytes,
            used_bytes=tree_size(self._files.root),
            quota_bytes=self._settings.quota_bytes,
            keep_days=self._settings.keep_days,
            recordings=sorted(uses, key=_total_bytes, reverse=True),
        )

    def sweep(self, now: datetime) -> None:
        """Remove the recordings that nobody has used for so long, and arrays that belong to an earlier reading."""
        due_before, self._due_since_s = self._due_since_s, {}
        for record in self._store.all_newest_first():
            jobs = self._jobs.records_of(record.id)
            if self._stopping.is_set() or record.state == "receiving" or any(job.state not in FINAL for job in jobs):
                continue
            until = self._until(record, jobs)
            with about(recording_id=record.id), suppress(ApiError):
                if until is not None and until < now:
                    since_s = due_before.get(record.id, self._steady_s())
                    if self._steady_s() - since_s < DUE_S:
                        self._due_since_s[record.id] = since_s
                        continue
                    _LOG.info("nobody used the recording for %g days: it is removed", self._settings.keep_days)
                    self._recordings.delete(record)
                else:
                    self._remove_stale_arrays(record)

    def _sweep_for_ever(self) -> None:
        while not self._stopping.is_set():
            try:
                self.sweep(datetime.now(UTC))
            except Exception:  # noqa: BLE001 - the next look may find the disk or the store well again
                _LOG.exception("what is kept could not be looked through")
            self._stopping.wait(SWEEP_S)

    def _remove_stale_arrays(self, record: RecordingRecord) -> None:
        try:
            current = self._files.cache(record)
        except (NotFound, Conflict):  # its source is still to come, or gone for now: a disk may come back
            return
        for folder in current.parent.glob("*"):
            if folder != current:
                shutil.rmtree(folder, ignore_errors=True)

    def _until(self, record: RecordingRecord, jobs: Sequence[JobRecord]) -> datetime | None:
        """When the recording goes; None where it stays."""
        if self._settings.keep_days is None or record.state == "receiving":
            return None
        return last_used(record, jobs) + timedelta(days=self._settings.keep_days)

    def _use_of(self, record: RecordingRecord) -> RecordingUse:
        jobs = self._jobs.records_of(record.id)
        folder = self._files.recording(record.id)
        arrays = tree_size(folder / "cache") + tree_size(folder / "unpacked")
        uploading = tree_size(self._files.partial(record.id).path)
        return RecordingUse(
            recording_id=record.id,
            name=record.name,
            origin=record.origin,
            state=record.state,
            source_bytes=tree_size(folder) - arrays + uploading,
            arrays_bytes=arrays,
            results_bytes=sum(tree_size(self._files.job(job.id)) for job in jobs),
            last_used_at=last_used(record, jobs),
            removed_at=self._until(record, jobs),
        )


def last_used(record: RecordingRecord, jobs: Sequence[JobRecord]) -> datetime:
    """When somebody last wanted something of the recording."""
    return max([record.created_at, *(job.ended_at or job.created_at for job in jobs)])


def _total_bytes(use: RecordingUse) -> int:
    return use.source_bytes + use.arrays_bytes + use.results_bytes
