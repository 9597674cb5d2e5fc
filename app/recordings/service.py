"""Recordings: opening, receiving, changing, deleting. Work on them is the workflow's."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime

import anyio.to_thread
from fastapi import Request
from pydantic import ValidationError
from starlette.requests import ClientDisconnect

from app.arrays.proposals import has_proposals
from app.arrays.recording import has_recording, read_recording
from app.jobs.functions import proposal_arrays, recording_arrays
from app.jobs.service import JobService
from app.recordings.folder import RecordingsFolder
from app.recordings.timeline import make_timeline
from app.recordings.verdict import verdict_of
from app.schemas.common import ErrorFacts
from app.schemas.recordings import ChangeRecording, OpenRecording, Origin, Recording, RecordingState, Timeline
from app.schemas.report import Report
from app.server.errors import BadRequest, Conflict, NotFound, TooLarge
from app.server.settings import AppSettings
from app.storage.files import DataFolder, display_name, suffix_of
from app.storage.records import RecordingRecord
from app.storage.sizes import tree_size
from app.storage.store import RecordingStore
from calib_core import api
from calib_core.settings import ReadSettings

#: Bytes gathered before they are handed to a thread for writing.
WRITE_BYTES = 4 * 2**20


class RecordingService:
    """All recordings of the application.

    on_arrived: called when a recording can be inspected; on_wanted: when a sample is to be made; on_reread: when it is
    to be read another way; on_changed, on_deleted: when browsers should look again.
    """

    def __init__(
        self,
        store: RecordingStore,
        files: DataFolder,
        folder: RecordingsFolder,
        jobs: JobService,
        *,
        settings: AppSettings,
    ) -> None:
        self._store = store
        self._files = files
        self._folder = folder
        self._jobs = jobs
        self._settings = settings
        self.on_arrived: Callable[[RecordingRecord], None] = lambda _: None
        self.on_wanted: Callable[[RecordingRecord], None] = lambda _: None
        self.on_changed: Callable[[str], None] = lambda _: None
        self.on_deleted: Callable[[str], None] = lambda _: None

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
        """The recording as the wire carries it."""
        return Recording(
            id=record.id,
            name=record.name,
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

    def _has_planes(self, record: RecordingRecord) -> bool:
        try:
            return has_proposals(proposal_arrays(self._files.cache(record)))
        except NotFound:  # its source is gone, or is still to come
            return False

    def received_bytes(self, record: RecordingRecord) -> int:
        """How much of an upload has arrived."""
        if record.origin == "upload" and record.state == "receiving":
            upload = self._files.upload(record.id)
            return upload.stat().st_size if upload.is_file() else 0
        return record.size_bytes

    def open(self, wish: OpenRecording) -> Recording:
        """A new recording from the server's folder, or a sample to be made."""
        if wish.folder_path is not None:
            path = self._folder.recording(wish.folder_path)
            record = self._new(path.name, "folder", source=str(path), size_bytes=tree_size(path), state="inspecting")
            self._store.add(record)
            self.on_arrived(record)
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
        self.on_wanted(record)
        return self.wire(self.get(record.id))

    def announce_upload(self, name: str, size_bytes: int) -> RecordingRecord:
        """A recording whose bytes are about to arrive; refused where they would not fit."""
        suffix = suffix_of(name)
        self.check_size(size_bytes)
        self._files.check_room(size_bytes)
        record = self._new(
            display_name(name), "upload", source=f"source{suffix}", size_bytes=size_bytes, state="receiving"
        )
        self._store.add(record)
        return record

    def finish_upload(self, recording_id: str) -> None:
        """The last byte is here. Called again for the same upload it does nothing."""
        record = self.get(recording_id)
        if record.state != "receiving":
            return
        upload, source = self._files.upload(record.id), self._files.source(record)
        source.parent.mkdir(parents=True, exist_ok=True)
        # A second name for the same bytes: a client that lost the last answer can still ask how far it got.
        source.unlink(missing_ok=True)
        try:
            source.hardlink_to(upload)
        except OSError:
            upload.rename(source)
        record = self._store.save(replace(record, state="inspecting", size_bytes=source.stat().st_size))
        self.on_arrived(record)

    async def receive(self, name: str, request: Request) -> Recording:
        """A recording from one request's body, written as it comes."""
        announced = int(request.headers.get("content-length", "0"))
        record = await anyio.to_thread.run_sync(self.announce_upload, name, announced)
        try:
            await self._write_body(record, request)
        except BaseException:
            with anyio.CancelScope(shield=True):
                await anyio.to_thread.run_sync(self.delete, record)
            raise
        await anyio.to_thread.run_sync(self.finish_upload, record.id)
        return self.wire(self.get(record.id))

    def change(self, record: RecordingRecord, change: ChangeRecording) -> Recording:
        """The recording renamed or to be read another way; in the latter case it is inspected again."""
        wanted = change.model_dump(exclude_unset=True, exclude={"name"})
        if change.name is not None:
            record = self._store.save(replace(record, name=display_name(change.name)))
        before = ReadSettings.model_validate_json(record.read_settings_json)
        after = self._merged(before, wanted)
        if after != before:
            if record.state == "receiving":
                raise Conflict("recording.receiving", "The recording is still arriving; change it when it is here.")
            self._jobs.stop_all_of(record.id)
            record = self._store.save(
                replace(record, read_settings_json=after.model_dump_json(), state="inspecting", error_json=None)
            )
            self.on_arrived(record)
        self.on_changed(record.id)
        return self.wire(self.get(record.id))

    def delete(self, record: RecordingRecord) -> None:
        """Stop its jobs and remove all that is ours of it."""
        self._jobs.stop_all_of(record.id)
        job_ids = [job.id for job in self._jobs.records_of(record.id)]
        self._store.remove(record.id)
        self._files.remove_recording(record.id, job_ids)
        self.on_deleted(record.id)

    def timeline(self, record: RecordingRecord) -> Timeline:
        """The recording over time."""
        folder = recording_arrays(self._files.cache(record))
        if not has_recording(folder):
            raise Conflict("recording.not_read", "The recording has not been read yet; wait for its planes.")
        start_s = ReadSettings.model_validate_json(record.read_settings_json).start_s or 0.0
        return make_timeline(read_recording(folder), start_s=start_s)

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
        for record in self._store.all_newest_first():
            if record.origin != "upload" or record.state != "receiving":
                continue
            upload = self._files.upload(record.id)
            if upload.is_file() and record.size_bytes > 0 and upload.stat().st_size == record.size_bytes:
                self.finish_upload(record.id)
                continue
            last = datetime.fromtimestamp(upload.stat().st_mtime, UTC) if upload.is_file() else record.created_at
            if (now - last).days >= self._settings.upload_expiry_days:
                self.delete(record)

    async def _write_body(self, record: RecordingRecord, request: Request) -> None:
        written = 0
        gathered = bytearray()
        async with await anyio.open_file(self._files.upload(record.id), "wb") as file:
            try:
                async for chunk in request.stream():
                    gathered += chunk
                    written += len(chunk)
                    self.check_size(written)
                    if len(gathered) >= WRITE_BYTES:
                        await anyio.to_thread.run_sync(self._files.check_room, len(gathered))
                        await file.write(gathered)
                        gathered = bytearray()
            except ClientDisconnect:
                raise BadRequest(
                    "upload.cut", f"The upload ended after {written} bytes; send the whole file again, or use tus."
                ) from None
            await file.write(gathered)
        if written == 0:
            raise BadRequest("upload.empty", f"The file {record.name} is empty; choose one with messages in it.")

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
