"""The application factory and the server's entry point."""

from __future__ import annotations

from fastapi import FastAPI

from app.api import jobs, planes, recordings, results, server, uploads, view
from app.errors import install_error_handler
from app.openapi import document, operation_id
from app.settings import AppSettings

VERSION = "0.1.0"


def create_app(settings: AppSettings) -> FastAPI:
    """The application. Nothing is opened or written before its lifespan starts."""
    app = FastAPI(
        title="unsweep",
        version=VERSION,
        openapi_url="/api/openapi.json",
        docs_url="/api/docs",
        redoc_url=None,
        generate_unique_id_function=operation_id,
    )
    app.state.settings = settings
    app.openapi = lambda: document(app)  # type: ignore[method-assign]
    install_error_handler(app)
    for module in (server, recordings, uploads, jobs, planes, results, view):
        app.include_router(module.router)
    return app
