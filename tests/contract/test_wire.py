"""The API's document is the committed one, and every error of every route has the one body."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from app.application import create_app
from app.schemas.common import ErrorBody
from app.server.document import document
from app.settings import AppSettings
from tests.app.support.live import ProcessLauncher

ROOT = Path(__file__).resolve().parents[2]
ABSENT = "0" * 32


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    """The application without a network."""
    settings = AppSettings(data_dir=tmp_path_factory.mktemp("wire"))
    launcher = ProcessLauncher("tests.app.support.fake_jobs:run")
    with TestClient(
        create_app(settings, launcher=launcher), base_url="http://127.0.0.1", raise_server_exceptions=False
    ) as made:
        yield made


def operations():
    """Path, method of every operation of the document."""
    made = document(create_app(AppSettings()))
    return [(path, method) for path, methods in made["paths"].items() for method in methods]


def test_the_browsers_document_is_this_programs_document():
    """Mutation: a field renamed without `python -m app.openapi > frontend/openapi.json`."""
    committed = json.loads((ROOT / "frontend" / "openapi.json").read_text(encoding="utf-8"))
    now = json.loads(json.dumps(document(create_app(AppSettings()))))
    assert now == committed, "run `python -m app.openapi > frontend/openapi.json`"


def test_every_operation_is_tagged_described_and_named_once():
    """Mutation: a route without a docstring."""
    made = document(create_app(AppSettings()))
    found = [operation for methods in made["paths"].values() for operation in methods.values()]
    names = [operation["operationId"] for operation in found]
    assert len(set(names)) == len(names)
    tags = {tag["name"] for tag in made["tags"]}
    for operation in found:
        assert set(operation["tags"]) <= tags
        assert operation["description"]
        assert "ErrorBody" in json.dumps(operation["responses"]["default"])
    assert not [name for name in made["components"]["schemas"] if "__" in name]


def test_every_field_on_the_wire_is_described():
    """What says which event, operation or kind a message is has one value, and needs no words.

    Mutations: a response's field without a description; `described_by` left out of a request that changes a record.
    """
    schemas = document(create_app(AppSettings()))["components"]["schemas"]
    bare = [
        f"{name}.{field}"
        for name, schema in schemas.items()
        for field, facts in schema.get("properties", {}).items()
        if not facts.get("description") and "const" not in facts
    ]
    assert bare == []


def assert_error_body(answer):
    assert answer.status_code >= 400
    assert answer.headers["content-type"].startswith("application/json")
    facts = ErrorBody.model_validate_json(answer.text).error
    assert re.fullmatch(r"[a-z0-9_]+(\.[a-z0-9_]+)*", facts.code)
    assert facts.text.endswith(".")
    assert "Traceback" not in answer.text


@pytest.mark.parametrize(("path", "method"), [pair for pair in operations() if "{" in pair[0]])
def test_what_is_not_there_is_told_in_the_one_body(client, path, method):
    """Mutation: FastAPI's own {"detail": ...} on any route."""
    absent = re.sub(r"\{format_name\}", "tum", path)
    absent = re.sub(r"\{\w+\}", ABSENT, absent)
    body = {"post": {"kind": "solve", "op": "undo"}, "patch": {}}.get(method)
    answer = client.request(method.upper(), absent, json=body)
    assert_error_body(answer)
    assert answer.status_code in {404, 422}
    malformed = re.sub(ABSENT, "..%2f..%2fetc", absent, count=1)
    assert_error_body(client.request(method.upper(), malformed, json=body))


@pytest.mark.parametrize(
    ("method", "path", "content"),
    [
        ("POST", "/api/recordings", b"{"),
        ("POST", "/api/recordings", b'{"sample": "a", "folder_path": "b"}'),
        ("POST", "/api/recordings", b'{"sample": "nothing like it"}'),
        ("PUT", "/api/recordings", b"{}"),
        ("DELETE", "/api/info", b""),
        ("GET", "/api/nothing/here", b""),
        ("GET", "/scene/xyz/", b""),
        ("GET", "/api/folder", b""),
        ("PUT", "/api/recordings/upload", b"x"),
        ("POST", "/api/uploads", b""),
        ("PATCH", f"/api/uploads/{ABSENT}", b""),
    ],
)
def test_nonsense_is_told_in_the_one_body(client, method, path, content):
    """Mutation: no handler for Starlette's own 404 and 405."""
    assert_error_body(client.request(method, path, content=content, headers={"Content-Type": "application/json"}))


def test_a_defect_is_told_without_its_traceback(client, monkeypatch):
    """Mutation: str(error) in the body."""

    def fail():
        raise ZeroDivisionError("secret internals")

    monkeypatch.setattr(client.app.state.services.recordings, "list_all", fail)
    answer = client.get("/api/recordings")
    assert_error_body(answer)
    assert answer.status_code == 500
    assert "secret" not in answer.text
    assert answer.json()["error"]["code"] == "defect"


def test_every_setting_of_the_server_is_described():
    """Mutation: a field without a description."""
    for name, field in AppSettings.model_fields.items():
        assert field.description, name
