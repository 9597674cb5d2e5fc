"""The API's document: `python -m app.openapi` writes it to stdout. The browser's types are generated from it."""

from __future__ import annotations

import json
import re
import sys

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute

from app.schemas.common import ErrorBody

TAGS = [
    {"name": "server", "description": "What the server can do, its folder of recordings, its health."},
    {"name": "recordings", "description": "Recordings: open, upload, look, change."},
    {"name": "uploads", "description": "Resumable uploads (tus 1.0 at /api/uploads, metadata `filename`)."},
    {"name": "jobs", "description": "Work in child processes, and its live messages as server-sent events."},
    {"name": "planes", "description": "The planes of the static cloud, edited by operations with undo."},
    {"name": "results", "description": "Results, exports, wall thickness, report, history of runs."},
    {"name": "view", "description": "What the 3D scene at /scene/{recording_id}/ shows."},
]

DESCRIPTION = """Everything the page does, by HTTP.

Every answer with a status of 400 or above has one body: `{"error": {"code", "text", "details"}}`.
Streams (`.../events`) are server-sent events whose `data` is one JSON message with an `event` field; they resume by
`Last-Event-ID`. Units are in the names; frames and signs are those of the result document.
"""


def operation_id(route: APIRoute) -> str:
    """The route function's own name: short and stable for generated clients."""
    return route.name


def document(app: FastAPI) -> dict[str, object]:
    """The OpenAPI document, with the error body as JSON on every route whatever its success carries."""
    if app.openapi_schema is None:
        made = get_openapi(title=app.title, version=app.version, description=DESCRIPTION, routes=app.routes, tags=TAGS)
        schemas = made["components"]["schemas"]
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        schemas["ErrorBody"] = ErrorBody.model_json_schema(ref_template="#/components/schemas/{model}")
        for name, schema in schemas["ErrorBody"].pop("$defs").items():
            schemas.setdefault(name, schema)
        error = {
            "description": "Refused; the body says why",
            "content": {"application/json": {"schema": {"$ref": "#/components/schemas/ErrorBody"}}},
        }
        for path in made["paths"].values():
            for operation in path.values():
                operation["responses"].pop("422", None)
                operation["responses"]["default"] = error
        app.openapi_schema = _short_names(made)
    return app.openapi_schema


def _short_names(made: dict[str, object]) -> dict[str, object]:
    """The document with readable names where both the wire and the doctor's report call a model the same.

    The wire's own model keeps the name, the report's gets `Report` before it.
    """
    text = json.dumps(made)
    text = re.sub(r"calib_core__doctor__report__(\w+?)\b", r"Report\1", text)
    text = re.sub(r"app__schemas__\w+?__([A-Z]\w*)\b", r"\1", text)
    named: dict[str, object] = json.loads(text)
    return named


def main() -> None:
    """Write the document to stdout."""
    from app.main import create_app
    from app.settings import AppSettings

    json.dump(document(create_app(AppSettings())), sys.stdout, indent=2, sort_keys=True)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
