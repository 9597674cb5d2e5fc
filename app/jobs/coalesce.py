"""Fewer messages, none that matters lost: progress and iterations at most every `interval_s`, log lines all.

Only the last of a burst of progress is of interest. A held message goes out before anything of another kind, so order
is kept, and once the interval has passed: what comes next may take minutes, and it says what that is.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress

from calib_core.events import Event, IterationEvent, LogEvent, StageEvent


def in_a_thread(after_s: float, act: Callable[[], None]) -> None:
    """Have it done after so long; nobody waits for it."""
    timer = threading.Timer(after_s, act)
    timer.daemon = True
    timer.start()


class Coalescer:
    """A listener that passes events on to `send`, one after the other, whatever threads they come from.

    clock: seconds from anywhere, never backwards.   later: has something done after so many seconds, in a thread of its own.
    """

    def __init__(
        self,
        send: Callable[[Event], None],
        *,
        clock: Callable[[], float],
        interval_s: float = 0.05,
        later: Callable[[float, Callable[[], None]], None] = in_a_thread,
    ) -> None:
        self._send = send
        self._clock = clock
        self._interval_s = interval_s
        self._later = later
        self._held: Event | None = None
        self._waiting = False  # whether `later` will look after what is held
        self._sent_at_s = float("-inf")
        self._lock = threading.Lock()  # a pipe takes one message at a time

    def __call__(self, event: Event) -> None:
        """Take an event; pass it on now, or hold it for a newer one of its kind."""
        with self._lock:
            if self._held is not None and not _replaces(event, self._held):
                self._flush()
            if isinstance(event, LogEvent):
                self._send(event)
                return
            self._held = event
            if self._clock() - self._sent_at_s >= self._interval_s:
                self._flush()
            elif not self._waiting:
                self._waiting = True
                self._later(self._interval_s, self._look)

    def _look(self) -> None:
        with self._lock:
            self._waiting = False
            with suppress(OSError):  # who listened is gone; whoever tells next finds out
                self._flush()

    def flush(self) -> None:
        """Pass on what is held."""
        with self._lock:
            self._flush()

    def _flush(self) -> None:
        if self._held is not None:
            held, self._held = self._held, None
            self._sent_at_s = self._clock()
            self._send(held)


def _replaces(newer: Event, held: Event) -> bool:
    if isinstance(newer, StageEvent) and isinstance(held, StageEvent):
        return newer.stage == held.stage
    return isinstance(newer, IterationEvent) and isinstance(held, IterationEvent)
