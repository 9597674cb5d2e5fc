"""Who may ask: checked before any route, for HTTP and websockets alike.

Host      on loopback only the names of this machine: a foreign name that resolves to 127.0.0.1 is an attack
token     where one is set: cookie, `Authorization: Bearer`, or `?token=` once, which sets the cookie
Origin    on everything that changes state and on every websocket: our own, or one that the settings allow
size      of every body but an upload's
"""

from __future__ import annotations

import hmac
import ipaddress
import re
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode, urlsplit

from fastapi.responses import PlainTextResponse, RedirectResponse
from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import ApiError, Refused, TooLarge, Unauthorised
from app.server.errors import error_response
from app.settings import AppSettings

COOKIE = "unsweep_token"
COOKIE_AGE_S = 30 * 24 * 3600
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
#: Asked by machines that watch over the server; they tell nothing.
OPEN_PATHS = frozenset({"/healthz", "/readyz"})
#: Requests whose body is a recording or a part of one: their own limits hold (app/uploads). Anything else is bounded.
UPLOADS = re.compile(r"POST /api/uploads|PATCH /api/uploads/[0-9a-f]{32}|PUT /api/recordings/upload", re.ASCII)


class Gatekeeper:
    """Middleware that lets only rightful requests in."""

    def __init__(self, app: ASGIApp, settings: AppSettings) -> None:
        self._app = app
        self._settings = settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Check, then pass on."""
        if scope["type"] not in {"http", "websocket"}:
            await self._app(scope, receive, send)
            return
        try:
            self._check(scope)
        except ApiError as error:
            await self._refuse(scope, error, receive, send)
            return
        if scope["type"] == "http" and (redirect := self._cookie_redirect(scope)) is not None:
            await redirect(scope, receive, send)
            return
        if scope["type"] == "http" and not _is_upload(scope):
            receive = self._bounded(receive)
        await self._app(scope, receive, send)

    def _check(self, scope: Scope) -> None:
        headers = Headers(scope=scope)
        if self._settings.is_loopback():
            check_host(headers.get("host", ""))
        if scope["path"] not in OPEN_PATHS:
            self._check_token(scope, headers)
        if scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS:
            self._check_origin(headers, required=scope["type"] == "websocket")
        announced = headers.get("content-length", "0")
        too_large = not announced.isdecimal() or int(announced) > self._settings.max_body_bytes
        if scope["type"] == "http" and not _is_upload(scope) and too_large:
            raise self._too_large()

    def _check_token(self, scope: Scope, headers: Headers) -> None:
        token = self._settings.token
        if token is None:
            return
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        shown = [_cookie(headers), _query_token(scope), bearer if scheme.lower() == "bearer" else ""]
        if not any(hmac.compare_digest(value.encode(), token.encode()) for value in shown if value):
            raise Unauthorised(
                "token.missing",
                "This server wants its token: open the address it printed when it started, or send "
                "`Authorization: Bearer TOKEN`.",
            )

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

    def _cookie_redirect(self, scope: Scope) -> Response | None:
        """After `?token=...` in a page's address: keep it in a cookie, and out of the address bar."""
        if self._settings.token is None or scope["method"] != "GET" or not _query_token(scope):
            return None
        rest = [(key, value) for key, value in parse_qsl(scope["query_string"].decode("latin-1")) if key != "token"]
        # A path that starts with two slashes would be another host's address.
        target = "/" + scope["path"].lstrip("/") + ("?" + urlencode(rest) if rest else "")
        response = RedirectResponse(target, status_code=303, headers={"Cache-Control": "no-store"})
        response.set_cookie(
            COOKIE,
            self._settings.token,
            max_age=COOKIE_AGE_S,
            httponly=True,
            samesite="lax",
            secure=scope.get("scheme") == "https",
        )
        return response

    async def _refuse(self, scope: Scope, error: ApiError, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 4403, "reason": error.code})
            return
        is_page = scope["method"] == "GET" and not scope["path"].startswith("/api")
        response: Response = error_response(error)
        if is_page:
            response = PlainTextResponse(f"{error}\n", status_code=error.status)
        await response(scope, receive, send)

    def _bounded(self, receive: Receive) -> Receive:
        """The same body, refused once it is longer than allowed, whatever its headers said."""
        taken = 0

        async def take() -> Message:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > self._settings.max_body_bytes:
                raise self._too_large()
            return message

        return take

    def _too_large(self) -> TooLarge:
        return TooLarge(
            "request.too_large",
            f"A request's body may have {self._settings.max_body_bytes} bytes; recordings go to /api/uploads.",
        )


def check_host(host: str) -> None:
    """Raise Refused unless the Host header names this machine's loopback.   host: as sent, with or without a port."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        if name == "localhost" or ipaddress.ip_address(name).is_loopback:
            return
    except ValueError:
        pass
    raise Refused(
        "host.foreign",
        f"This server answers on this machine's own names only, not as {host!r}; open http://127.0.0.1 with its port.",
    )


def _is_upload(scope: Scope) -> bool:
    return UPLOADS.fullmatch(f"{scope['method']} {scope['path']}") is not None


def _cookie(headers: Headers) -> str:
    try:
        morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return "" if morsel is None else str(morsel.value)


def _query_token(scope: Scope) -> str:
    return dict(parse_qsl(scope.get("query_string", b"").decode("latin-1"))).get("token", "")
