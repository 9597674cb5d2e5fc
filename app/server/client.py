"""The built client's files: long cached where their name carries a hash, the page itself never, one page for all."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, FastAPI
from fastapi.responses import FileResponse, PlainTextResponse
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send

from app.errors import NotFound
from app.server.streams import is_stream

#: Beside the rooms, where the build puts it.
STATIC = Path(__file__).parents[1] / "static"
ASSETS = "/assets"
ONE_YEAR = "public, max-age=31536000, immutable"

NOT_BUILT = (
    "The unsweep server runs, but its page is not built. Install the package with pip, which builds it, or run "
    "`npm run build` in frontend/. The API's document is at /api/docs.\n"
)

#: Everything below these is the server's, never a page of the client.
SERVER_PATHS = ("api", "scene", "healthz", "readyz", "metrics")


class HashedFiles(StaticFiles):
    """Files whose names change with their content."""

    def file_response(self, *args: object, **kwargs: object) -> Response:
        """The file, to be kept for good."""
        response = super().file_response(*args, **kwargs)  # type: ignore[arg-type]
        response.headers["Cache-Control"] = ONE_YEAR
        return response


class CompressText:
    """Gzip for pages and JSON. Streams and the scene's websocket pass untouched: an event must not wait in a buffer."""

    def __init__(self, app: ASGIApp) -> None:
        self._plain = app
        self._compressing = GZipMiddleware(app, minimum_size=1000, compresslevel=5)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, through the compressor where that helps."""
        untouched = scope["type"] != "http" or is_stream(scope)
        await (self._plain if untouched else self._compressing)(scope, receive, send)


def install_client(app: FastAPI, static: Path = STATIC) -> None:
    """Serve the client's files and, for every other address, its page. Comes after all other routes."""
    if (static / "assets").is_dir():
        app.mount(ASSETS, HashedFiles(directory=static / "assets"), name="assets")
    # Looked up by name: what somebody asks for is never a path on the disk, whatever is in it.
    own = {file.relative_to(static).as_posix(): file for file in static.rglob("*") if file.is_file()}
    router = APIRouter(include_in_schema=False)

    @router.get("/{path:path}")
    def read_page(path: str) -> Response:
        """The client: a file of its own, or the page, which knows what to show at this address."""
        if path.split("/", 1)[0] in SERVER_PATHS:
            raise NotFound("http.404", f"There is nothing at /{path}; the API's document is at /api/docs.")
        found = own.get(path, static / "index.html")
        if not found.is_file():
            return PlainTextResponse(NOT_BUILT, status_code=200)
        return FileResponse(found, headers={"Cache-Control": "no-cache"})

    app.include_router(router)
