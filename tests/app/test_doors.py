"""Sessions, links, the brake, headers and patience: how one gets in, how little, and for how long."""

from __future__ import annotations

import json
import re
import secrets
import socket
import time
from itertools import pairwise

import httpx2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.cli.serving import MADE_TOKEN_BYTES, address
from app.errors import TooMany
from app.scene import page
from app.server import security, sessions, share
from app.server.brake import FORGET_S, FREE_TRIES, LONGEST_WAIT_S, MOST_SEEN, Brake
from app.server.headers import ALWAYS
from app.server.patience import PatientH11
from app.server.sessions import MOST_SESSIONS, Sessions
from app.server.share import ShareLinks, shown_to_guests
from tests.app.support.live import serving

TOKEN = "correct-horse-battery"
ONE, OTHER = "1" * 32, "2" * 32


@pytest.fixture(scope="module")
def guarded(tmp_path_factory):
    """A server with a token."""
    with serving(tmp_path_factory.mktemp("guarded"), token=TOKEN) as running:
        yield running


def stranger(live):
    return httpx2.Client(base_url=live.origin, trust_env=False, timeout=20)


# Sessions


class Clock:
    def __init__(self):
        self.now_s = 1e9

    def __call__(self):
        return self.now_s


def test_a_session_is_open_for_its_time_and_over_a_restart_and_no_longer(tmp_path):
    """Oracle: a clock in the hand. Mutations: no expiry; kept in memory only; not bound to the token."""
    clock, path = Clock(), tmp_path / "sessions.json"
    here = Sessions("token-one", path, lifetime_s=100, clock=clock)
    first = here.begin("")
    assert here.name_of(first) is not None
    assert Sessions("token-one", path, lifetime_s=100, clock=clock).name_of(first) == here.name_of(first)
    assert Sessions("token-two", path, lifetime_s=100, clock=clock).name_of(first) is None
    assert first not in path.read_text()
    assert "token-one" not in path.read_text()
    assert path.stat().st_mode & 0o077 == 0
    clock.now_s += 101
    assert here.name_of(first) is None


def test_a_session_that_has_ended_is_dropped(tmp_path):
    """Oracle: the file, which grew with each login of a year. Mutation: all of them kept."""
    clock, path = Clock(), tmp_path / "sessions.json"
    here = Sessions(TOKEN, path, lifetime_s=100, clock=clock)
    for _ in range(3):
        here.begin("")
    clock.now_s += 101
    here.begin("")
    assert len(json.loads(path.read_text())) == 1


def test_a_login_ends_the_session_before_it(tmp_path):
    """A session id that somebody else has put into the browser is worth nothing after it. Mutation: keeping the old id."""
    here = Sessions(TOKEN, tmp_path / "s.json", lifetime_s=100)
    first = here.begin("")
    second = here.begin(first)
    assert second != first
    assert (here.name_of(first), here.name_of(second) is None) == (None, False)
    here.end(second)
    assert here.name_of(second) is None
    assert here.name_of("") is None


def test_the_table_of_sessions_is_bounded_and_a_broken_file_is_an_empty_one(tmp_path):
    """Mutation: no bound; a traceback at what a crash has left."""
    path = tmp_path / "s.json"
    for broken in ("", "[1]", '{"a": "x"}', "\x00"):
        path.write_text(broken)
        assert Sessions(TOKEN, path, lifetime_s=9).name_of("x") is None
    here = Sessions(TOKEN, tmp_path / "no" / "such" / "folder.json", lifetime_s=100)
    ids = [here.begin("") for _ in range(MOST_SESSIONS + 3)]
    assert here.name_of(ids[-1]) is not None
    assert sum(here.name_of(each) is not None for each in ids) == MOST_SESSIONS


def test_the_token_itself_is_no_cookie(guarded):
    """Mutation: the cookie compared with the token, as it was."""
    with stranger(guarded) as http:
        for name in (sessions.COOKIE, "unsweep_token"):
            assert http.get("/api/info", headers={"Cookie": f"{name}={TOKEN}"}).status_code == 401


def test_logging_out_ends_the_session(guarded):
    """Mutation: only the browser's cookie deleted."""
    with stranger(guarded) as http:
        http.get("/", params={"token": TOKEN})
        cookie = http.cookies[sessions.COOKIE]
        assert http.get("/api/info").status_code == 200
        assert http.delete("/api/session", headers={"Origin": guarded.origin}).status_code == 204
        assert http.get("/api/info", headers={"Cookie": f"{sessions.COOKIE}={cookie}"}).status_code == 401


def test_a_link_on_another_site_leads_in_once_and_not_in_a_circle(guarded):
    """Mutation: the page that leads on is answered whoever asks: without a session it would for ever."""
    elsewhere = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Site": "cross-site"}
    own = {"Sec-Fetch-Mode": "navigate", "Sec-Fetch-Site": "same-origin"}
    with stranger(guarded) as http:
        first = http.get("/r/1?a=b", headers=elsewhere)
        assert 'url=/r/1?a=b"' in first.text
        assert http.get("/r/1?a=b", headers=own).status_code == 401
        assert http.get("/api/info", headers=elsewhere).status_code == 401


# The brake


def test_wrong_tries_wait_longer_each_time():
    """Oracle: waits read back with the clock in the hand. Mutations: no longest wait; a wait that never grows; wrong tries never
    forgotten."""
    clock = Clock()
    brake = Brake(clock)
    waits = []
    for _ in range(14):
        try:
            brake.check("10.0.0.1")
        except TooMany as error:
            waits.append(error.retry_after_s)
            clock.now_s += error.retry_after_s
            brake.check("10.0.0.1")
        else:
            waits.append(0)
        brake.wrong("10.0.0.1", b"wrong %d" % len(waits))
    assert waits[:FREE_TRIES] == [0] * FREE_TRIES
    assert all(a <= b for a, b in pairwise(waits))
    assert waits[-1] == LONGEST_WAIT_S + 1
    brake.check("10.0.0.2")
    with pytest.raises(TooMany):
        brake.check("10.0.0.1")
    clock.now_s += FORGET_S + 1
    for number in range(FREE_TRIES):
        brake.check("10.0.0.1")
        brake.wrong("10.0.0.1", b"wrong %d" % number)


def test_one_wrong_token_shown_again_is_one_try_until_others_have_put_it_out_of_memory():
    """A script with an old token asks for ever. Oracle: the clock in the hand. Mutations: a repetition counted; one that puts
    the wait off; all tokens remembered, of an address that invents them without end.
    """
    clock = Clock()
    brake = Brake(clock)
    for _ in range(200):
        brake.check("10.0.0.1")
        brake.wrong("10.0.0.1", b"old")
        clock.now_s += 1
    for number in range(FREE_TRIES - 1):
        brake.wrong("10.0.0.1", b"%d" % number)
    brake.wrong("10.0.0.1", b"old")
    with pytest.raises(TooMany) as first:
        brake.check("10.0.0.1")
    clock.now_s += first.value.retry_after_s
    brake.wrong("10.0.0.1", b"old")
    brake.check("10.0.0.1")
    for number in range(MOST_SEEN):
        brake.wrong("10.0.0.1", b"%d" % number)
    assert [len(tries.seen) for tries in brake._tries.values()] == [MOST_SEEN]
    clock.now_s += LONGEST_WAIT_S
    brake.check("10.0.0.1")
    brake.wrong("10.0.0.1", b"old")
    with pytest.raises(TooMany):
        brake.check("10.0.0.1")


def test_one_customer_of_an_ipv6_network_is_one_address():
    """Mutation: by full address, of which everybody has 2^64."""
    brake = Brake(Clock())
    for number in range(20):
        brake.wrong(f"2001:db8::{number}", b"wrong %d" % number)
    with pytest.raises(TooMany):
        brake.check("2001:db8::ffff")
    brake.check("2001:db8:1::1")


def test_guessing_is_braked_and_open_sessions_are_not(tmp_path):
    """Oracle: the answers. Mutations: the brake before the session (one guesser locks everybody out); none at all; a token that
    may be a word told from wrong ones while its address has to wait."""
    with serving(tmp_path, token=TOKEN) as live, stranger(live) as guest, stranger(live) as guesser:
        guest.get("/", params={"token": TOKEN})
        codes = [guesser.get("/api/info", params={"token": f"wrong-{n}"}).status_code for n in range(FREE_TRIES + 3)]
        assert codes[:FREE_TRIES] == [401] * FREE_TRIES
        assert 429 in codes
        braked = guesser.get("/api/info", params={"token": TOKEN})
        assert (braked.status_code, braked.json()["error"]["code"]) == (429, "token.wait")
        assert int(braked.headers["retry-after"]) >= 1
        assert guest.get("/api/info").status_code == 200


def test_a_script_with_an_old_token_keeps_nobody_of_its_address_waiting(tmp_path):
    """One wrong request a second had all others of a proxy refused. Oracle: the answers. Mutation: repetitions counted."""
    with serving(tmp_path, token=TOKEN) as live, stranger(live) as script:
        old = {"Authorization": "Bearer correct-horse-batterz"}
        codes = [
            (script.get("/api/info", headers=old).status_code, live.http.get("/api/info").status_code)
            for _ in range(30)
        ]
        assert codes == [(401, 200)] * 30


def test_who_guesses_keeps_nobody_waiting_who_has_a_long_token(tmp_path):
    """Oracle: the answers. Mutations: the brake before the comparison, as it was; none for wrong ones of a long token."""
    with serving(tmp_path, token="k" * security.LONG_TOKEN) as live, stranger(live) as guesser, stranger(live) as guest:
        for n in range(FREE_TRIES + 3):
            last = guesser.get("/api/info", params={"token": f"wrong-{n}"}).status_code
            assert live.http.get("/api/info").status_code == 200
        assert last == 429
        assert guest.get("/", params={"token": live.settings.token}).status_code == 200
        assert len(secrets.token_urlsafe(MADE_TOKEN_BYTES)) >= security.LONG_TOKEN


@pytest.mark.parametrize("path", sorted(security.OPEN_PATHS))
def test_what_is_open_to_all_says_nothing_of_a_token(guarded, path):
    """Guessing there was free: 200 wrong ones, then the right one had a session. Oracle: the answer to who shows nothing.
    Mutation: the token compared once more where sessions begin, which these paths come to as well."""
    with stranger(guarded) as http:
        plain, shown = http.get(path), http.get(path, params={"token": TOKEN})
        assert (shown.status_code, shown.content) == (plain.status_code, plain.content)
        assert "set-cookie" not in shown.headers


def test_guessing_out_of_an_open_session_is_braked_too(tmp_path):
    """A session may be somebody else's, left in a browser; the token is more than it. Mutation: the token compared once
    more where sessions begin, beside the brake."""
    with serving(tmp_path, token=TOKEN) as live, stranger(live) as guest:
        guest.get("/", params={"token": TOKEN})
        codes = [guest.get("/", params={"token": f"wrong-{n}"}).status_code for n in range(FREE_TRIES + 1)]
        assert codes == [200] * FREE_TRIES + [429]
        assert guest.get("/", params={"token": TOKEN}).status_code == 429
        assert guest.get("/api/info").status_code == 200


@pytest.mark.parametrize("token", ["a+b&c#d12345", "50%25/of?= x"])
def test_the_address_that_is_printed_lets_one_in_whatever_the_token(tmp_path, token):
    """Oracle: the door. Mutation: the token as it is: `&` and `#` cut it short, and `+` means a space."""
    with serving(tmp_path, token=token) as live, stranger(live) as guest:
        guest.get(address(live.settings, live.port), follow_redirects=True)
        assert guest.get("/api/info").status_code == 200


# Links to one recording


@given(st.text(max_size=80))
def test_a_link_nobody_signed_is_none(text):
    """Mutation: the signature compared with its own payload's length, or not at all."""
    links = ShareLinks(TOKEN)
    good = links.make(ONE, 1e12)
    payload, signature = good.split(".")
    assert links.recording_of(good) == ONE
    for forged in (text, f"{text}.{signature}", f"{payload}.{text}", good + text):
        assert links.recording_of(forged) == (ONE if forged == good else None)


def test_a_link_runs_out_and_ends_with_the_token():
    """Oracle: a clock in the hand. Mutation: `until` not compared."""
    clock = Clock()
    links = ShareLinks(TOKEN, clock)
    link = links.make(ONE, clock.now_s + 10)
    assert ShareLinks("another-token", clock).recording_of(link) is None
    clock.now_s += 11
    assert links.recording_of(link) is None


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("/", True),
        ("/assets/a.js", True),
        (f"/r/{ONE}/result", True),
        ("/api/info", True),
        (f"/api/recordings/{ONE}", True),
        (f"/api/recordings/{ONE}/view", True),
        (f"/api/recordings/{OTHER}", False),
        (f"/api/recordings/{OTHER}/{ONE}", False),
        ("/api/recordings", False),
        ("/api/recordings/", False),
        ("/api/folder", False),
        ("/api/docs", False),
        (f"/scene/{ONE}/", False),
        ("/metrics", False),
        ("/api/information", False),
        (f"/api/jobs/{OTHER}0", False),
        (f"/api/jobs/{OTHER}", True),  # whose job it is, is looked at where it is loaded
    ],
)
def test_what_a_guest_may_ask_for(path, shown):
    """Mutation: search in the place of fullmatch."""
    assert shown_to_guests(path, ONE) is shown


def test_a_guest_reads_one_recording_and_changes_nothing(guarded):
    """Oracle: every answer. Mutations: the job's recording not compared; the method; the websocket; the link as a token."""
    mine, foreign = guarded.ready("room.bag"), guarded.ready("room-too.bag")
    jobs = {rec: guarded.http.get(f"/api/recordings/{rec}/jobs").json()[0]["id"] for rec in (mine, foreign)}
    made = guarded.http.post(f"/api/recordings/{mine}/share", json={"hours": 1})
    assert made.status_code == 201
    assert guarded.http.post(f"/api/recordings/{mine}/share", json={"hours": 1e9}).status_code == 422
    with stranger(guarded) as guest:
        answer = guest.get(made.json()["path"])
        assert "SameSite=strict" in answer.headers["set-cookie"]
        for path in (f"/api/recordings/{mine}", f"/api/jobs/{jobs[mine]}", f"/api/recordings/{mine}/planes", "/"):
            assert guest.get(path).status_code == 200, path
        refused = (
            f"/api/recordings/{foreign}",
            f"/api/jobs/{jobs[foreign]}",
            f"/api/results/{jobs[foreign]}",
            "/api/recordings",
            "/api/folder",
        )
        for path in refused:
            assert guest.get(path).status_code == 403, path
        own = {"Origin": guarded.origin}
        assert guest.delete(f"/api/recordings/{mine}", headers=own).status_code == 401
        assert guest.post(f"/api/recordings/{mine}/jobs", json={"kind": "solve"}, headers=own).status_code == 401
        assert guest.post(f"/api/recordings/{mine}/share", json={"hours": 1}, headers=own).status_code == 401
        assert sessions.COOKIE not in guest.get("/", params={"token": "wrong-token"}).headers.get("set-cookie", "")
        cookie = f"{share.COOKIE}={guest.cookies[share.COOKIE]}"
        with (
            pytest.raises((InvalidStatus, ConnectionClosed)),
            connect(
                f"ws://127.0.0.1:{guarded.port}/scene/{mine}",
                origin=guarded.origin,
                additional_headers={"Cookie": cookie},
                proxy=None,
            ) as line,
        ):
            line.recv(timeout=5)


def test_a_server_without_a_token_has_nothing_to_share(shared_live):
    """Mutation: a link signed with no key."""
    recording_id = shared_live.upload("any.bag")
    answer = shared_live.http.post(f"/api/recordings/{recording_id}/share", json={"hours": 1})
    assert (answer.status_code, answer.json()["error"]["code"]) == (409, "share.open_server")


# Headers


@pytest.mark.parametrize("path", ["/", "/api/info", "/api/docs", "/healthz", "/api/nothing", f"/scene/{ONE}/", "/r/1"])
def test_every_answer_forbids_what_it_can(shared_live, path):
    """Mutation: headers set by the routes that thought of it; refusals without."""
    answer = shared_live.http.get(path)
    for name, value in ALWAYS.items():
        assert answer.headers[name] == value
    policy = answer.headers["content-security-policy"]
    assert "frame-ancestors 'self'" in policy
    assert "unsafe-eval" not in policy.replace("wasm-unsafe-eval", "")
    assert "script-src 'unsafe-inline'" not in policy
    assert "server" not in answer.headers


def test_refusals_at_the_door_carry_them_too(guarded):
    """Mutation: the headers behind the door."""
    with stranger(guarded) as http:
        assert http.get("/api/info").headers["x-content-type-options"] == "nosniff"


def test_the_scenes_scripts_show_a_nonce_that_is_new_each_time(shared_live):
    """Oracle: the page read as text. Mutations: one nonce for all; a script without it; 'unsafe-inline'."""
    recording_id = shared_live.upload("any.bag")
    answers = [shared_live.http.get(f"/scene/{recording_id}/") for _ in range(2)]
    nonces = [re.search(r"'nonce-([^']+)'", a.headers["content-security-policy"]).group(1) for a in answers]
    assert nonces[0] != nonces[1]
    for answer, nonce in zip(answers, nonces, strict=True):
        scripts = re.findall(r"<script[^>]{0,80}", answer.text)
        assert len(scripts) == 3
        assert all(nonce in script for script in scripts)
        assert f'e.nonce="{nonce}"' in answer.text
        assert page.NONCE not in answer.text


def test_forwarded_names_and_other_methods_are_not_obeyed(shared_live):
    """Oracle: what the upload's answer says its address is, and what became of the recording.

    Mutations: X-Forwarded-Host copied into Location; X-HTTP-Method-Override deleting by POST.
    """
    recording_id = shared_live.upload("any.bag")
    lies = {"X-Forwarded-Host": "evil.example", "X-Forwarded-Proto": "https", "Forwarded": "host=evil.example"}
    made = shared_live.http.post(
        "/api/uploads",
        headers={**lies, "Tus-Resumable": "1.0.0", "Upload-Length": "5", "Upload-Metadata": "filename YS5iYWc="},
    )
    assert made.status_code == 201, made.text
    assert "evil" not in str(made.headers)
    override = {"X-HTTP-Method-Override": "DELETE", "Tus-Resumable": "1.0.0"}
    shared_live.http.post(f"/api/uploads/{recording_id}", headers=override)
    shared_live.http.post(f"/api/recordings/{recording_id}", headers=override)
    assert shared_live.http.get(f"/api/recordings/{recording_id}").status_code == 200
    bare = shared_live.http.get(f"/scene/{recording_id}", headers={"Host": f"localhost:{shared_live.port}"})
    assert "location" not in bare.headers


# Patience


def until(line, wanted):
    """Read until that has come."""
    found = b""
    while wanted not in found:
        part = line.recv(4096)
        assert part, found
        found += part


def ends(line, *, drip):
    """Whether the other side closes, though a byte drips in now and then."""
    line.settimeout(0.1)
    for _ in range(100):
        try:
            line.sendall(drip)
            if line.recv(4096) == b"":
                return True
        except TimeoutError:
            continue
        except OSError:
            return True
    return False


def test_half_a_request_does_not_hold_a_connection(live, monkeypatch):
    """Nothing, half a head, and a second head cut off: each is closed. A slow answer is not.

    Oracle: the socket's end. Mutations: no timer; a timer set anew by each byte that drips in.
    """
    monkeypatch.setattr(PatientH11, "head_timeout_s", 0.6)
    whole = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    for first in (b"", b"GET /healthz HTTP/1.1\r\nHost: 127", whole + b"GET /hea"):
        with socket.create_connection(("127.0.0.1", live.port), timeout=15) as line:
            line.sendall(first)
            if first.startswith(whole):
                until(line, b"ok")
            assert ends(line, drip=b"x" if first else b"")
    recording_id = live.upload("any.bag")
    with socket.create_connection(("127.0.0.1", live.port), timeout=15) as line:
        line.sendall(f"GET /api/recordings/{recording_id}/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
        until(line, b"\r\n\r\n")
        time.sleep(1.2)
        live.http.patch(f"/api/recordings/{recording_id}", json={"name": "b"})
        until(line, b"recording-changed")


def test_a_small_body_has_to_come(live, monkeypatch):
    """Mutation: waiting for a body for ever."""
    monkeypatch.setattr(security, "BODY_PATIENCE_S", 0.5)
    with socket.create_connection(("127.0.0.1", live.port), timeout=15) as line:
        line.sendall(b"POST /api/recordings HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n")
        line.sendall(b'Content-Length: 20\r\n\r\n{"sam')
        assert line.recv(4096).startswith(b"HTTP/1.1 413")


@pytest.mark.parametrize(
    ("sent", "status", "code"),
    [
        (
            b"GET /api/info HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: " + b"a" * 40_000 + b"\r\n\r\n",
            431,
            "request.head_too_large",
        ),
        (b"GET /api/info HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: " + b"a" * 70_000, 400, "http.400"),
        (b"what is this\r\n\r\n", 400, "http.400"),
    ],
)
def test_what_is_refused_before_any_route_has_the_one_error_body(shared_live, sent, status, code):
    """Oracle: the API's own document of errors. Seen: 40 kB of headers accepted where 32 are promised, and text without a code.

    Mutations: only a head that is still incomplete bounded; the web server's own answer.
    """
    with socket.create_connection(("127.0.0.1", shared_live.port), timeout=15) as line:
        line.sendall(sent)
        head, body = until_closed(line)
    assert head.startswith(f"HTTP/1.1 {status} ")
    error = json.loads(body)["error"]
    assert (error["code"], error["text"][-1]) == (code, ".")


def until_closed(line):
    """Head and body of an answer that ends the connection, or says how long it is."""
    said = b""
    while b"\r\n\r\n" not in said:
        said += line.recv(4096)
    head, _, body = said.partition(b"\r\n\r\n")
    length = int(re.search(rb"content-length: (\d+)", head)[1])
    while len(body) < length:
        body += line.recv(4096)
    return head.decode(), body
