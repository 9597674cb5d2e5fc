"""The application factory, its lifespan, and the server that runs it."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from socket import socket

import uvicorn
from anyio import to_thread
from fastapi import FastAPI

from app.api import audits, jobs, planes, recordings, results, scene, server, storage, uploads, view
from app.errors import ApiError
from app.jobs.launch import Launcher
from app.server.client import CompressText, install_client
from app.server.document import document, operation_id
from app.server.errors import install_error_handler
from app.server.headers import SecurityHeaders
from app.server.metrics import CountRequests, Metrics
from app.server.patience import PatientH11
from app.server.process import settle_process
from app.server.security import MAX_HEAD_BYTES, Gatekeeper
from app.server.services import Services
from app.server.sessions import Sessions
from app.server.streams import ForgiveLeaving
from app.settings import AppSettings
from calib_core import __version__

#: The largest message a browser may send to the scene: a camera, a click.
WEBSOCKET_MESSAGE_BYTES = 2**16
#: What the web server says, with a traceback, of text in a websocket that is none: it closes it, and nothing is wrong here.
BROWSERS_FAULT = "Invalid UTF-8 sequence received"
#: How long open requests may take to end when the server stops.
STOP_GRACE_S = 3


def create_app(settings: AppSettings, *, launcher: Launcher | None = None) -> FastAPI:
    """The application. Nothing is opened or written before its lifespan starts.

    launcher: what runs jobs; None: one process each.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        try:
            services = await to_thread.run_sync(Services, settings, launcher)
            app.state.services = services
            app.state.metrics.watch(services.jobs, services.scenes, services.files)
            await to_thread.run_sync(services.start)
        except ApiError as error:
            app.state.startup_error = error
            raise
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
        redirect_slashes=False,  # its redirects are built from the Host that the request names
        generate_unique_id_function=operation_id,
    )
    app.state.settings = settings
    app.state.metrics = Metrics()
    app.state.sessions = make_sessions(settings)
    app.openapi = lambda: document(app)  # type: ignore[method-assign]
    install_error_handler(app)
    for module in (server, storage, recordings, uploads, jobs, planes, results, audits, view, scene):
        app.include_router(module.router)
    app.include_router(uploads.tus)
    install_client(app)
    # The last one added is the first to see a request.
    app.add_middleware(ForgiveLeaving)
    app.add_middleware(CompressText)
    app.add_middleware(Gatekeeper, settings=settings, sessions=app.state.sessions)
    app.add_middleware(SecurityHeaders)
    app.add_middleware(CountRequests, metrics=app.state.metrics)
    return app


def make_sessions(settings: AppSettings) -> Sessions | None:
    """The sessions of the server's token; None where it has none. Read when first asked for."""
    if settings.token is None:
        return None
    return Sessions(settings.token, settings.data_dir / "sessions.json", lifetime_s=settings.session_hours * 3600)


class Server(uvicorn.Server):
    """uvicorn that ends event streams and scenes before it waits for open requests, which they would never end."""

    def __init__(self, app: FastAPI, config: uvicorn.Config, on_started: Callable[[], None]) -> None:
        super().__init__(config)
        self._app = app
        self._on_started = on_started
        logging.getLogger("uvicorn.error").addFilter(
            lambda record: self.startup_error is None and not record.getMessage().startswith(BROWSERS_FAULT)
        )

    @property
    def startup_error(self) -> ApiError | None:
        """Why the server did not start, in a sentence, which is told instead of a traceback."""
        return getattr(self._app.state, "startup_error", None)

    def run(self, sockets: list[socket] | None = None) -> None:
        """Serve until told to stop. The process is the server's."""
        settle_process()
        super().run(sockets)

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Start, and say so: until then the data directory may turn out to be another server's."""
        await super().startup(sockets)
        if self.started:
            self._on_started()

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Stop."""
        services: Services | None = getattr(self._app.state, "services", None)
        if services is not None:
            await services.arrivals.stop_uploads()
            await to_thread.run_sync(services.end_streams)
        await super().shutdown(sockets)


def make_server(
    settings: AppSettings, *, launcher: Launcher | None = None, on_started: Callable[[], None] = lambda: None
) -> Server:
    """The server, ready to run on a bound socket or on the settings' address.   on_started: called once it can be used."""
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
        http=PatientH11,
        h11_max_incomplete_event_size=MAX_HEAD_BYTES,
        limit_concurrency=settings.max_connections,
        server_header=False,
        proxy_headers=bool(settings.trusted_proxies),
        forwarded_allow_ips=list(settings.trusted_proxies),
    )
    return Server(app, config, on_started)
