"""Who may ask: host, token, origin, size. Against a real server; every refusal is the one error body or a sentence."""

from __future__ import annotations

from pathlib import Path

import httpx2
import pytest
from starlette.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.errors import Refused
from app.server.brake import Brake
from app.server.security import Gatekeeper, check_host
from app.server.sessions import COOKIE, Sessions
from app.settings import AppSettings
from tests.app.support.live import serving

TOKEN = "correct-horse-battery"
NOWHERE = Path("/nowhere/at/all")


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A server with a token that listens for other machines too."""
    with serving(tmp_path_factory.mktemp("guarded"), token=TOKEN, host="0.0.0.0", max_body_bytes=2000) as running:
        yield running


def stranger(live):
    return httpx2.Client(base_url=live.origin, trust_env=False, timeout=20)


def test_without_the_token_nothing_is_told_but_that_the_server_lives(guarded):
    """Mutation: an OPEN_PATHS test by prefix lets /healthz/../api through."""
    with stranger(guarded) as http:
        assert http.get("/healthz").json() == {"status": "ok"}
        assert http.get("/readyz").json() == {"status": "ok"}
        for path in ("/api/info", "/api/openapi.json", "/api/docs", "/api/recordings", "/healthz/x", "/api/nothing"):
            answer = http.get(path)
            assert answer.status_code == 401, path
            assert TOKEN not in answer.text
        assert http.get("/api/info").json()["error"]["code"] == "token.missing"
        page = http.get("/")
        assert (page.status_code, page.headers["content-type"]) == (401, "text/plain; charset=utf-8")


@pytest.fixture
def no_brake(monkeypatch):
    """Any number of tries; the brake has tests of its own."""
    monkeypatch.setattr(Brake, "wrong", lambda *_: None)


@pytest.mark.usefixtures("no_brake")
@pytest.mark.parametrize("wrong", ["x", "correct-horse-batterz", TOKEN + "x", "ünïcode"])
def test_wrong_tokens_are_no_token(guarded, wrong):
    """Mutation: comparing prefixes accepts the longer one."""
    with stranger(guarded) as http:
        assert http.get("/api/info", params={"token": wrong}).status_code == 401
        assert http.get("/api/info", headers={"Authorization": f"Bearer {wrong}".encode()}).status_code == 401
        assert http.get("/api/info", headers={"Cookie": f"{COOKIE}={wrong}".encode()}).status_code == 401


def test_the_printed_address_begins_a_session_and_leaves_the_address_bar(guarded):
    """A page of ours leads on, so that the strict cookie goes along though a link on another site was followed.

    Mutations: no HttpOnly lets a script read the cookie; Lax lets another site's form use it; the token in the cookie.
    """
    with stranger(guarded) as http:
        answer = http.get("/r/1?tab=planes", params={"token": TOKEN, "tab": "planes"})
        assert (answer.status_code, answer.headers["cache-control"]) == (200, "no-store")
        assert 'content="0;url=/r/1?tab=planes"' in answer.text
        cookie = answer.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert TOKEN not in cookie + answer.text
        assert http.get("/api/info").status_code == 200
    assert guarded.http.get("/api/info").status_code == 200  # the bearer


@pytest.mark.parametrize("path", ["//evil.example/", "/\\evil.example/", '/"><script>', "/r/1\r\nX: y"])
def test_where_it_leads_on_to_is_on_this_server(path):
    """Mutations: taking the path as it is: //evil.example is another host to a browser; not quoting it."""
    gate = Gatekeeper(app=None, settings=AppSettings(token=TOKEN), sessions=Sessions(TOKEN, NOWHERE, lifetime_s=9))
    scope = {"type": "http", "method": "GET", "path": path, "query_string": f"token={TOKEN}".encode(), "headers": []}
    headers = Headers(scope=scope)
    page = gate._begin(scope, headers, gate._check_token(scope, headers)).body.decode()
    target = page.split("url=", 1)[1].split('"', 1)[0]
    assert target.startswith("/")
    assert target[1] not in "/\\"
    assert not set(target) & set('<>"\r\n')


@pytest.mark.parametrize(
    ("origin", "status"),
    [("http://evil.example", 403), ("null", 403), ("http://127.0.0.1:1", 403), ("SELF", 422), (None, 422)],
)
def test_changes_come_from_our_own_page_only(shared_live, origin, status):
    """422 is the route's own answer: it was reached. Mutation: comparing host names without ports lets :1 in."""
    headers = {} if origin is None else {"Origin": shared_live.origin if origin == "SELF" else origin}
    answer = shared_live.http.post("/api/recordings", json={}, headers=headers)
    assert answer.status_code == status
    if status == 403:
        assert answer.json()["error"]["code"] == "origin.foreign"
        assert (
            shared_live.http.get("/api/recordings", headers=headers).status_code == 200
        )  # reading is the browser's guard


def test_a_cross_site_form_without_origin_is_refused(shared_live):
    """Mutation: treating a missing Origin as a script's whatever the browser says."""
    answer = shared_live.http.post("/api/recordings", json={}, headers={"Sec-Fetch-Site": "cross-site"})
    assert answer.json()["error"]["code"] == "origin.missing"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "", "192.168.0.7"])
def test_on_loopback_a_foreign_host_name_is_an_attack(shared_live, host):
    """DNS rebinding. Mutation: startswith("127.0.0.1")."""
    answer = shared_live.http.get("/api/info", headers={"Host": host})
    assert answer.status_code in {400, 403}
    if answer.status_code == 403:
        assert answer.json()["error"]["code"] == "host.foreign"


@pytest.mark.parametrize(
    "host",
    ["127.0.0.1:80.evil.example", "localhost:evil.example", "127.0.0.1:80:80", "[::1]evil", "x@localhost", "[::1"],
)
def test_what_only_begins_as_a_name_of_this_machine_is_none(host):
    """Mutation: a parser of addresses, which reads the port only when it is asked for it."""
    with pytest.raises(Refused, match="own names only"):
        check_host(host)


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:5173", "127.0.0.1:80", "[::1]:8080", "[::1]", "127.9.9.9", "LOCALHOST"]
)
def test_this_machines_own_names_are_welcome(host):
    """Mutation: refusing IPv6."""
    check_host(host)


def test_websockets_need_the_token_too(guarded):
    """Mutation: passing websockets through unchecked."""
    address = f"ws://127.0.0.1:{guarded.port}/scene/{'0' * 32}"
    with (
        pytest.raises((InvalidStatus, ConnectionClosed)) as refused,
        connect(address, origin=guarded.origin, proxy=None) as socket,
    ):
        socket.recv(timeout=5)
    assert "403" in str(refused.value) or "4403" in str(refused.value)


def test_bodies_have_a_limit_whether_they_announce_their_size_or_not(guarded):
    """Mutation: trusting Content-Length lets a chunked body through."""
    big = b'{"name": "' + b"x" * 3000 + b'"}'
    answer = guarded.http.post("/api/recordings", content=big)
    assert (answer.status_code, answer.json()["error"]["code"]) == (413, "request.too_large")
    chunked = guarded.http.post(
        "/api/recordings", content=iter([big[:1500], big[1500:]]), headers={"Content-Type": "application/json"}
    )
    assert chunked.status_code in {400, 413}


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False), ("10.0.0.1", False), ("box", False)],
)
def test_what_counts_as_loopback(host, loopback):
    """Mutation: treating 0.0.0.0 as this machine only."""
    assert AppSettings(host=host).is_loopback() is loopback
