"""Streams of events that nobody reads any more: whoever closes a page in the middle of one is no defect of the server."""

from __future__ import annotations

import anyio
from starlette.types import ASGIApp, Receive, Scope, Send


class ForgiveLeaving:
    """Middleware: what the web framework raises when a stream's reader leaves with an event on the way, ends here.

    Its own task that passes events on finds its far end closed and says so in a group of exceptions, which would be told as
    a defect, with a traceback in the log.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on."""
        if not is_stream(scope):
            await self._app(scope, receive, send)
            return
        try:
            await self._app(scope, receive, send)
        except BaseExceptionGroup as group:
            _, others = group.split(anyio.BrokenResourceError)
            if others is not None:
                raise


def is_stream(scope: Scope) -> bool:
    """Whether the request is for a stream of events."""
    return scope["type"] == "http" and str(scope["path"]).endswith("/events")
