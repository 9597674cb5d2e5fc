"""How long a browser may take to say what it wants: without an end to it, a thousand half requests hold the server."""

from __future__ import annotations

import asyncio
import json
from typing import cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from app.schemas.common import ErrorFacts
from app.server.errors import body_of

#: A request's head is a few kilobytes; on the slowest line it is here in a second.
HEAD_TIMEOUT_S = 15.0


class PatientH11(H11Protocol):
    """uvicorn's HTTP/1.1 with a time limit on each request's head, from the connection or from its first byte."""

    head_timeout_s = HEAD_TIMEOUT_S
    _waiting: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        """Wait on while a head is incomplete, from its first byte."""
        super().data_received(data)
        if self.conn.their_state is h11.IDLE:
            self._wait()
        else:
            self._stop_waiting()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, or has a head without end, in the one error body."""
        text = f"Expected a request of HTTP/1.1 with a head of ordinary length; {msg[:1].lower()}{msg[1:]}"
        body = json.dumps(body_of(ErrorFacts(code="http.400", text=text))).encode()
        headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
        answer = h11.Response(status_code=400, headers=[*headers, (b"connection", b"close")], reason=b"Bad Request")
        for event in (answer, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _wait(self) -> None:
        if self._waiting is None:
            self._waiting = self.loop.call_later(self.head_timeout_s, self._give_up)

    def _stop_waiting(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()
            self._waiting = None

    def _give_up(self) -> None:
        self._waiting = None
        transport = cast("asyncio.Transport | None", self.transport)
        if transport is not None and self.conn.their_state is h11.IDLE and not transport.is_closing():
            transport.close()
