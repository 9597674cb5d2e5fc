"""What follows what: a simulated recording arrives, one that arrives is inspected and gets its planes proposed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from app.bus import Bus
from app.errors import ApiError, Conflict
from app.events import JobMoved, JobSaid, RecordingArrived, SampleWanted, ShownChanged
from app.jobs.kept import UNREADABLE, readable_request
from app.jobs.machine import FINAL
from app.jobs.orders import Order, StoredRequest
from app.jobs.service import JobService
from app.limits import JobLimits
from app.planes.service import PlaneService
from app.recordings.service import reading_of
from app.results.extrinsic_text import parse_extrinsic
from app.scene.sources import SceneSources
from app.schemas.audits import NewAudit
from app.schemas.common import ErrorFacts
from app.schemas.jobs import Job, JobKind, NewJob
from app.schemas.recordings import RecordingState
from app.schemas.view import JobChanged, RecordingChanged, View
from app.server.feed import RecordingFeed
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingRecord
from app.storage.store import RecordingStore
from app.work.functions import PROPOSED, REPORTED
from app.work.head import CLOUD
from calib_core import api
from calib_core.events import LogEvent
from calib_core.settings import ReadSettings

#: What starts by itself for a recording that has arrived: side by side, so that the cloud need not wait for the report.
ON_ARRIVAL: tuple[JobKind, ...] = ("planes", "inspect")


def state_after(job: Job, before: RecordingState) -> RecordingState:
    """The recording's state now that its job is in this state. Only simulating and inspecting matter to it."""
    if job.kind not in {"simulate", "inspect"}:
        return before
    if job.state not in FINAL:
        return "receiving" if job.kind == "simulate" else "inspecting"
    if job.state != "done":
        return "failed"
    return "inspecting" if job.kind == "simulate" else "ready"


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
            request=request,
            limits=self._limits,
        )


class Workflow:
    """Starts jobs, and draws the consequences when they change."""

    def __init__(
        self,
        recordings: RecordingStore,
        files: DataFolder,
        jobs: JobService,
        planes: PlaneService,
        feed: RecordingFeed,
        bus: Bus,
        sources: SceneSources,
    ) -> None:
        self._recordings = recordings
        self._files = files
        self._jobs = jobs
        self._planes = planes
        self._feed = feed
        self._bus = bus
        self._sources = sources
        bus.subscribe(JobMoved, lambda event: self.job_changed(event.record, event.job))
        bus.subscribe(JobSaid, lambda event: self.job_said(event.record, event.said))
        bus.subscribe(RecordingArrived, lambda event: self._arrived(event.record))
        bus.subscribe(SampleWanted, lambda event: self._submit(event.record, "simulate"))

    def start(self, record: RecordingRecord, wish: NewJob) -> Job:
        """A job somebody asked for."""
        if record.state == "receiving":
            raise Conflict("recording.receiving", "The recording is still arriving; start the job when it is here.")
        self._files.cache_key(record)  # refuses where the source is gone
        self._jobs.check_room()
        request = StoredRequest(settings=wish.settings, initial_guess=wish.initial_guess)
        if wish.kind == "solve":
            request = request.model_copy(update={"planes": self._planes.confirmed(record.id)})
        return self._jobs.submit(record.id, wish.kind, request)

    def start_audit(self, record: RecordingRecord, wish: NewAudit) -> Job:
        """An audit somebody asked for. What is no extrinsic is refused at once; a URDF's links need the recording's frames."""
        if record.state == "receiving":
            raise Conflict("recording.receiving", "The recording is still arriving; audit it when it is here.")
        self._files.cache_key(record)
        if not wish.extrinsic.lstrip().startswith("<"):
            parse_extrinsic(wish.extrinsic, wish.direction)
        return self._jobs.submit(record.id, "audit", StoredRequest(audit=wish))

    def see_to_surface(self, record: RecordingRecord, view: View) -> None:
        """Have the surface laid that a view asks for, once for each solve: one that failed is asked for by retrying."""
        if view.mode != "inspect" or view.extent != "surface":
            return
        solved = self._sources.solved(record, view.job_id)
        if solved is None or solved.surface is not None:
            return
        if self._sources.surface_job(record, solved.job_id) is None:
            self._jobs.submit(record.id, "surface", StoredRequest(surface_of=solved.job_id))

    def retry(self, job: JobRecord) -> Job:
        """The same again."""
        if job.state not in FINAL:
            raise Conflict("job.under_way", f"The job is still {job.state}; cancel it first, or wait.")
        request = readable_request(job)
        if request is None:
            raise Conflict(UNREADABLE.code, UNREADABLE.text)
        self._jobs.check_room()
        return self._jobs.submit(job.recording_id, job.kind, request, retry_of=job.id)

    def job_changed(self, record: JobRecord, job: Job) -> None:
        """Draw the consequences of a job's new state, and tell those who look."""
        recording = self._recordings.find(record.recording_id)
        if recording is None:
            return
        self._keep_consequences(recording, job)
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
            self._arrived(recording)
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
        recording = self._recordings.find(job.recording_id)
        if recording is None or recording.state != "inspecting":
            return
        with suppress(FileNotFoundError):  # deleted meanwhile
            self._recordings.save(replace(recording, report_json=self._report_of(job.id)))
            self._feed.tell(recording.id, RecordingChanged())

    def _report_of(self, job_id: str) -> str:
        return (self._files.job(job_id) / "report.json").read_text(encoding="utf-8")

    def _proposed(self, recording_id: str) -> None:
        with suppress(ApiError):  # read another way meanwhile: its own job is on the way
            self._planes.proposed(recording_id)
            self._feed.tell(recording_id, RecordingChanged())

    def _keep_consequences(self, recording: RecordingRecord, job: Job) -> None:
        state = state_after(job, recording.state)
        changed = replace(recording, state=state)
        if state != recording.state:
            error = job.error or ErrorFacts(code=f"job.{job.state}", text=job.state_text)
            changed = replace(changed, error_json=error.model_dump_json() if state == "failed" else None)
        if job.state == "done" and job.kind == "simulate":
            changed = replace(changed, size_bytes=self._files.source(recording).stat().st_size)
        if job.state == "done" and job.kind == "inspect":
            changed = replace(changed, report_json=self._report_of(job.id))
        if changed != recording:
            self._recordings.save(changed)
            self._feed.tell(recording.id, RecordingChanged())

    def _arrived(self, record: RecordingRecord) -> None:
        for kind in ON_ARRIVAL:
            self._submit(record, kind)

    def _submit(self, record: RecordingRecord, kind: JobKind) -> None:
        self._jobs.submit(record.id, kind, StoredRequest())
