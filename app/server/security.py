"""Who may ask: checked before any route, for HTTP and websockets alike.

Host      on loopback only the names of this machine: a foreign name that resolves to 127.0.0.1 is an attack
token     where one is set: a session's cookie, `Authorization: Bearer`, or `?token=` once, which begins a session;
          wrong ones are braked by address (brake.py). `?share=` begins a look at one recording, which can only read
Origin    on everything that changes state and on every websocket: our own, or one that the settings allow
size      of every body but an upload's, and the time it takes to arrive
headers   that tell servers to take one request for another are dropped: nothing behind this can obey them
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import re
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

from fastapi.responses import HTMLResponse, PlainTextResponse, RedirectResponse
from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import ApiError, HeadTooLarge, Refused, TooLarge, Unauthorised
from app.jobs.asking import ASKING
from app.schemas.common import ID_DIGITS
from app.server import sessions, share
from app.server.brake import Brake
from app.server.errors import error_response
from app.server.sessions import Sessions
from app.server.share import ShareLinks, other_recording, shown_to_guests
from app.settings import AppSettings

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
#: Asked by machines that watch over the server; they tell nothing.
OPEN_PATHS = frozenset({"/healthz", "/readyz"})
#: Requests whose body is a recording or a part of one: their own limits hold (app/uploads). Anything else is bounded.
UPLOADS = re.compile(rf"POST /api/uploads|PATCH /api/uploads/{ID_DIGITS}|PUT /api/recordings/upload", re.ASCII)
#: The longest head of a request, all its headers: a long path and a cookie fit many times.
MAX_HEAD_BYTES = 2**15
#: The next part of a small body has to be here within this.
BODY_PATIENCE_S = 30.0
#: A token of so many characters, as those that the server makes, is out of reach of guessing at any rate, and whoever shows it
#: need not wait for what others of the address have tried. A shorter one may be a word: told apart from wrong ones at once, all
#: the time, it would be guessed as fast as the server answers.
LONG_TOKEN = 32
#: A Host header: a name or an address, and a port of digits: "127.0.0.1:80.example.com" is somebody else's name.
HOST = re.compile(r"(?P<name>\[[^\[\]]+\]|[^\[\]:]+)(?::[0-9]{0,5})?", re.ASCII)
#: Dropped from every request: other methods than the one on the line, other addresses than the connection's.
DROPPED = (b"x-http-method", b"x-method-override", b"x-forwarded-", b"forwarded", b"x-original-", b"x-rewrite-")
#: Followed by the browser as our own page's wish, so that a cookie that no other site can use goes along.
ONWARD = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url={}"><title>unsweep</title>'


@dataclass(frozen=True, slots=True)
class _Visitor:
    """Who asks. name: for queues and logs.   shared: the one recording that may be looked at; None for all.

    shows_token: with this very request, not by a session that it began.
    """

    name: str
    shared: str | None = None
    shows_token: bool = False


class Gatekeeper:
    """Middleware that lets only rightful requests in."""

    def __init__(self, app: ASGIApp, settings: AppSettings, sessions: Sessions | None = None) -> None:
        self._app = app
        self._settings = settings
        self._sessions = sessions
        self._links = None if settings.token is None else ShareLinks(settings.token)
        self._brake = Brake()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check, then pass on."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        headers = Headers(scope=scope)
        try:
            visitor = self._check(scope, headers)
        except ApiError as error:
            await self._refuse(scope, headers, error, receive, send)
            return
        if scope["type"] == "http" and (answer := self._begin(scope, headers, visitor)) is not None:
            await answer(scope, receive, send)
            return
        kept = [(name, value) for name, value in scope["headers"] if not name.lower().startswith(DROPPED)]
        state = {**scope.get("state", {}), "shared": visitor.shared}
        ASKING.set(visitor.name)
        scope = dict(scope, headers=kept, state=state)
        if scope["type"] == "http" and not _is_upload(scope):
            await self._bounded(scope, receive, send)
        else:
            await self._app(scope, receive, send)

    def _check(self, scope: Scope, headers: Headers) -> _Visitor:
        if self._settings.is_loopback():
            check_host(headers.get("host", ""))
        if sum(len(name) + len(value) for name, value in scope["headers"]) > MAX_HEAD_BYTES:
            raise HeadTooLarge(
                "request.head_too_large",
                f"A request's headers may have {MAX_HEAD_BYTES} bytes; send fewer or shorter ones.",
            )
        visitor = _Visitor(_address(scope))
        if scope["path"] not in OPEN_PATHS:
            visitor = self._check_token(scope, headers)
        if scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS:
            self._check_origin(headers, required=scope["type"] == "websocket")
        announced = headers.get("content-length", "0")
        too_large = not announced.isdecimal() or int(announced[:20]) > self._settings.max_body_bytes
        if scope["type"] == "http" and not _is_upload(scope) and too_large:
            raise self._too_large()
        return visitor

    def _check_token(self, scope: Scope, headers: Headers) -> _Visitor:
        """Who shows a session, the token, or a link to what is asked for."""
        if self._settings.token is None:
            return _Visitor(_address(scope))
        name = None if self._sessions is None else self._sessions.name_of(_cookie(headers, sessions.COOKIE))
        if name is not None:
            return _Visitor(name, shows_token=self._shows_token(scope, _query(scope, "token")))
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        if self._shows_token(scope, _query(scope, "token"), bearer if scheme.lower() == "bearer" else ""):
            return _Visitor(_address(scope), shows_token=True)
        shared = self._shared(scope, headers)
        if shared is not None and scope["type"] == "http" and scope["method"] in {"GET", "HEAD"}:
            if shown_to_guests(scope["path"], shared):
                return _Visitor(f"guest of {shared[:12]}", shared)
            raise other_recording()
        raise Unauthorised(
            "token.missing",
            "This server wants its token: open the address it printed when it started, or send "
            "`Authorization: Bearer TOKEN`.",
        )

    def _shows_token(self, scope: Scope, *shown: str) -> bool:
        """Whether the token is among these. The only place that compares: whoever shows a wrong one waits before the next."""
        tried, token, address = [one.encode() for one in shown if one], self._settings.token, _address(scope)
        if not tried or token is None:
            return False
        is_right = any(hmac.compare_digest(one, token.encode()) for one in tried)
        if is_right and len(token) >= LONG_TOKEN:
            return True
        self._brake.check(address)
        for one in () if is_right else tried:
            self._brake.wrong(address, one)
        return is_right

    def _shared(self, scope: Scope, headers: Headers) -> str | None:
        """The recording that a link in the address or in its cookie shows."""
        if self._links is None:
            return None
        links = (_query(scope, "share"), _cookie(headers, share.COOKIE))
        return next((found for link in links if link and (found := self._links.recording_of(link))), None)

    def _check_origin(self, headers: Headers, *, required: bool) -> None:
        origin = headers.get("origin")
        if origin is None:
            if required or headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
                raise Refused(
                    "origin.missing", "The request does not say where it comes from; use the server's own page."
                )
            return
        if origin in self._settings.allowed_origins:
            return
        parts = urlsplit(origin)
        if parts.scheme not in {"http", "https"} or parts.netloc.lower() != headers.get("host", "").lower():
            raise Refused(
                "origin.foreign",
                f"A page of {origin} may not use this server; open the server's own page, or allow that origin in "
                "UNSWEEP_ALLOWED_ORIGINS.",
            )

    def _begin(self, scope: Scope, headers: Headers, visitor: _Visitor) -> Response | None:
        """After `?token=` or `?share=` in a page's address: a cookie instead, and out of the address bar."""
        if self._settings.token is None or scope["method"] != "GET":
            return None
        link = _query(scope, "share")
        if self._sessions is not None and visitor.shows_token and _query(scope, "token"):
            session = self._sessions.begin(_cookie(headers, sessions.COOKIE))
            name, value, age_s = sessions.COOKIE, session, int(self._settings.session_hours * 3600)
        elif link and self._links is not None and self._links.recording_of(link) is not None:
            name, value, age_s = share.COOKIE, link, None
        else:
            return None
        rest = parse_qsl(scope["query_string"].decode("latin-1"))
        # A path that starts with two slashes would be another host's address.
        target = "/" + scope["path"].lstrip("/\\")
        target = _with_query(target, [(key, said) for key, said in rest if key not in {"token", "share"}])
        response = onward(target) if _is_page(scope) else RedirectResponse(target, status_code=303)
        response.headers["Cache-Control"] = "no-store"
        response.set_cookie(
            name, value, max_age=age_s, httponly=True, samesite="strict", secure=scope.get("scheme") == "https"
        )
        return response

    async def _refuse(self, scope: Scope, headers: Headers, error: ApiError, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4403, "reason": error.code})
            return
        is_page = scope["method"] == "GET" and not scope["path"].startswith("/api")
        response: Response = error_response(error)
        if is_page:
            response = PlainTextResponse(f"{error}\n", status_code=error.status, headers=dict(_retry(response)))
        if isinstance(error, Unauthorised) and is_page and _comes_from_elsewhere(headers):
            # A link on another site: the browser keeps the session's cookie back, once.
            query = parse_qsl(scope["query_string"].decode("latin-1"))
            response = onward(_with_query("/" + scope["path"].lstrip("/\\"), query))
        await response(scope, receive, send)

    async def _bounded(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on with a body that is refused once it is longer than allowed, whatever its headers said, or does not come.

        Whatever the framework makes of a body that breaks off, the answer is the refusal.
        """
        taken, ended, answered = 0, False, False
        refusal: TooLarge | None = None

        def refused(error: TooLarge) -> TooLarge:
            nonlocal refusal
            refusal = error
            return error

        async def take() -> Message:
            nonlocal taken, ended
            if ended:  # what comes now is that the browser has gone, whenever that may be
                return await receive()
            try:
                message = await asyncio.wait_for(receive(), BODY_PATIENCE_S)
            except TimeoutError:
                raise refused(self._too_slow()) from None
            ended = not message.get("more_body", False)
            taken += len(message.get("body", b""))
            if taken > self._settings.max_body_bytes:
                raise refused(self._too_large())
            return message

        async def give(message: Message) -> None:
            nonlocal answered
            if refusal is None or answered:
                answered = True
                await send(message)

        await self._app(scope, take, give)
        if refusal is not None and not answered:
            await error_response(refusal)(scope, receive, send)

    def _too_slow(self) -> TooLarge:
        return TooLarge(
            "request.too_slow",
            f"The request's body did not come within {BODY_PATIENCE_S:.0f} s; send it again.",
        )

    def _too_large(self) -> TooLarge:
        return TooLarge(
            "request.too_large",
            f"A request's body may have {self._settings.max_body_bytes} bytes; recordings go to /api/uploads.",
        )


def check_host(host: str) -> None:
    """Raise Refused unless the Host header names this machine's loopback.   host: as sent, with or without a port."""
    found = HOST.fullmatch(host)
    name = "" if found is None else found["name"].strip("[]").lower()
    with suppress(ValueError):
        if name == "localhost" or ipaddress.ip_address(name).is_loopback:
            return
    raise Refused(
        "host.foreign",
        f"This server answers on this machine's own names only, not as {host!r}; open http://127.0.0.1 with its port.",
    )


def _is_upload(scope: Scope) -> bool:
    return UPLOADS.fullmatch(f"{scope['method']} {scope['path']}") is not None


def onward(target: str) -> Response:
    """A page of ours that goes on to the address, which then is not another site's wish any more."""
    return HTMLResponse(ONWARD.format(escape(quote(target, safe="/?&=%:@~+,;!$*()'-._"))))


def _is_page(scope: Scope) -> bool:
    return not str(scope["path"]).startswith("/api")


def _comes_from_elsewhere(headers: Headers) -> bool:
    return headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-site") in {"cross-site", "same-site"}


def _retry(response: Response) -> list[tuple[str, str]]:
    return [(name, value) for name, value in response.headers.items() if name == "retry-after"]


def _with_query(path: str, query: list[tuple[str, str]]) -> str:
    return path + ("?" + urlencode(query) if query else "")


def _address(scope: Scope) -> str:
    client = scope.get("client")
    return str(client[0]) if client else ""


def _cookie(headers: Headers, name: str) -> str:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(name)
    except CookieError:
        return ""
    return "" if morsel is None else str(morsel.value)


def _query(scope: Scope, name: str) -> str:
    return dict(parse_qsl(scope.get("query_string", b"").decode("latin-1"))).get(name, "")
