"""Recordings: opening, receiving, changing, deleting. Work on them is the workflow's."""

from __future__ import annotations

import json
import logging
import threading
import uuid
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import anyio
from anyio import to_thread
from fastapi import Request
from pydantic import ValidationError
from starlette.types import Receive

from app.arrays.folder import DamagedArrays, discard
from app.arrays.proposals import has_proposals, proposal_arrays
from app.arrays.recording import has_recording, read_recording, recording_arrays
from app.bus import Bus
from app.errors import BadRequest, Conflict, DiskFull, NotFound, TooLarge
from app.events import RecordingArrived, RecordingDeleted, RecordingEdited, SampleWanted
from app.jobs.service import JobService
from app.recordings.folder import RecordingsFolder
from app.recordings.timeline import make_timeline
from app.recordings.verdict import verdict_of
from app.schemas.common import ErrorFacts
from app.schemas.recordings import ChangeRecording, OpenRecording, Origin, Recording, RecordingState, Timeline
from app.schemas.report import Report
from app.settings import AppSettings
from app.storage.atomic import sync_folder
from app.storage.files import DataFolder, display_name, suffix_of
from app.storage.records import RecordingRecord
from app.storage.sizes import tree_size
from app.storage.store import DocumentStore, RecordingStore
from app.uploads.inbox import Inbox, Part
from app.uploads.protocol import Checksum, TusError, number_of
from calib_core import api
from calib_core.settings import ReadSettings

_LOG = logging.getLogger("unsweep")
#: The document that a person writes.
NOTE = "note"

UNREADABLE = ErrorFacts(
    code="recording.unreadable",
    text="What was kept about this recording cannot be read any more; delete it here and open the file again.",
)


class RecordingService:
    """All recordings of the application.

    Tells the bus when a recording can be inspected, when a sample is to be made, and when one was changed or deleted.
    """

    def __init__(
        self,
        store: RecordingStore,
        documents: DocumentStore,
        files: DataFolder,
        folder: RecordingsFolder,
        jobs: JobService,
        bus: Bus,
        *,
        settings: AppSettings,
    ) -> None:
        self._store = store
        self._documents = documents
        self._files = files
        self._folder = folder
        self._jobs = jobs
        self._bus = bus
        self._settings = settings
        self._inbox = Inbox(files)
        self._announcing = threading.Lock()

    def find(self, recording_id: str) -> RecordingRecord | None:
        """The recording, or None."""
        return self._store.find(recording_id)

    def get(self, recording_id: str) -> RecordingRecord:
        """The recording, or NotFound."""
        record = self._store.find(recording_id)
        if record is None:
            raise NotFound(
                "recording.not_found", f"No recording has the id {recording_id}; it may be deleted, see the list."
            )
        return record

    def list_all(self) -> list[Recording]:
        """All recordings, newest first, without their reports: each carries plots that a list does not show."""
        return [
            self.wire(replace(record, report_json=None)).model_copy(update={"verdict": verdict_of(record)})
            for record in self._store.all_newest_first()
        ]

    def wire(self, record: RecordingRecord) -> Recording:
        """The recording as the wire carries it; one whose record cannot be read is shown as broken, and can be deleted."""
        try:
            return self._wire(record)
        except ValidationError:
            return Recording(
                id=record.id,
                name=str(record.name),
                size_bytes=0,
                received_bytes=0,
                origin=record.origin,
                state="failed",
                error=UNREADABLE,
                read_settings=ReadSettings(),
                has_planes=False,
                created_at=record.created_at,
            )

    def _wire(self, record: RecordingRecord) -> Recording:
        return Recording(
            id=record.id,
            name=record.name,
            note=self._note_of(record),
            size_bytes=record.size_bytes,
            received_bytes=self.received_bytes(record),
            origin=record.origin,
            state=record.state,
            error=None if record.error_json is None else ErrorFacts.model_validate_json(record.error_json),
            read_settings=ReadSettings.model_validate_json(record.read_settings_json),
            report=None if record.report_json is None else Report.model_validate_json(record.report_json),
            has_planes=self._has_planes(record),
            created_at=record.created_at,
            latest_job=self._jobs.latest(record.id),
            verdict=verdict_of(record),
        )

    def _note_of(self, record: RecordingRecord) -> str:
        try:
            note = json.loads(self._documents.read(record.id, NOTE) or '""')
        except ValueError:  # somebody else's words in the store cost the note, not the list
            return ""
        return note if isinstance(note, str) else ""

    def _has_planes(self, record: RecordingRecord) -> bool:
        try:
            return has_proposals(proposal_arrays(self._files.cache(record)))
        except NotFound:  # its source is gone, or is still to come
            return False

    def received_bytes(self, record: RecordingRecord) -> int:
        """How much of an upload has safely arrived."""
        if record.origin == "upload" and record.state == "receiving":
            return self._files.partial(record.id).durable_bytes()
        return record.size_bytes

    def open(self, wish: OpenRecording) -> Recording:
        """A new recording from the server's folder, or a sample to be made."""
        if wish.folder_path is not None:
            path = self._folder.recording(wish.folder_path)
            record = self._new(path.name, "folder", source=str(path), size_bytes=tree_size(path), state="inspecting")
            self._store.add(record)
            self._bus.publish(RecordingArrived(record))
            return self.wire(self.get(record.id))
        scenario = wish.sample or ""
        if scenario not in api.scenarios():
            raise BadRequest(
                "sample.unknown",
                f"No sample is called {scenario!r}; there are {', '.join(api.scenarios())}.",
            )
        record = self._new(f"{scenario}.bag", "sample", source="source.bag", size_bytes=0, state="receiving")
        record = replace(record, scenario=scenario)
        self._store.add(record)
        self._bus.publish(SampleWanted(record))
        return self.wire(self.get(record.id))

    def announce_upload(self, name: str, size_bytes: int, sha256: str | None = None) -> RecordingRecord:
        """A recording whose bytes are about to arrive; refused where they and all others announced would not fit.

        size_bytes: 0 where it is not known before.   sha256: what the whole will hash to, where that is known.
        """
        suffix = suffix_of(name)
        self.check_size(size_bytes)
        with self._announcing:
            promised = sum(max(0, r.size_bytes - self.received_bytes(r)) for r in self._arriving(datetime.now(UTC)))
            self._files.check_room(size_bytes, promised_bytes=promised)
            self._files.check_quota(size_bytes, promised_bytes=promised)
            record = self._new(
                display_name(name), "upload", source=f"source{suffix}", size_bytes=size_bytes, state="receiving"
            )
            try:
                self._files.partial(record.id).create(sha256)
            except OSError as error:
                self._files.partial(record.id).remove()
                raise DiskFull(
                    "upload.disk_full",
                    f"The data directory takes no more files ({error.strerror}); delete recordings.",
                ) from error
            self._store.add(record)
        return record

    def finish_upload(self, recording_id: str) -> None:
        """The last byte is here. Called again for the same upload it does nothing."""
        record = self.get(recording_id)
        if record.state != "receiving":
            return
        partial, source = self._files.partial(record.id), self._files.source(record)
        if partial.path.exists():  # else the server ended just after the file was moved
            if not partial.is_what_was_sent():
                self.delete(record)
                raise TusError(
                    460,
                    "upload.sha256",
                    f"What arrived of {record.name} is not what was sent (its SHA-256 differs); upload it again.",
                )
            source.parent.mkdir(parents=True, exist_ok=True)
            partial.path.replace(source)
            for folder in (source.parent, source.parent.parent, partial.path.parent):
                sync_folder(folder)
        record = self._store.save(replace(record, state="inspecting", size_bytes=source.stat().st_size))
        partial.remove()
        self._bus.publish(RecordingArrived(record))

    async def receive(self, name: str, request: Request) -> Recording:
        """A recording from one request's body, written as it comes; nothing is kept of one that is cut short."""
        length = number_of(request.headers, "content-length") if "content-length" in request.headers else None
        if length == 0:
            raise self._empty(name)
        record = await to_thread.run_sync(self.announce_upload, name, length or 0)
        await self.receive_first(record, request.receive, None)
        return await to_thread.run_sync(lambda: self.wire(self.get(record.id)))

    async def receive_first(self, record: RecordingRecord, receive: Receive, checksum: Checksum | None) -> int:
        """The bytes that come with an announcement. Where they cannot be kept nothing was announced."""
        try:
            reached = await self._receive(record, receive, 0, checksum)
            if record.size_bytes == 0:
                if reached == 0:
                    raise self._empty(record.name)
                await to_thread.run_sync(self.finish_upload, record.id)
        except BaseException:
            with anyio.CancelScope(shield=True):
                await to_thread.run_sync(self.delete, record)
            raise
        return reached

    async def receive_part(
        self, record: RecordingRecord, request: Request, offset_bytes: int, checksum: Checksum | None
    ) -> int:
        """More bytes of an upload; how many there are now."""
        if record.state != "receiving":
            if offset_bytes == record.size_bytes:
                return record.size_bytes  # the answer to the last bytes was lost
            raise Conflict("upload.finished", f"All of {record.name} has arrived already.")
        if "content-length" in request.headers and (
            offset_bytes + number_of(request.headers, "content-length") > record.size_bytes
        ):
            raise TooLarge(
                "upload.too_large",
                f"{record.name} was announced with {record.size_bytes} bytes, and this request goes beyond; start it again.",
            )
        return await self._receive(record, request.receive, offset_bytes, checksum)

    async def give_up(self, record: RecordingRecord) -> None:
        """An upload that is still arriving goes, with everything of it."""
        if record.state != "receiving":
            raise Conflict("upload.finished", f"All of {record.name} has arrived; delete the recording instead.")
        await self._inbox.stop(record.id)
        await to_thread.run_sync(self.delete, record)

    async def stop_uploads(self) -> None:
        """Keep what has come of the uploads under way, and end their requests: the server stops."""
        await self._inbox.stop_all()

    def expires_at(self, record: RecordingRecord, now: datetime) -> datetime | None:
        """When the upload is removed unless it goes on; None where all of it is here."""
        if record.state != "receiving":
            return None
        return (self._files.partial(record.id).changed_at() or now) + timedelta(days=self._settings.upload_expiry_days)

    async def _receive(
        self, record: RecordingRecord, receive: Receive, offset_bytes: int, checksum: Checksum | None
    ) -> int:
        end_bytes = record.size_bytes or self._settings.max_upload_bytes
        part = Part(record.name, offset_bytes, end_bytes, checksum)
        reached = await self._inbox.receive(record.id, receive, part)
        if reached == record.size_bytes:
            await to_thread.run_sync(self.finish_upload, record.id)
        return reached

    def _arriving(self, now: datetime) -> list[RecordingRecord]:
        """Uploads under way. Those given up long ago are deleted here."""
        arriving: list[RecordingRecord] = []
        for record in self._store.all_newest_first():
            if record.origin != "upload" or record.state != "receiving":
                continue
            if (self.expires_at(record, now) or now) < now:
                self.delete(record)
            else:
                arriving.append(record)
        return arriving

    def _empty(self, name: str) -> BadRequest:
        return BadRequest("upload.empty", f"The file {display_name(name)} is empty; choose one with messages in it.")

    def change(self, record: RecordingRecord, change: ChangeRecording) -> Recording:
        """The recording renamed or to be read another way; in the latter case it is inspected again."""
        wanted = change.model_dump(exclude_unset=True, exclude={"name", "note"})
        if change.name is not None:
            record = self._store.save(replace(record, name=display_name(change.name)))
        if change.note is not None:
            self._documents.write(record.id, NOTE, json.dumps(change.note.strip()))
        before = reading_of(record)
        after = self._merged(before or ReadSettings(), wanted)
        if after != before:
            if record.state == "receiving":
                raise Conflict("recording.receiving", "The recording is still arriving; change it when it is here.")
            self._jobs.stop_all_of(record.id)
            record = self._store.save(
                replace(record, read_settings_json=after.model_dump_json(), state="inspecting", error_json=None)
            )
            self._bus.publish(RecordingArrived(record))
        self._bus.publish(RecordingEdited(record.id))
        return self.wire(self.get(record.id))

    def delete(self, record: RecordingRecord) -> None:
        """Stop its jobs and remove all that is ours of it."""
        self._jobs.stop_all_of(record.id)
        job_ids = [job.id for job in self._jobs.records_of(record.id)]
        self._files.remove_recording(record.id, job_ids)  # first: on a full disk this makes room for the rest
        self._store.remove(record.id)
        self._bus.publish(RecordingDeleted(record.id))

    def timeline(self, record: RecordingRecord) -> Timeline:
        """The recording over time."""
        folder = recording_arrays(self._files.cache(record))
        start_s = (reading_of(record) or ReadSettings()).start_s or 0.0
        try:
            if not has_recording(folder):
                raise DamagedArrays
            return make_timeline(read_recording(folder), start_s=start_s)
        except DamagedArrays:
            if discard(folder):  # there was something, and it was not whole: the recording is read again
                self._bus.publish(RecordingArrived(record))
            raise Conflict("recording.not_read", "The recording has not been read yet; wait for its planes.") from None

    def check_size(self, size_bytes: int) -> None:
        """Raise TooLarge for more than is accepted."""
        most = self._settings.max_upload_bytes
        if size_bytes > most:
            raise TooLarge(
                "upload.too_large",
                f"A recording may have {most / 1e9:.2f} GB, this one has {size_bytes / 1e9:.2f} GB: "
                "cut it, or open it from the server's folder (--recordings).",
            )

    def resume(self, now: datetime) -> None:
        """After a start of the server: finish uploads whose last byte had come, delete those given up long ago."""
        arriving = self._arriving(now)
        self._files.keep_only_uploads([record.id for record in arriving])
        for record in arriving:
            whole = self._files.source(record).is_file() or self.received_bytes(record) == record.size_bytes > 0
            if whole:
                try:
                    self.finish_upload(record.id)
                except TusError as error:
                    _LOG.warning("%s", error)

    def _new(
        self, name: str, origin: Origin, *, source: str, size_bytes: int, state: RecordingState
    ) -> RecordingRecord:
        return RecordingRecord(
            id=uuid.uuid4().hex,
            name=name,
            origin=origin,
            source=source,
            scenario="",
            size_bytes=size_bytes,
            state=state,
            error_json=None,
            read_settings_json=ReadSettings().model_dump_json(),
            report_json=None,
            created_at=datetime.now(UTC),
        )

    def _merged(self, before: ReadSettings, wanted: dict[str, object]) -> ReadSettings:
        """The settings with the wanted ones in place; null means the default, which detects."""
        defaults = ReadSettings().model_dump()
        given = {key: defaults[key] if value is None else value for key, value in wanted.items()}
        try:
            after = ReadSettings.model_validate(before.model_dump() | given)
        except ValidationError as error:
            reason = error.errors()[0]["msg"]
            raise BadRequest("recording.settings", f"These read settings do not fit: {reason}.") from error
        if after.start_s is not None and after.end_s is not None and after.start_s >= after.end_s:
            raise BadRequest(
                "recording.span", f"The time span starts at {after.start_s} s and ends at {after.end_s} s; swap them."
            )
        return after


def reading_of(record: RecordingRecord) -> ReadSettings | None:
    """How the recording is read; None where that cannot be read itself."""
    try:
        return ReadSettings.model_validate_json(record.read_settings_json)
    except ValidationError:
        return None
