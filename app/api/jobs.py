"""Jobs: start, look, cancel, run again, and the stream of what happens inside."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.sse import EventSourceResponse

from app.schemas.jobs import Job, JobMessage, NewJob
from app.server.deps import JobDep, RecordingDep, ServicesDep

router = APIRouter(prefix="/api", tags=["jobs"])


@router.get("/recordings/{recording_id}/jobs")
def list_jobs(services: ServicesDep, recording: RecordingDep) -> list[Job]:
    """All jobs of a recording, newest first."""
    return services.jobs.list_of(recording.id)


@router.post("/recordings/{recording_id}/jobs", status_code=201)
def start_job(services: ServicesDep, recording: RecordingDep, wish: NewJob) -> Job:
    """Queue a job. It starts when one of the server's slots is free."""
    return services.workflow.start(recording, wish)


@router.get("/jobs/{job_id}")
def read_job(services: ServicesDep, job: JobDep) -> Job:
    """One job as it stands."""
    return services.jobs.wire(job)


@router.post("/jobs/{job_id}/cancel")
def cancel_job(services: ServicesDep, job: JobDep) -> Job:
    """Ask the job to stop; after two seconds it is stopped. 409 where it has ended already."""
    return services.jobs.cancel(job.id)


@router.post("/jobs/{job_id}/retry", status_code=201)
def retry_job(services: ServicesDep, job: JobDep) -> Job:
    """A new job with the same settings. 409 while the old one is still under way."""
    return services.workflow.retry(job)


@router.get("/jobs/{job_id}/events", response_class=EventSourceResponse)
async def watch_job(
    services: ServicesDep,
    job: JobDep,
    last_event_id: Annotated[str | None, Header(description="resume after this message")] = None,
) -> AsyncIterator[JobMessage]:
    """The job's messages from its start, as server-sent events; `data` is one JSON message.

    At most 20 a second. The stream ends after the final `state` message: close the EventSource then.
    """
    async for message in services.jobs.watch(job.id, last_event_id):
        yield message
