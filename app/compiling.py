"""Says it where loops are being compiled, which happens once on a machine and looks like a stall: minutes without a word."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event as numba_events

from calib_core.events import IterationEvent, LogEvent, OnEvent, StageEvent

COMPILING = "compiling the program's loops for this machine, which is done once"


@contextmanager
def compiling_told(on_event: OnEvent) -> Iterator[OnEvent]:
    """What a computation is to tell its events to: `on_event` hears them all, and when loops are compiled meanwhile."""
    told = _Told(on_event)
    with numba_events.install_listener("numba:compile", told):
        yield told


class _Told(numba_events.Listener):
    """Passes on what it hears, and repeats the latest stage in other words while a loop is compiled."""

    def __init__(self, on_event: OnEvent) -> None:
        self._on_event = on_event
        self._latest: StageEvent | None = None
        self._depth = 0  # one loop may need others

    def __call__(self, event: StageEvent | IterationEvent | LogEvent) -> None:
        if isinstance(event, StageEvent):
            self._latest = event
        self._on_event(event)

    def on_start(self, event: numba_events.Event) -> None:  # noqa: ARG002 - which loop it is says nothing to a person
        """A loop begins to be compiled."""
        self._depth += 1
        if self._depth == 1 and self._latest is not None:
            self._on_event(self._latest.model_copy(update={"text": COMPILING}))

    def on_end(self, event: numba_events.Event) -> None:  # noqa: ARG002
        """It is compiled."""
        self._depth -= 1
        if self._depth == 0 and self._latest is not None:
            self._on_event(self._latest)
