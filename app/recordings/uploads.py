"""Resumable uploads: tuspyserver between our checks before and our recording after."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from fastapi import APIRouter, Request, Response
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Receive, Scope, Send
from tuspyserver import create_tus_router

from app.errors import BadRequest
from app.server.deps import ServicesDep
from app.settings import AppSettings

UPLOADS_PATH = "/api/uploads"
#: base64 of "application/octet-stream": tuspyserver insists on a file type, which says nothing about a bag.
FILE_TYPE = "filetype YXBwbGljYXRpb24vb2N0ZXQtc3RyZWFt"

Metadata = dict[str, str]


def _before_upload(
    request: Request, response: Response, services: ServicesDep
) -> Callable[[Metadata, dict[str, object]], None]:
    """The check before an upload: name, size, disk. The upload gets its recording's id."""

    def check(metadata: Metadata, upload: dict[str, object]) -> None:
        size_bytes = upload["size"]
        if not isinstance(size_bytes, int):
            raise BadRequest("upload.no_length", "The upload does not say how long it is; send Upload-Length.")
        if size_bytes == 0:
            raise BadRequest("upload.empty", "The file is empty; choose a recording with messages in it.")
        if "filename" not in metadata:
            raise BadRequest("upload.no_name", "The upload has no name; send `filename` in Upload-Metadata.")
        record = services.recordings.announce_upload(metadata["filename"], size_bytes)
        request.state.upload_id = record.id
        response.headers["X-Recording-Id"] = record.id

    return check


def _upload_place(request: Request) -> Callable[[Metadata], None]:
    """Where an upload's bytes go: a new one under its recording's id, any other where tus finds it."""

    def place(_: Metadata) -> dict[str, str] | None:
        upload_id = cast(str | None, getattr(request.state, "upload_id", None))
        return None if upload_id is None else {"uid": upload_id, "files_dir": str(_uploads_dir(request))}

    return cast(Callable[[Metadata], None], place)  # what its signature says; it uses what comes back


def _uploads_dir(request: Request) -> str:
    return str(cast(AppSettings, request.app.state.settings).data_dir / "uploads")


def _after_upload(response: Response, services: ServicesDep) -> Callable[[str, Metadata], None]:
    """What follows the last byte: the recording is there and is inspected."""

    def finish(path: str, _: Metadata) -> None:
        recording_id = path.rsplit("/", 1)[-1]
        services.recordings.finish_upload(recording_id)
        response.headers["X-Recording-Id"] = recording_id

    return finish


def _only_plain_uploads(request: Request) -> None:
    """Refuse what the tus extensions would do past our checks: joining uploads, lengths told later."""
    if "upload-concat" in request.headers or "upload-defer-length" in request.headers:
        raise BadRequest("upload.extension", "Uploads here are single files of known length; send Upload-Length only.")


def make_tus_router(settings: AppSettings) -> APIRouter:
    """The tus 1.0 endpoints below /api/uploads; not part of the API's document, the protocol is its own."""
    router = cast(
        APIRouter,
        create_tus_router(
            prefix=UPLOADS_PATH.strip("/"),
            files_dir=str(settings.data_dir / "uploads"),
            max_size=settings.max_upload_bytes,
            days_to_keep=settings.upload_expiry_days,
            auth=cast(Callable[[], None], _only_plain_uploads),
            pre_create_dep=_before_upload,
            file_dep=_upload_place,
            upload_complete_dep=_after_upload,
        ),
    )
    for route in router.routes:
        setattr(route, "include_in_schema", False)  # noqa: B010 - a route of unknown class to the type checker
    return router


class TusHeaders:
    """Middleware: gives an upload the file type that tuspyserver wants and that no client need send."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, completed."""
        if scope["type"] == "http" and scope["method"] == "POST" and scope["path"].rstrip("/") == UPLOADS_PATH:
            headers = MutableHeaders(raw=list(scope["headers"]))
            metadata = headers.get("upload-metadata", "")
            if "filetype" not in metadata:
                headers["upload-metadata"] = ",".join(part for part in (metadata, FILE_TYPE) if part)
                scope = dict(scope, headers=headers.raw)
        await self._app(scope, receive, send)
