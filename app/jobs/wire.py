"""A job as the wire carries it, and what is said of one that was stopped or died."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.jobs.state_machine import sentence_of
from app.jobs.stored_parts import error_of, outcome_of, request_of
from app.schemas.common import ErrorFacts
from app.schemas.jobs import Job, PlaneLook
from app.storage.records import JobRecord

STOPPED = ErrorFacts(code="job.stopped", text="The job stopped by itself; run it again.")
DIED = ErrorFacts(
    code="job.died",
    text="The job's process ended without an error message, probably because memory ran out: choose a shorter time span.",
)


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a running job is."""

    stage: str | None = None
    fraction: float = 0.0
    text: str = ""


def job_of(record: JobRecord, progress: Progress | None, *, place: int | None, looks: Sequence[PlaneLook]) -> Job:
    """The job. progress: None where it does not run.   place: in the queue.   looks: how its planes are shown."""
    progress = progress or Progress(fraction=1.0 if record.state == "done" else 0.0)
    return Job(
        id=record.id,
        recording_id=record.recording_id,
        kind=record.kind,
        state=record.state,
        state_text=sentence_of(record.state, place),
        queue_place=place,
        stage=progress.stage,
        fraction=progress.fraction,
        text=progress.text,
        error=error_of(record),
        settings=request_of(record).settings,
        planes=list(looks),
        result=outcome_of(record),
        retry_of=record.retry_of,
        created_at=record.created_at,
        started_at=record.started_at,
        ended_at=record.ended_at,
    )


def too_long(limit_s: float) -> ErrorFacts:
    """Why a job that ran into the limit was stopped."""
    longest = f"{limit_s / 60:.0f} min" if limit_s >= 120 else f"{limit_s:.3g} s"
    return ErrorFacts(
        code="job.too_long",
        text=f"The job was stopped after {longest}, the longest that this server lets one run: choose a shorter time "
        "span, or ask whoever runs the server for a longer limit.",
    )
