"""Who has shown the token, remembered for a while: a random id in a cookie, its fingerprint here and on disk.

The cookie says nothing about the token, and what is kept says nothing about the cookie: an id's fingerprint is an HMAC
with the token as its key, so a changed token ends every session.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import os
import secrets
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

COOKIE = "unsweep_session"
#: More people than look at one server; the oldest sessions make room.
MOST_SESSIONS = 1000


class Sessions:
    """Open sessions of one token. Thread-safe.   path: where they outlive a restart.   clock: seconds since 1970."""

    def __init__(self, token: str, path: Path, *, lifetime_s: float, clock: Callable[[], float] = time.time) -> None:
        self._key = token.encode()
        self._path = path
        self._lifetime_s = lifetime_s
        self._clock = clock
        self._lock = threading.Lock()
        self._until: dict[str, float] | None = None

    def begin(self, replaced: str) -> str:
        """A new session's id.   replaced: the id that the browser had before, which ends here; '' is none."""
        fresh = secrets.token_urlsafe(32)
        with self._lock:
            until = self._load()
            until.pop(self._fingerprint(replaced), None)
            until[self._fingerprint(fresh)] = self._clock() + self._lifetime_s
            self._keep(until)
        return fresh

    def end(self, shown: str) -> None:
        """Forget the session of that id."""
        with self._lock:
            until = self._load()
            if until.pop(self._fingerprint(shown), None) is not None:
                self._keep(until)

    def name_of(self, shown: str) -> str | None:
        """A name for who shows this id, good for logs and queues; None where it is no open session."""
        if not shown:
            return None
        fingerprint = self._fingerprint(shown)
        with self._lock:
            until_s = self._load().get(fingerprint)
        return None if until_s is None or until_s <= self._clock() else fingerprint[:12]

    def _fingerprint(self, session_id: str) -> str:
        return hmac.new(self._key, session_id.encode(), hashlib.sha256).hexdigest()

    def _load(self) -> dict[str, float]:
        if self._until is None:
            try:
                found = json.loads(self._path.read_text(encoding="utf-8"))
                self._until = {str(key): float(value) for key, value in found.items()}
            except (
                OSError,
                ValueError,
                AttributeError,
                TypeError,
            ):  # none yet, or unreadable: everybody shows the token
                self._until = {}
        return self._until

    def _keep(self, until: dict[str, float]) -> None:
        now_s = self._clock()
        live = sorted((item for item in until.items() if item[1] > now_s), key=lambda item: item[1])
        self._until = dict(live[-MOST_SESSIONS:])
        try:
            _replace(self._path, json.dumps(self._until))
        except OSError:  # a full disk: sessions then end with the server, and nobody is locked out now
            return


def _replace(path: Path, text: str) -> None:
    descriptor, fresh = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)  # readable by its owner only
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
    Path(fresh).replace(path)
