"""Annotated dependencies: the services, and records that a path names (loaded once, or 404)."""

from __future__ import annotations

from typing import Annotated, cast

from fastapi import Depends, Path
from starlette.requests import HTTPConnection

from app.server.services import Services
from app.storage.records import JobRecord, RecordingRecord

_ID = Path(pattern="^[0-9a-f]{32}$", description="32 hexadecimal digits")


def get_services(connection: HTTPConnection) -> Services:
    """The services of the application this request came to."""
    return cast(Services, connection.app.state.services)


ServicesDep = Annotated[Services, Depends(get_services)]


def get_recording(services: ServicesDep, recording_id: Annotated[str, _ID]) -> RecordingRecord:
    """The recording named in the path."""
    return services.recordings.get(recording_id)


def get_job(services: ServicesDep, job_id: Annotated[str, _ID]) -> JobRecord:
    """The job named in the path."""
    return services.jobs.get(job_id)


RecordingDep = Annotated[RecordingRecord, Depends(get_recording)]
JobDep = Annotated[JobRecord, Depends(get_job)]
