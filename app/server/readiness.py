"""Whether the server can do its work: whether its store and its data directory can be written."""

from __future__ import annotations

import threading
import time

from sqlalchemy import Engine

from app.storage.database import touch_database
from app.storage.files import DataFolder

#: So long an answer holds: whoever may ask may ask as often as he likes.
READY_FOR_S = 1.0


class Readiness:
    """Asked often, tried seldom. Thread-safe."""

    def __init__(self, engine: Engine, files: DataFolder) -> None:
        self._engine = engine
        self._files = files
        self._lock = threading.Lock()
        self._ready_at_s = float("-inf")

    def check(self) -> None:
        """Raise Unavailable or DiskFull unless both can be written."""
        with self._lock:
            if time.monotonic() - self._ready_at_s > READY_FOR_S:
                touch_database(self._engine)
                self._files.check_writable()
                self._ready_at_s = time.monotonic()
