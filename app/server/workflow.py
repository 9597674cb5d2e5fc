"""What follows what: a simulated recording arrives, one that arrives is inspected and gets its planes proposed."""

from __future__ import annotations

import logging
from collections.abc import Collection
from contextlib import suppress
from dataclasses import replace

from pydantic import ValidationError

from app.bus import Bus
from app.errors import ApiError, Conflict
from app.events import JobMoved, JobSaid, RecordingArrived, SampleWanted, ShownChanged
from app.jobs.orders import READING, Order, StoredRequest
from app.jobs.service import JobService
from app.jobs.state_machine import FINAL
from app.jobs.stored_parts import BY_ITSELF, UNREADABLE, begins_again, readable_request, request_of
from app.limits import JobLimits
from app.planes.service import PlaneService
from app.recordings.folder import RecordingsFolder
from app.recordings.service import reading_of, require_arrived
from app.results.extrinsic_text import parse_extrinsic
from app.scene.sources import SceneSources
from app.schemas.audits import NewAudit
from app.schemas.jobs import Job, JobKind, NewJob
from app.schemas.view import JobChanged, RecordingChanged, View
from app.server.consequences import TELLING
from app.server.feed import RecordingFeed
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingChanges, RecordingRecord
from app.storage.store import RecordingStore
from app.work.functions import PROPOSED, REPORTED, meant_guess
from app.work.head import CLOUD
from calib_core import api
from calib_core.events import LogEvent
from calib_core.settings import ReadSettings

_LOG = logging.getLogger("unsweep")
#: What starts by itself for a recording that has arrived: side by side, so that the cloud need not wait for the report.
ON_ARRIVAL: tuple[JobKind, ...] = ("planes", "inspect")


class Orders:
    """What workers are told."""

    def __init__(self, recordings: RecordingStore, files: DataFolder, limits: JobLimits) -> None:
        self._recordings = recordings
        self._files = files
        self._limits = limits

    def of(self, job: JobRecord) -> Order:
        """What the job's worker is told; Conflict where it can no longer be done."""
        record = self._recordings.find(job.recording_id)
        if record is None:
            raise Conflict("recording.deleted", "The recording was deleted before its job started.")
        request = readable_request(job)
        if request is None:
            raise Conflict(UNREADABLE.code, UNREADABLE.text)
        _require_same_reading(job.kind, request, record)
        return Order(
            job_id=job.id,
            kind=job.kind,
            recording_name=record.name,
            source=self._files.source(record),
            # A sample has no bytes to make a key of before it is simulated.
            cache=self._files.recording(record.id) if job.kind == "simulate" else self._files.cache(record),
            folder=self._files.job(job.id),
            unpacked=self._files.unpacked(record.id),
            scenario=record.scenario,
            read_settings=reading_of(record) or ReadSettings(),
            source_stamp=record.source_stamp,
            request=request,
            limits=self._limits,
        )


class Workflow:
    """Starts jobs, and what follows from them when they change. What they mean for a recording's row is in consequences.py."""

    def __init__(
        self,
        recordings: RecordingStore,
        files: DataFolder,
        jobs: JobService,
        planes: PlaneService,
        feed: RecordingFeed,
        bus: Bus,
        sources: SceneSources,
        folder: RecordingsFolder,
    ) -> None:
        self._recordings = recordings
        self._files = files
        self._jobs = jobs
        self._planes = planes
        self._feed = feed
        self._bus = bus
        self._sources = sources
        self._folder = folder
        bus.subscribe(JobMoved, lambda event: self.job_changed(event.record, event.job))
        bus.subscribe(JobSaid, lambda event: self.job_said(event.record, event.said))
        bus.subscribe(RecordingArrived, lambda event: self._arrived(event.record))
        bus.subscribe(SampleWanted, lambda event: self._submit(event.record, "simulate"))

    def start(self, record: RecordingRecord, wish: NewJob) -> Job:
        """A job somebody asked for."""
        require_arrived(record, "start the job")
        api.check_settings(wish.settings, meant_guess(wish.initial_guess))  # now, and not only when its turn has come
        if wish.kind == "inspect" and self._files.has_changed(record):
            return self._inspect_another(record)
        self._files.cache_key(record)  # refuses where the source is gone, or is another one
        self._jobs.check_room()
        request = StoredRequest(settings=wish.settings, initial_guess=wish.initial_guess).model_copy(
            update=_as_read(record)
        )
        if wish.kind == "solve":
            request = request.model_copy(update={"planes": self._planes.confirmed(record.id)})
        return self._jobs.submit(record.id, wish.kind, request)

    def start_audit(self, record: RecordingRecord, wish: NewAudit) -> Job:
        """An audit somebody asked for. What is no extrinsic is refused at once; a URDF's links need the recording's frames."""
        require_arrived(record, "audit it")
        self._files.cache_key(record)
        if api.asks_for_frames(wish.extrinsic):
            api.check_urdf(wish.extrinsic)
        else:
            parse_extrinsic(wish.extrinsic, wish.direction)
        self._jobs.check_room()
        return self._jobs.submit(record.id, "audit", StoredRequest(audit=wish).model_copy(update=_as_read(record)))

    def see_to_surface(self, record: RecordingRecord, view: View) -> None:
        """Have the surface laid that a view asks for, once for each solve: one that failed is asked for by retrying."""
        if view.mode != "inspect" or view.extent != "surface":
            return
        solved = self._sources.solved(record, view.job_id)
        if solved is None or solved.surface is not None:
            return
        if self._sources.surface_job(record, solved.job_id) is None:
            self._jobs.check_room()
            of_solve = request_of(self._jobs.get(solved.job_id))
            request = StoredRequest(
                surface_of=solved.job_id, read_settings=of_solve.read_settings, source_stamp=of_solve.source_stamp
            )
            self._jobs.submit(record.id, "surface", request)

    def retry(self, job: JobRecord) -> Job:
        """A new job with what the ended one was asked for; Conflict while that is under way, or would be another solve."""
        if job.state not in FINAL:
            raise Conflict("job.under_way", f"The job is still {job.state}; cancel it first, or wait.")
        request = readable_request(job)
        if request is None:
            raise Conflict(UNREADABLE.code, UNREADABLE.text)
        request = request.model_copy(update={"read_settings": request.read_settings or self._read_with(job)})
        record = self._recordings.find(job.recording_id)
        if record is not None:
            if job.kind == "inspect" and self._files.has_changed(record):
                return self._inspect_another(record)
            _require_same_reading(job.kind, request, record)
            if job.kind in BY_ITSELF:
                request = request.model_copy(update=_as_read(record))
        self._jobs.check_room()
        return self._jobs.submit(job.recording_id, job.kind, request, retry_of=job.id)

    def _read_with(self, job: JobRecord) -> ReadSettings | None:
        """How a solve has read its recording, of which an earlier version kept nothing but this; None where it came to no end."""
        try:
            return ReadSettings.model_validate_json((self._files.job(job.id) / READING).read_text(encoding="utf-8"))
        except (OSError, ValidationError):
            return None

    def take_up(self) -> None:
        """After a start of the server: begin again what an earlier one ended under, and what it left without a job."""
        for job in self._jobs.interrupted():
            if begins_again(job, self._jobs.records_of(job.recording_id)):
                try:
                    self._jobs.submit(job.recording_id, job.kind, request_of(job), retry_of=job.id)
                except ApiError as error:
                    _LOG.warning("the %s that was interrupted is still to be done: %s", job.kind, error)
        for record in self._recordings.in_states(["inspecting", "receiving"]):
            try:
                self._take_up(record.id)
            except ApiError as error:  # a full disk keeps no server from starting; the next one tries again
                _LOG.warning("%s is still to be read: %s", record.name, error)

    def _take_up(self, recording_id: str) -> None:
        under_way = {job.kind for job in self._jobs.records_of(recording_id) if job.state not in FINAL}
        record = self._recordings.find(recording_id)  # after its jobs: one that ends changes both at once
        if record is None:
            return
        if record.state == "inspecting" and "inspect" not in under_way:
            self._arrived(record, but=under_way)
        elif (record.state, record.origin) == ("receiving", "sample") and "simulate" not in under_way:
            self._submit(record, "simulate")

    def job_changed(self, record: JobRecord, job: Job) -> None:
        """Begin what follows from a job's new state, and tell those who look. Told twice of one, it begins nothing twice."""
        recording = self._recordings.find(record.recording_id)
        if recording is None:
            return
        if job.kind in TELLING and job.state != "running":
            self._feed.tell(recording.id, RecordingChanged())
        self._feed.tell(recording.id, JobChanged(job=job))
        if job.state == "done" and job.kind == "planes":
            self._proposed(recording.id)
        # A report names the planes and tells which way is up.
        if (
            (job.kind in {"planes", "solve"} and job.state in {"done", "running"})
            or (job.kind, job.state) == ("inspect", "done")
            or (job.kind == "surface" and job.state in FINAL)
        ):
            self._bus.publish(ShownChanged(recording.id))
        if job.state == "done" and job.kind == "simulate":
            later = (other for other in self._jobs.records_of(recording.id) if other.sequence > record.sequence)
            self._arrived(recording, but={other.kind for other in later})
        if job.state in FINAL and all(other.state in FINAL for other in self._jobs.records_of(recording.id)):
            # Its arrays are all that is needed from now on. Who reads it another way unpacks it again.
            api.discard_archives(self._files.unpacked(recording.id))

    def job_said(self, record: JobRecord, said: LogEvent) -> None:
        """Show planes as soon as there are any, and what a report says already: their jobs go on with the rest."""
        if said.code == CLOUD:
            self._bus.publish(ShownChanged(record.recording_id))
        if said.code == PROPOSED:
            self._proposed(record.recording_id)
        if said.code == REPORTED:
            self._reported(record)

    def _reported(self, job: JobRecord) -> None:
        with suppress(FileNotFoundError):  # deleted meanwhile
            said = (self._files.job(job.id) / "report.json").read_text(encoding="utf-8")
            if self._recordings.change(job.recording_id, {"report_json": said}, where={"state": "inspecting"}):
                self._feed.tell(job.recording_id, RecordingChanged())

    def _proposed(self, recording_id: str) -> None:
        with suppress(ApiError):  # read another way meanwhile: its own job is on the way
            self._planes.proposed(recording_id)
            self._feed.tell(recording_id, RecordingChanged())

    def _arrived(self, record: RecordingRecord, *, but: Collection[JobKind] = ()) -> None:
        """Begin what a recording that is here needs.   but: what has begun already."""
        for kind in ON_ARRIVAL:
            if kind not in but:
                self._submit(record, kind)

    def _inspect_another(self, record: RecordingRecord) -> Job:
        """The inspection of what was put in the place of a recording's source. Its planes are looked for anew with it."""
        self._folder.require_inside(self._files.source(record))
        self._jobs.check_room()
        self._jobs.stop_all_of(record.id)
        anew: RecordingChanges = {"state": "inspecting", "error_json": None, **self._files.as_it_is_now(record)}
        self._recordings.change(record.id, anew)
        record = replace(record, **anew)
        self._submit(record, "planes")
        return self._jobs.submit(record.id, "inspect", StoredRequest().model_copy(update=_as_read(record)))

    def _submit(self, record: RecordingRecord, kind: JobKind) -> None:
        self._jobs.submit(record.id, kind, StoredRequest().model_copy(update=_as_read(record)))


def _as_read(record: RecordingRecord) -> dict[str, object]:
    """Of which bytes, read how, a job is asked for."""
    return {"read_settings": reading_of(record), "source_stamp": record.source_stamp}


def _require_same_reading(kind: JobKind, request: StoredRequest, record: RecordingRecord) -> None:
    """Raises Conflict where a job was asked for of the recording as it was read earlier: a solve's planes are in the frame of a
    scan that may be none any more, its spans count from another one; an audit's extrinsic may be of another lidar. What begins by
    itself looks at the recording as it is.
    """
    if kind in BY_ITSELF:
        return
    if request.source_stamp not in {"", record.source_stamp}:
        raise Conflict(
            "job.read_otherwise",
            "The recording's file was replaced since this job was asked for, so that its planes and spans, or its sensors, no "
            "longer fit; start a new one.",
        )
    if request.read_settings is not None and request.read_settings != reading_of(record):
        raise Conflict(
            "job.read_otherwise",
            "The recording is read in another way since this job was asked for, so that its planes and spans, or its sensors, no "
            "longer fit; start a new one.",
        )
