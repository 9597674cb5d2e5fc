"""Resumable uploads by the tus protocol, for browsers. An upload's id is its recording's id."""

from __future__ import annotations

from datetime import UTC, datetime
from email.utils import format_datetime
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Depends, Request, Response

from app.api.tus import TusRoute
from app.errors import NotFound
from app.schemas.common import is_id
from app.schemas.recordings import UploadTarget
from app.server.deps import RecordingDep, ServicesDep
from app.storage.records import RecordingRecord
from app.uploads.protocol import (
    ALGORITHMS,
    EXTENSIONS,
    announcement_of,
    check_body,
    checksum_of,
    number_of,
)

router = APIRouter(prefix="/api/uploads", tags=["uploads"])
#: The protocol is its own document: these routes are not in the API's.
tus = APIRouter(prefix="/api/uploads", route_class=TusRoute, include_in_schema=False)


@router.get("/{recording_id}/recording")
def read_upload_target(services: ServicesDep, recording: RecordingDep) -> UploadTarget:
    """Which recording an upload becomes (the last part of its tus address), and how much has arrived."""
    received_bytes = services.recordings.received_bytes(recording)
    return UploadTarget(recording_id=recording.id, state=recording.state, received_bytes=received_bytes)


def get_upload(services: ServicesDep, upload_id: str) -> RecordingRecord:
    """The upload named in the path, arriving or arrived."""
    record = services.recordings.find(upload_id) if is_id(upload_id) else None
    if record is None or record.origin != "upload":
        raise NotFound("upload.not_found", "No upload has this address; start it again.")
    return record


UploadDep = Annotated[RecordingRecord, Depends(get_upload)]


@tus.options("")
@tus.options("/{upload_id}")
def tell_protocol(services: ServicesDep) -> Response:
    """What this server understands."""
    headers = {
        "Tus-Extension": EXTENSIONS,
        "Tus-Max-Size": str(services.settings.max_upload_bytes),
        "Tus-Checksum-Algorithm": ",".join(ALGORITHMS),
    }
    return Response(status_code=204, headers=headers)


@tus.post("")
async def create_upload(services: ServicesDep, request: Request) -> Response:
    """Announce an upload; bytes may come with it."""
    announced = announcement_of(request.headers)
    with_bytes = "content-type" in request.headers
    if with_bytes:
        check_body(request.headers)
    checksum = checksum_of(request.headers)
    uploads = services.arrivals
    record = await to_thread.run_sync(uploads.announce_upload, announced.name, announced.size_bytes, announced.sha256)
    headers = {"Location": f"/api/uploads/{record.id}", "X-Recording-Id": record.id, **_expiry(services, record)}
    if with_bytes:
        headers["Upload-Offset"] = str(await uploads.receive_first(record, request.receive, checksum))
    return Response(status_code=201, headers=headers)


@tus.head("/{upload_id}")
def read_offset(services: ServicesDep, upload: UploadDep) -> Response:
    """How much of the upload is safely here."""
    offset = services.recordings.received_bytes(upload)
    headers = {"Upload-Offset": str(offset), "Upload-Length": str(upload.size_bytes), "Cache-Control": "no-store"}
    return Response(status_code=200, headers={**headers, **_expiry(services, upload)})


@tus.patch("/{upload_id}")
async def append_bytes(services: ServicesDep, upload: UploadDep, request: Request) -> Response:
    """Append bytes at the offset. With the last one the recording is there, and is inspected."""
    check_body(request.headers)
    offset, checksum = number_of(request.headers, "upload-offset"), checksum_of(request.headers)
    reached = await services.arrivals.receive_part(upload, request, offset, checksum)
    headers = {"Upload-Offset": str(reached), "X-Recording-Id": upload.id, **_expiry(services, upload)}
    return Response(status_code=204, headers=headers)


@tus.delete("/{upload_id}")
async def terminate_upload(services: ServicesDep, upload: UploadDep) -> Response:
    """Give up an upload that is still arriving: nothing of it stays."""
    await services.arrivals.give_up(upload)
    return Response(status_code=204)


def _expiry(services: ServicesDep, record: RecordingRecord) -> dict[str, str]:
    """When an unfinished upload is removed unless it goes on."""
    expires = services.arrivals.expires_at(record, datetime.now(UTC))
    return {} if expires is None else {"Upload-Expires": format_datetime(expires, usegmt=True)}
