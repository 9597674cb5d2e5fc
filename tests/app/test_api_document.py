"""The API's document: its page, its examples, and the client example of docs/api.md run against a live server."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from fastapi.routing import APIRoute
from pydantic import TypeAdapter

from app.api import jobs, planes, recordings, results, scene, server, uploads, view
from app.application import create_app
from app.schemas.jobs import JobMessage
from app.schemas.planes import Operation
from app.schemas.view import RecordingMessage
from app.server.document import document
from app.settings import AppSettings

ROUTES = [
    route
    for module in (server, recordings, uploads, jobs, planes, results, view, scene)
    for route in module.router.routes
    if isinstance(route, APIRoute) and route.include_in_schema
]
GUIDE = Path(__file__).resolve().parents[2] / "docs" / "api.md"
README = GUIDE.parents[1] / "README.md"


@pytest.fixture(scope="module")
def app():
    """The application, not started."""
    return create_app(AppSettings())


def examples(content):
    """The examples of one part of the document."""
    return [example["value"] for example in content.get("examples", {}).values()]


def test_every_example_is_what_the_models_accept(app):
    """Oracle: the models that check requests and answers. Fails with a name misspelt in an example of a field."""
    made = document(app)["paths"]
    checked = 0
    for route in ROUTES:
        for method in route.methods:
            operation = made[route.path][method.lower()]
            if route.body_field is not None:
                for example in examples(operation["requestBody"]["content"].get("application/json", {})):
                    TypeAdapter(route.body_field.field_info.annotation).validate_python(example)
                    checked += 1
            for status, response in operation["responses"].items():
                if status.startswith("2") and route.response_model is not None:
                    for example in examples(response.get("content", {}).get("application/json", {})):
                        TypeAdapter(route.response_model).validate_json(_json(example))
                        checked += 1
    assert checked > 25


def test_every_operation_and_every_event_has_an_example(app):
    """Fails with the discriminator's kinds left out of the examples."""
    paths = document(app)["paths"]
    operations = paths["/api/recordings/{recording_id}/planes/operations"]["post"]["requestBody"]["content"]
    kinds = operations["application/json"]["examples"]
    assert {"confirm", "restrict", "merge", "undo"} < set(kinds)
    for kind, example in kinds.items():
        assert TypeAdapter(Operation).validate_python(example["value"]).op == kind
    for path, messages, some in (
        ("/api/jobs/{job_id}/events", JobMessage, {"stage", "iteration", "log", "state"}),
        ("/api/recordings/{recording_id}/events", RecordingMessage, {"planes-changed", "click-refused", "resync"}),
    ):
        told = paths[path]["get"]["responses"]["200"]["content"]["text/event-stream"]["examples"]
        assert some <= set(told)
        for kind, example in told.items():
            assert TypeAdapter(messages).validate_json(_json(example["value"])).event == kind


def test_every_route_has_tag_text_and_the_one_error_body(app):
    """Fails with a route added without a tag; with one whose refusals have another body."""
    made = document(app)
    named = {tag["name"] for tag in made["tags"]}
    for path, operations in made["paths"].items():
        for operation in operations.values():
            assert set(operation["tags"]) <= named, path
            assert operation["tags"], path
            assert len(operation["description"]) > 10, path
            body = operation["responses"]["default"]["content"]["application/json"]
            assert body["schema"] == {"$ref": "#/components/schemas/ErrorBody"}, path


def test_every_route_that_is_told_is_in_the_document(app):
    """The scene's own page to share worked and was in no document. Mutation: its router left out, whatever the route says."""
    made = document(app)["paths"]
    assert {route.path for route in ROUTES} <= set(made)
    assert "get" in made["/api/recordings/{recording_id}/scene.html"]


def test_every_number_of_a_result_is_described(app):
    """Names alone do not say whose axes a sigma is about. Mutation: a field without a description."""
    schemas = document(app)["components"]["schemas"]
    ahead, seen = ["CalibrationResult"], set()
    while ahead:
        name = ahead.pop()
        if name in seen or name == "ImuNoise":  # units are in its names
            continue
        seen.add(name)
        for field, schema in schemas[name].get("properties", {}).items():
            assert schema.get("description"), f"{name}.{field}"
            ahead += re.findall(r"#/components/schemas/(\w+)", _json(schema))
    assert len(seen) > 15


class Loaded(HTMLParser):
    """What a page makes a browser fetch."""

    def __init__(self):
        super().__init__()
        self.found = []
        self.headings = []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag in {"script", "link", "img", "iframe"}:
            self.found.append(given.get("src") or given.get("href") or tag)
        if tag == "h3":
            self.headings.append(given["id"])


PATHS = ["get /api/folder path", "OpenRecording.folder_path"]


def unbounded(schema, schemas, where):
    """Where a schema has text of any length."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        yield from unbounded(schemas[name], schemas, name)
    for one in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("prefixItems", ())):
        yield from unbounded(one, schemas, where)
    if schema.get("type") == "string" and not schema.keys() & {"maxLength", "pattern", "enum", "const"}:
        yield where
    for name, field in schema.get("properties", {}).items():
        yield from unbounded(field, schemas, f"{where}.{name}")
    if "items" in schema:
        yield from unbounded(schema["items"], schemas, where)


def test_all_text_that_a_request_gives_has_a_longest_length(app):
    """A topic of 900 kB was kept, and came with every list. Mutation: any of these fields without a bound.

    Paths below the recordings folder are looked up, and kept only where there is something.
    """
    document = app.openapi()
    asked = []
    for path, verbs in document["paths"].items():
        for verb, operation in verbs.items():
            bodies = operation.get("requestBody", {}).get("content", {})
            asked += [(f"{verb} {path}", told["schema"]) for kind, told in bodies.items() if kind == "application/json"]
            queries = [parameter for parameter in operation.get("parameters", ()) if parameter["in"] == "query"]
            asked += [(f"{verb} {path} {parameter['name']}", parameter["schema"]) for parameter in queries]
    assert len(asked) > 12
    schemas = document["components"]["schemas"]
    assert [place for where, schema in asked for place in unbounded(schema, schemas, where)] == PATHS


def test_the_page_loads_nothing_and_names_every_operation(shared_live):
    """Fails with FastAPI's own page (scripts from elsewhere); with a tag's operations left out."""
    answer = shared_live.http.get("/api/docs")
    assert answer.headers["content-type"].startswith("text/html")
    page = Loaded()
    page.feed(answer.text)
    assert page.found == []
    assert not re.search(r"https?://(?!127)", answer.text)
    made = shared_live.http.get("/api/openapi.json").json()
    wanted = [operation["operationId"] for path in made["paths"].values() for operation in path.values()]
    assert sorted(page.headings) == sorted(wanted)


def test_the_guides_script_runs(live, tmp_path, capsys):
    """The script of docs/api.md, with this server's address and a recording of its name, prints an answer.

    Fails with a field renamed that it reads; with an operation renamed that it sends.
    """
    (script,) = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), flags=re.DOTALL)
    bag = tmp_path / "room.bag"
    bag.write_bytes(b"some bytes")
    script = script.replace("http://127.0.0.1:8080", live.origin).replace('"room.bag"', repr(str(bag)))
    exec(compile(script, str(GUIDE), "exec"), {"__name__": "__main__"})
    told = capsys.readouterr().out
    assert "calibrated" in told
    assert "extrinsic" in told
    recording = live.http.get("/api/recordings").json()[0]
    names = [patch["name"] for patch in live.http.get(f"/api/recordings/{recording['id']}/planes").json()["patches"]]
    assert names[0] == "wall A"


@pytest.mark.parametrize(("name", "ends"), [("room.bag", "matrix"), ("broken.bag", "porridge")])
def test_the_readmes_script_runs_and_ends(live, tmp_path, capsys, name, ends):
    """With a recording that cannot be read, too: it asked for ever. Mutation: the loop until `ready` alone."""
    readme = README.read_text(encoding="utf-8").partition("\n## HTTP\n")[2]
    (script,) = re.findall(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    bag = tmp_path / name
    bag.write_bytes(b"some bytes")
    script = script.replace("http://127.0.0.1:8080", live.origin)
    script = script.replace("name=room.bag", f"name={name}").replace('"room.bag"', repr(str(bag)))
    told = []
    try:
        exec(compile(script, str(README), "exec"), {"__name__": "__main__"})
    except SystemExit as left:
        told.append(str(left.code))
    assert ends in "".join([*told, capsys.readouterr().out])


def _json(value):
    """JSON text, as models read it from the wire."""
    import json

    return json.dumps(value)
