"""Says it where loops are being compiled, which happens once on a machine and looks like a stall: minutes without a word."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from calib_core.events import Event, OnEvent, StageEvent

COMPILING = "compiling the program's loops for this machine, which is done once"


@contextmanager
def compiling_told(on_event: OnEvent) -> Iterator[OnEvent]:
    """What a computation is to tell its events to: `on_event` hears them all, and when loops are compiled meanwhile."""
    # A server that only answers does without. All of it first, so that a thread that brings it in is waited for: whoever takes
    # a part by its own name meanwhile gets it half made, that thread fails within the compiler's lock, and it is never let go.
    import numba  # noqa: F401
    from numba.core import event as compiler

    told = _Told(on_event)

    class Listener(compiler.Listener):
        """Of the compiler's events, which loop it is about says nothing to a person."""

        def on_start(self, event: compiler.Event) -> None:  # noqa: ARG002
            told.begin()

        def on_end(self, event: compiler.Event) -> None:  # noqa: ARG002
            told.end()

    with compiler.install_listener("numba:compile", Listener()):
        yield told


class _Told:
    """Passes on what it hears, and repeats the latest stage in other words while a loop is compiled."""

    def __init__(self, on_event: OnEvent) -> None:
        self._on_event = on_event
        self._latest: StageEvent | None = None
        self._depth = 0  # one loop may need others

    def __call__(self, event: Event) -> None:
        if isinstance(event, StageEvent):
            self._latest = event
        self._on_event(event)

    def begin(self) -> None:
        """A loop begins to be compiled."""
        self._depth += 1
        if self._depth == 1 and self._latest is not None:
            self._on_event(self._latest.model_copy(update={"text": COMPILING}))

    def end(self) -> None:
        """It is compiled."""
        self._depth -= 1
        if self._depth == 0 and self._latest is not None:
            self._on_event(self._latest)
