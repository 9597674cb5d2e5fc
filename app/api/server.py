"""The server itself: what it can do, its folder of recordings, and whether it is well."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse

from app.schemas.recordings import FolderListing, Health, ServerFacts
from app.server.apidocs import render
from app.server.deps import ServicesDep

router = APIRouter(tags=["server"])


@router.get("/api/info")
def read_server_facts(services: ServicesDep) -> ServerFacts:
    """What a client needs to know before anything else."""
    return services.server_facts()


@router.get("/api/folder")
def list_folder(
    services: ServicesDep, path: Annotated[str, Query(description="below the recordings folder; '' is its top")] = ""
) -> FolderListing:
    """A folder of the server's own recordings, which open without an upload."""
    return services.folder.listing(path)


@router.get("/api/docs", include_in_schema=False)
def read_api_page(request: Request) -> HTMLResponse:
    """The API's document as a page."""
    return HTMLResponse(render(request.app.openapi()))


@router.get("/healthz")
def read_alive() -> Health:
    """Alive: the process answers."""
    return Health()


@router.get("/readyz")
def read_ready(services: ServicesDep) -> Health:
    """Ready: the store answers and the data directory can be written."""
    services.check_ready()
    return Health()
