"""What a job's state means for its recording: columns of its row, which are written in the job's own transaction."""

from __future__ import annotations

from app.jobs.state_machine import FINAL, SENTENCES
from app.jobs.stored_parts import MOST_INTERRUPTIONS, begins_again, error_of, outcome_of, request_of
from app.schemas.common import ErrorFacts
from app.schemas.jobs import JobKind, JobState, SimulateOutcome
from app.schemas.recordings import RecordingState
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingChanges
from app.storage.store import JobStore
from calib_core.settings import ReadSettings

#: Only these matter to the state of a recording: it is made, and it is looked at.
TELLING: frozenset[JobKind] = frozenset({"simulate", "inspect"})

REPORT_LOST = ErrorFacts(
    code="recording.report_lost",
    text="The report on this recording was written and cannot be read any more; have the recording read again.",
)
KEEPS_STOPPING = ErrorFacts(
    code="job.interrupted",
    text=f"The server stopped {MOST_INTERRUPTIONS} times in a row while this recording was being read, which may be the reason: "
    "choose a shorter time span, or have it inspected again.",
)


def state_after(kind: JobKind, state: JobState) -> RecordingState:
    """The recording's state now that its job, one of those that tell, is in this state."""
    if state not in FINAL:
        return "receiving" if kind == "simulate" else "inspecting"
    if state != "done":
        return "failed"
    return "inspecting" if kind == "simulate" else "ready"


class Consequences:
    """What jobs mean for their recordings."""

    def __init__(self, jobs: JobStore, files: DataFolder) -> None:
        self._jobs = jobs
        self._files = files

    def of(self, job: JobRecord) -> RecordingChanges:
        """The columns that change with the job's new state; none where it does not matter, or a newer job of its kind tells."""
        if job.kind not in TELLING or self._is_outdone(job):
            return {}
        if begins_again(job, self._jobs.of_recording(job.recording_id)):
            return {"state": state_after(job.kind, "queued"), "error_json": None}
        if job.state == "cancelled" and job.kind == "inspect" and (earlier := self._told_before(job)) is not None:
            return self._inspected(earlier)
        state = state_after(job.kind, job.state)
        if job.state == "interrupted":
            return {"state": state, "error_json": KEEPS_STOPPING.model_dump_json()}
        if state == "failed":
            error = error_of(job) or ErrorFacts(code=f"job.{job.state}", text=SENTENCES[job.state])
            return {"state": state, "error_json": error.model_dump_json()}
        if job.state != "done":
            return {"state": state, "error_json": None}
        if job.kind == "inspect":
            return self._inspected(job)
        made = outcome_of(job)
        sizes: RecordingChanges = {"size_bytes": made.size_bytes} if isinstance(made, SimulateOutcome) else {}
        return {"state": state, "error_json": None, **sizes}

    def _is_outdone(self, job: JobRecord) -> bool:
        """Whether a later one of its kind was asked for: an inspection that ends late says nothing of how it is read now."""
        if job.state == "queued":
            return False  # as yet it is the newest
        others = self._jobs.of_recording(job.recording_id)
        return any(other.kind == job.kind and other.sequence > job.sequence for other in others)

    def _told_before(self, job: JobRecord) -> JobRecord | None:
        """The inspection whose report holds still, now that this one was stopped: of the same bytes, read in the same way."""
        asked = _of_what(job)
        earlier = (one for one in self._jobs.of_recording(job.recording_id) if one.sequence < job.sequence)
        done = (one for one in earlier if one.kind == "inspect" and one.state == "done" and _of_what(one) == asked)
        return None if asked is None else next(done, None)

    def _inspected(self, job: JobRecord) -> RecordingChanges:
        try:
            report_json = (self._files.job(job.id) / "report.json").read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return {"state": "failed", "error_json": REPORT_LOST.model_dump_json()}
        return {"state": "ready", "error_json": None, "report_json": report_json}


def _of_what(job: JobRecord) -> tuple[ReadSettings, str] | None:
    """How a job reads its recording, and of which source; None where an earlier version did not keep that."""
    request = request_of(job)
    return None if request.read_settings is None else (request.read_settings, request.source_stamp)
