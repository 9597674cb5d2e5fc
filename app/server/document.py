"""The API's document. `python -m app.openapi` writes it to stdout; the browser's types are generated from it."""

from __future__ import annotations

import json
import re
from typing import cast

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute

from app.schemas.common import ErrorBody
from app.server.examples import ExampleMaker, Schema

TAGS = [
    {"name": "server", "description": "What the server can do, its folder of recordings, its health."},
    {"name": "recordings", "description": "Recordings: open, upload, look, change."},
    {"name": "uploads", "description": "Resumable uploads (tus 1.0 at /api/uploads, metadata `filename`)."},
    {"name": "jobs", "description": "Work in child processes, and its live messages as server-sent events."},
    {"name": "planes", "description": "The planes of the static cloud, edited by operations with undo."},
    {"name": "audits", "description": "An extrinsic in use held against a recording."},
    {"name": "results", "description": "Results, exports, wall thickness, report, history of runs."},
    {"name": "view", "description": "What the 3D scene at /scene/{recording_id}/ shows."},
]

DESCRIPTION = """Everything the page does, by HTTP.

Every answer with a status of 400 or above has one body: `{"error": {"code", "text", "details"}}`.
Streams (`.../events`) are server-sent events whose `data` is one JSON message with an `event` field; they resume by
`Last-Event-ID`. A job tells `stage`, `iteration`, `log` and `state`; a recording tells `planes-changed`,
`job-changed`, `view-changed`, `recording-changed`, `click-refused` and `resync`.

Units are in the names; frames and signs are those of the result document. A server that is not on loopback wants
`Authorization: Bearer TOKEN`.
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
        app.openapi_schema = _with_examples(_short_names(made))
    return app.openapi_schema


def _with_examples(made: dict[str, object]) -> dict[str, object]:
    """The document with an example, or one for each kind, wherever JSON or an event goes over the wire."""
    components = cast("dict[str, dict[str, Schema]]", made["components"])["schemas"]
    maker = ExampleMaker(components)
    for path in cast("dict[str, dict[str, Schema]]", made["paths"]).values():
        for operation in path.values():
            parts = [(cast(Schema, operation.get("requestBody", {})), True)]
            parts += [(part, False) for part in cast("dict[str, Schema]", operation["responses"]).values()]
            for part, sparse in parts:
                for kind, media in cast("dict[str, Schema]", part.get("content", {})).items():
                    schema = _event_schema(media) if kind == "text/event-stream" else media.get("schema")
                    if kind in {"application/json", "text/event-stream"} and isinstance(schema, dict):
                        named = maker.named(schema, sparse=sparse)
                        media["examples"] = {name: {"value": value} for name, value in named.items()}
    return made


def _event_schema(media: Schema) -> Schema:
    """The schema of an event's JSON, one of the event types."""
    properties = cast("dict[str, Schema]", cast(Schema, media["itemSchema"])["properties"])
    return cast(Schema, properties["data"]["contentSchema"])


def _short_names(made: dict[str, object]) -> dict[str, object]:
    """The document with readable names where both the wire and the doctor's report call a model the same.

    The wire's own model keeps the name, the report's gets `Report` before it.
    """
    text = json.dumps(made)
    text = re.sub(r"calib_core__doctor__report__(\w+?)\b", r"Report\1", text)
    text = re.sub(r"app__schemas__\w+?__([A-Z]\w*)\b", r"\1", text)
    named: dict[str, object] = json.loads(text)
    return named
