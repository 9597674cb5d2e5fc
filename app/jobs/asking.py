"""Who asks, for the queue's sake: set for each request by the server's door, inherited by what the request starts."""

from __future__ import annotations

from contextvars import ContextVar

#: A short name drawn by the server, never a token; "" for what nobody in particular asked for.
ASKING: ContextVar[str] = ContextVar("asking", default="")
