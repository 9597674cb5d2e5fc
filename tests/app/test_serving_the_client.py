"""The built client: one page for every address, hashed files for good, compression, a sentence where it is missing."""

from __future__ import annotations

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

import hatch_build
from app.server.client import STATIC, CompressText, install_client
from app.server.errors import install_error_handler


@pytest.fixture
def site(tmp_path):
    """A built client."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<!doctype html>" + "page " * 1000)
    (tmp_path / "assets" / "app-1a2b.js").write_text("run();" * 1000)
    (tmp_path / "mark.svg").write_text("<svg/>")
    (tmp_path.parent / "secret.txt").write_text("secret")
    return tmp_path


def client_of(static):
    app = FastAPI()
    install_error_handler(app)

    @app.get("/api/known")
    def known():
        return {}

    @app.get("/api/x/events")
    def events():
        return {"long": "x" * 5000}

    install_client(app, static)
    app.add_middleware(CompressText)
    return TestClient(app)


def test_every_address_of_the_client_gets_its_page_uncached(site):
    """Mutation: answering 404 for /r/abc/planes breaks reload."""
    client = client_of(site)
    for path in ("/", "/r/0123/planes", "/index.html"):
        answer = client.get(path)
        assert answer.text.startswith("<!doctype html>")
        assert answer.headers["cache-control"] == "no-cache"
        assert answer.headers["content-encoding"] == "gzip"
    assert client.get("/mark.svg").text == "<svg/>"


def test_hashed_files_are_kept_for_good(site):
    """Mutation: no immutable: each reload asks again."""
    answer = client_of(site).get("/assets/app-1a2b.js")
    assert "immutable" in answer.headers["cache-control"]
    assert answer.headers["content-encoding"] == "gzip"
    assert client_of(site).get("/assets/missing.js").status_code == 404


def test_the_servers_own_addresses_are_never_the_page(site):
    """Mutation: the fallback swallows a misspelt API address with 200."""
    answer = client_of(site).get("/api/unknown")
    assert answer.status_code == 404
    assert answer.json()["error"]["code"] == "http.404"


@pytest.mark.parametrize("path", ["/../secret.txt", "/%2e%2e/secret.txt", "/assets/../../secret.txt"])
def test_no_address_leads_out_of_the_folder(site, path):
    """Mutation: what is asked for joined to the folder's path."""
    assert "secret" not in client_of(site).get(path).text


@pytest.mark.parametrize("path", ["/%00", "/mark.svg%00", "/" + 300 * "x", "/" + 3000 * "x/", "/%ff", "/r/%ed%b3%bf"])
def test_an_address_that_no_disk_takes_is_the_page(site, path):
    """As any address that is no file's: a zero in a name, or a name too long, was a defect. Mutation: the same."""
    answer = client_of(site).get(path)
    assert (answer.status_code, answer.text[:15]) == (200, "<!doctype html>")
    assert client_of(site).get(f"/assets{path}").status_code == 404


def test_event_streams_are_not_compressed(site):
    """Mutation: a compressor holds events back in its buffer."""
    assert "content-encoding" not in client_of(site).get("/api/x/events").headers


def test_an_unbuilt_client_says_so(tmp_path):
    """Mutation: a traceback."""
    answer = client_of(tmp_path).get("/")
    assert "not built" in answer.text


def test_the_client_is_looked_for_where_the_build_puts_it():
    """Oracle: the build's own path. Mutation: a path beside the module, which moved and left the page behind."""
    assert STATIC == hatch_build.ROOT / "app" / "static"
