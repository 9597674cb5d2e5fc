"""Calls made not too often, the last one never lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Throttle:
    """Calls `act` for every burst of requests: at once, then at most every `interval_s`, and after the last of them."""

    def __init__(self, act: Callable[[], None], interval_s: float) -> None:
        self._act = act
        self._interval_s = interval_s
        self._lock = threading.Lock()
        self._acted_at_s = float("-inf")
        self._timer: threading.Timer | None = None

    def request(self) -> None:
        """Have it done soon."""
        with self._lock:
            if self._timer is not None:
                return  # what is due will see what has changed
            wait_s = self._acted_at_s + self._interval_s - time.monotonic()
            if wait_s > 0:
                self._timer = threading.Timer(wait_s, self._due)
                self._timer.daemon = True
                self._timer.start()
                return
            self._acted_at_s = time.monotonic()
        self._act()

    def stop(self) -> None:
        """Do nothing more."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()

    def _due(self) -> None:
        with self._lock:
            self._timer = None
            self._acted_at_s = time.monotonic()
        self._act()
