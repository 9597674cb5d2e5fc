"""Annotated dependencies: the services, and records that a path names (loaded once, or 404)."""

from __future__ import annotations

from typing import Annotated, cast

from fastapi import Depends, Path, Query
from starlette.requests import HTTPConnection

from app.schemas.common import ID_PATTERN
from app.server.services import Services
from app.server.share import other_recording
from app.storage.records import JobRecord, RecordingRecord

_ID = Path(pattern=ID_PATTERN, description="32 hexadecimal digits")
_WISHED_ID = Query(pattern=ID_PATTERN, description="32 hexadecimal digits")


def services_of(connection: HTTPConnection) -> Services:
    """The services of the application this request came to."""
    return cast(Services, connection.app.state.services)


async def get_services(connection: HTTPConnection) -> Services:
    """The services as a dependency: async, for it looks nothing up, and threads are few."""
    return services_of(connection)


ServicesDep = Annotated[Services, Depends(get_services)]


def get_recording(
    connection: HTTPConnection, services: ServicesDep, recording_id: Annotated[str, _ID]
) -> RecordingRecord:
    """The recording named in the path."""
    _check_shared(connection, recording_id)
    return services.recordings.get(recording_id)


def get_wished_recording(
    connection: HTTPConnection, services: ServicesDep, recording_id: Annotated[str | None, _WISHED_ID] = None
) -> RecordingRecord | None:
    """The recording that a query names, or None."""
    return None if recording_id is None else get_recording(connection, services, recording_id)


def get_job(connection: HTTPConnection, services: ServicesDep, job_id: Annotated[str, _ID]) -> JobRecord:
    """The job named in the path."""
    job = services.jobs.get(job_id)
    _check_shared(connection, job.recording_id)
    return job


def _check_shared(connection: HTTPConnection, recording_id: str) -> None:
    """Raise Refused where the visitor came by a link to another recording."""
    if getattr(connection.state, "shared", None) not in {None, recording_id}:
        raise other_recording()


async def is_guest(connection: HTTPConnection) -> bool:
    """Whether the visitor came by a link to one recording."""
    return getattr(connection.state, "shared", None) is not None


GuestDep = Annotated[bool, Depends(is_guest)]
RecordingDep = Annotated[RecordingRecord, Depends(get_recording)]
WishedRecordingDep = Annotated[RecordingRecord | None, Depends(get_wished_recording)]
JobDep = Annotated[JobRecord, Depends(get_job)]
