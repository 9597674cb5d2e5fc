"""The application factory, its lifespan, and the server that runs it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from socket import socket

import uvicorn
from anyio import to_thread
from fastapi import FastAPI

from app.api import audits, jobs, planes, recordings, results, scene, server, uploads, view
from app.jobs.launch import Launcher
from app.recordings.uploads import TusHeaders, make_tus_router
from app.server.client import CompressText, install_client
from app.server.errors import install_error_handler
from app.server.openapi import document, operation_id
from app.server.security import Gatekeeper
from app.server.services import Services
from app.server.settings import AppSettings
from calib_core import __version__

#: The largest message a browser may send to the scene.
WEBSOCKET_MESSAGE_BYTES = 100 * 2**20
#: How long open requests may take to end when the server stops.
STOP_GRACE_S = 3


def create_app(settings: AppSettings, *, launcher: Launcher | None = None) -> FastAPI:
    """The application. Nothing is opened or written before its lifespan starts.

    launcher: what runs jobs; None: one process each.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        services = await to_thread.run_sync(Services, settings, launcher)
        app.state.services = services
        await to_thread.run_sync(services.start)
        try:
            yield
        finally:
            await to_thread.run_sync(services.close)

    app = FastAPI(
        title="unsweep",
        version=__version__,
        lifespan=lifespan,
        openapi_url="/api/openapi.json",
        docs_url=None,  # its page would load scripts from elsewhere; ours is in api/server.py
        redoc_url=None,
        generate_unique_id_function=operation_id,
    )
    app.state.settings = settings
    app.openapi = lambda: document(app)  # type: ignore[method-assign]
    install_error_handler(app)
    for module in (server, recordings, uploads, jobs, planes, results, audits, view, scene):
        app.include_router(module.router)
    app.include_router(make_tus_router(settings))
    install_client(app)
    # The last one added is the first to see a request.
    app.add_middleware(TusHeaders)
    app.add_middleware(CompressText)
    app.add_middleware(Gatekeeper, settings=settings)
    return app


class Server(uvicorn.Server):
    """uvicorn that ends event streams and scenes before it waits for open requests, which they would never end."""

    def __init__(self, app: FastAPI, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._app = app

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Stop."""
        services: Services | None = getattr(self._app.state, "services", None)
        if services is not None:
            await to_thread.run_sync(services.end_streams)
        await super().shutdown(sockets)


def make_server(settings: AppSettings, *, launcher: Launcher | None = None) -> Server:
    """The server, ready to run on a bound socket or on the settings' address."""
    app = create_app(settings, launcher=launcher)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        log_level="warning",
        access_log=False,
        # Compressing clouds takes ten times longer than sending them.
        ws_per_message_deflate=False,
        ws_max_size=WEBSOCKET_MESSAGE_BYTES,
        timeout_graceful_shutdown=STOP_GRACE_S,
    )
    return Server(app, config)
