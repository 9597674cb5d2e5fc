"""Recordings: opening, changing, deleting. How they come here is in arrivals.py; work on them is the workflow's."""

from __future__ import annotations

import json
import logging
import uuid
from dataclasses import replace
from datetime import UTC, datetime

from pydantic import ValidationError

from app.arrays.folder import DamagedArrays, discard
from app.arrays.proposals import has_proposals, proposal_arrays
from app.arrays.recording import has_recording, read_recording, recording_arrays
from app.bus import Bus
from app.errors import BadRequest, Conflict, NotFound
from app.events import RecordingArrived, RecordingDeleted, RecordingEdited, SampleWanted
from app.jobs.service import JobService
from app.recordings.folder import RecordingsFolder
from app.recordings.kept_report import verdict_of
from app.recordings.timeline import make_timeline
from app.schemas.common import ErrorFacts
from app.schemas.recordings import ChangeRecording, OpenRecording, Origin, Recording, RecordingState, Timeline
from app.storage.files import DataFolder, shown_name
from app.storage.records import RecordingChanges, RecordingRecord
from app.storage.sizes import source_stamp, tree_size
from app.storage.store import DocumentStore, RecordingStore
from calib_core import api
from calib_core.doctor.report import DoctorReport
from calib_core.settings import ReadSettings
from calib_core.validation_messages import misfit

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
    ) -> None:
        self._store = store
        self._documents = documents
        self._files = files
        self._folder = folder
        self._jobs = jobs
        self._bus = bus

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
        state, error = self._standing(record)
        return Recording(
            id=record.id,
            name=record.name,
            note=self._note_of(record),
            size_bytes=record.size_bytes,
            received_bytes=self.received_bytes(record),
            origin=record.origin,
            state=state,
            error=error,
            read_settings=ReadSettings.model_validate_json(record.read_settings_json),
            report=None if record.report_json is None else DoctorReport.model_validate_json(record.report_json),
            has_planes=self._has_planes(record),
            created_at=record.created_at,
            latest_job=self._jobs.latest(record.id),
            latest_answer=self._jobs.latest_answer(record.id),
            verdict=verdict_of(record),
        )

    def _standing(self, record: RecordingRecord) -> tuple[RecordingState, ErrorFacts | None]:
        """The recording's state and why: one whose source is not what was inspected is of no use before it is inspected again."""
        if record.state in {"ready", "failed"}:
            try:
                self._files.cache_key(record)
            except Conflict as changed:
                return "failed", ErrorFacts(code=changed.code, text=str(changed))
            except NotFound:
                pass  # told when it is needed: a disk may come back
        return record.state, None if record.error_json is None else ErrorFacts.model_validate_json(record.error_json)

    def _note_of(self, record: RecordingRecord) -> str:
        try:
            note = json.loads(self._documents.read(record.id, NOTE) or '""')
        except ValueError:  # somebody else's words in the store cost the note, not the list
            return ""
        return note if isinstance(note, str) else ""

    def _has_planes(self, record: RecordingRecord) -> bool:
        try:
            return has_proposals(proposal_arrays(self._files.cache(record)))
        except (NotFound, Conflict):  # its source is gone, or is still to come
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
            record = new_record(path.name, "folder", source=str(path), size_bytes=tree_size(path), state="inspecting")
            record = replace(record, source_stamp=source_stamp(path))
            self._store.add(record)
            self._bus.publish(RecordingArrived(record))
            return self.wire(self.get(record.id))
        scenario = wish.sample or ""
        if scenario not in api.scenarios():
            raise BadRequest(
                "sample.unknown",
                f"No sample is called {scenario!r}; there are {', '.join(api.scenarios())}.",
            )
        record = new_record(f"{scenario}.bag", "sample", source="source.bag", size_bytes=0, state="receiving")
        record = replace(record, scenario=scenario)
        self._store.add(record)
        self._bus.publish(SampleWanted(record))
        return self.wire(self.get(record.id))

    def change(self, record: RecordingRecord, change: ChangeRecording) -> Recording:
        """The recording renamed or to be read another way; in the latter case it is inspected again."""
        wanted = change.model_dump(exclude_unset=True, exclude={"name", "note"})
        if change.name is not None:
            self._store.change(record.id, {"name": _name_of(change.name)})
        if change.note is not None:
            self._documents.write(record.id, NOTE, json.dumps(change.note.strip()))
        if self._merged(record, wanted) != reading_of(record):
            require_arrived(record, "change it")
            if self._files.has_changed(record):
                self._folder.require_inside(self._files.source(record))
            self._jobs.stop_all_of(record.id)
            self._bus.publish(RecordingArrived(self._read_otherwise(record, wanted)))
        self._bus.publish(RecordingEdited(record.id))
        return self.wire(self.get(record.id))

    def _read_otherwise(self, record: RecordingRecord, wanted: dict[str, object]) -> RecordingRecord:
        """The recording with the wanted settings among those that it has by now: jobs took their time to stop."""
        while True:
            settings_json = self._merged(record, wanted).model_dump_json()
            changes: RecordingChanges = {
                "read_settings_json": settings_json,
                "state": "inspecting",
                "error_json": None,
                **self._files.as_it_is_now(record),
            }
            as_read: RecordingChanges = {"read_settings_json": record.read_settings_json}
            done = self._store.change(record.id, changes, where=as_read)
            record = self.get(record.id)
            if done:
                return record

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

    def _merged(self, record: RecordingRecord, wanted: dict[str, object]) -> ReadSettings:
        """The settings with the wanted ones in place; null means the default, which detects."""
        before = reading_of(record) or ReadSettings()
        defaults = ReadSettings().model_dump()
        given = {key: defaults[key] if value is None else value for key, value in wanted.items()}
        try:
            after = ReadSettings.model_validate(before.model_dump() | given)
        except ValidationError as error:
            raise BadRequest(
                "recording.settings", f"These read settings do not fit: {misfit(error.errors()[0])}."
            ) from error
        if after.start_s is not None and after.end_s is not None and after.start_s >= after.end_s:
            raise BadRequest(
                "recording.span", f"The time span starts at {after.start_s} s and ends at {after.end_s} s; swap them."
            )
        return after


def _name_of(wanted: str) -> str:
    """The name that a person gives a recording; a slash is a letter of it."""
    name = shown_name(wanted)
    if not name:
        raise BadRequest(
            "recording.name", "Expected a name that can be seen, but found none; give at least one letter."
        )
    return name


def new_record(name: str, origin: Origin, *, source: str, size_bytes: int, state: RecordingState) -> RecordingRecord:
    """A recording that nobody knows yet."""
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
        file_name=name,
    )


def require_arrived(record: RecordingRecord, what: str) -> None:
    """Raise Conflict for a recording that is not here yet.   what: somebody wants to do with it, as "start the job"."""
    if record.state == "receiving":
        raise Conflict("recording.receiving", f"The recording is still arriving; {what} when it is here.")


def reading_of(record: RecordingRecord) -> ReadSettings | None:
    """How the recording is read; None where that cannot be read itself."""
    try:
        return ReadSettings.model_validate_json(record.read_settings_json)
    except ValidationError:
        return None
