"""The server itself: what it can do, its folder of recordings, and whether it is well."""

from __future__ import annotations

from typing import Annotated, cast

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import HTMLResponse

from app.schemas.recordings import FolderListing, Health, ServerFacts
from app.server.apidocs import render
from app.server.deps import ServicesDep
from app.server.metrics import Metrics
from app.server.sessions import COOKIE, Sessions

router = APIRouter(tags=["server"])


@router.get("/api/info")
def read_server_facts(services: ServicesDep) -> ServerFacts:
    """What a client needs to know before anything else."""
    return services.facts


@router.get("/api/folder")
def list_folder(
    services: ServicesDep,
    path: Annotated[str, Query(description="below the recordings folder; '' is its top")] = "",
) -> FolderListing:
    """A folder of the server's own recordings, which open without an upload."""
    return services.folder.listing(path)


@router.delete("/api/session", status_code=204)
def end_session(request: Request) -> Response:
    """End the session of this browser; it has to show the token again. Nothing happens where there is none."""
    kept = cast("Sessions | None", request.app.state.sessions)
    if kept is not None:
        kept.end(request.cookies.get(COOKIE, ""))
    response = Response(status_code=204)
    response.delete_cookie(COOKIE)
    return response


@router.get("/api/docs", include_in_schema=False)
def read_api_page(request: Request) -> HTMLResponse:
    """The API's document as a page."""
    return HTMLResponse(render(request.app.openapi()))


@router.get("/healthz")
def read_alive() -> Health:
    """Alive: the process answers."""
    return Health()


@router.get("/metrics", include_in_schema=False)
def read_metrics(request: Request) -> Response:
    """Figures for whoever watches over the server; wants the token like everything else."""
    return Response(
        cast(Metrics, request.app.state.metrics).text(), media_type="text/plain; version=0.0.4; charset=utf-8"
    )


@router.get("/readyz")
def read_ready(services: ServicesDep) -> Health:
    """Ready: a file was just written to the data directory, and a row to the store."""
    services.readiness.check()
    return Health()
