"""A lock for each name, there only while somebody holds it or waits for it."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class _Entry:
    lock: threading.RLock = field(default_factory=threading.RLock)
    users: int = 0


class NamedLocks:
    """Reentrant locks by name. Who holds one keeps nobody waiting who wants another."""

    def __init__(self) -> None:
        self._registry = threading.Lock()
        self._entries: dict[str, _Entry] = {}

    def __len__(self) -> int:
        """How many there are now."""
        return len(self._entries)

    @contextmanager
    def hold(self, name: str) -> Iterator[None]:
        """Hold the lock of that name."""
        with self._registry:
            entry = self._entries.setdefault(name, _Entry())
            entry.users += 1
        try:
            with entry.lock:
                yield
        finally:
            with self._registry:
                entry.users -= 1
                if entry.users == 0:
                    del self._entries[name]
