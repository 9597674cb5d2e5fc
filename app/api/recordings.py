"""Recordings: list, open, upload for scripts, change, delete, timeline, and the feed of changes."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.sse import EventSourceResponse

from app.schemas.common import LONGEST_NAME
from app.schemas.recordings import ChangeRecording, NewShareLink, OpenRecording, Recording, ShareLink, Timeline
from app.schemas.view import RecordingMessage
from app.server.deps import RecordingDep, ServicesDep
from app.server.share import share_link

router = APIRouter(prefix="/api/recordings", tags=["recordings"])


@router.get("")
def list_recordings(services: ServicesDep) -> list[Recording]:
    """All recordings, newest first, without their reports."""
    return services.recordings.list_all()


@router.post("", status_code=201)
def open_recording(services: ServicesDep, wish: OpenRecording) -> Recording:
    """Open a recording of the server's folder in place, or simulate a sample. An inspection starts by itself."""
    return services.recordings.open(wish)


@router.put(
    "/upload",
    status_code=201,
    openapi_extra={"requestBody": {"content": {"application/octet-stream": {"schema": {"type": "string"}}}}},
)
async def upload_recording(
    services: ServicesDep,
    request: Request,
    name: Annotated[str, Query(min_length=1, max_length=LONGEST_NAME, examples=["room.bag"])],
) -> Recording:
    """Upload a recording in one request, for scripts: the body is the file. Browsers use /api/uploads (tus)."""
    return await services.arrivals.receive(name, request)


@router.get("/{recording_id}")
def read_recording(services: ServicesDep, recording: RecordingDep) -> Recording:
    """One recording, its report and its latest job."""
    return services.recordings.wire(recording)


@router.patch("/{recording_id}")
def change_recording(services: ServicesDep, recording: RecordingDep, change: ChangeRecording) -> Recording:
    """Rename, choose topics and time span, overrule what was detected. A changed read setting inspects again.

    It also stops all jobs of the recording that wait or run, solves among them: they are of how it was read before.
    """
    return services.recordings.change(recording, change)


@router.delete("/{recording_id}", status_code=204)
def delete_recording(services: ServicesDep, recording: RecordingDep) -> Response:
    """Cancel its jobs and remove everything known of it. Files of the server's own folder stay."""
    services.recordings.delete(recording)
    return Response(status_code=204)


@router.post("/{recording_id}/share", status_code=201)
def share_recording(services: ServicesDep, recording: RecordingDep, wish: NewShareLink) -> ShareLink:
    """A link with which anybody can look at this recording, and at nothing else, for some hours; they change nothing.

    409 on a server without a token: everybody who reaches it sees everything anyway.
    """
    return share_link(services.settings.token, recording.id, wish)


@router.get("/{recording_id}/timeline")
def read_timeline(services: ServicesDep, recording: RecordingDep) -> Timeline:
    """Rates of turn, accelerations, scans and still spans over time. 409 until the recording has been read."""
    return services.recordings.timeline(recording)


@router.get("/{recording_id}/events", response_class=EventSourceResponse)
async def watch_recording(
    services: ServicesDep,
    recording: RecordingDep,
    last_event_id: Annotated[str | None, Header(description="resume after this message")] = None,
) -> AsyncIterator[RecordingMessage]:
    """Changes of this recording by anybody, as server-sent events; `data` is one JSON message."""
    async for message in services.feed.watch(recording.id, last_event_id):
        yield message
