"""A list of messages that threads append to and coroutines follow, from any place in it."""

from __future__ import annotations

import asyncio
import re
import threading
from collections import deque
from collections.abc import AsyncIterator
from typing import Generic, TypeVar

Entry = TypeVar("Entry")
#: Numbers given out are short; a longer one was never given out, and reading thousands of digits is an error of its own.
_NUMBER = re.compile(r"[0-9]{1,15}", re.ASCII)


def number_of(event_id: str | None) -> int | None:
    """The number that a message's id, as a browser hands it back, stands for; None where it is none of ours."""
    return int(event_id) if event_id and _NUMBER.fullmatch(event_id) else None


#: So many entries are fetched one by one from the end; more are cut out of a copy of all.
FEW = 64


class Journal(Generic[Entry]):
    """Entries numbered from `first`; the newest `limit` are kept. After `close` followers come to their end."""

    def __init__(self, *, first: int = 0, limit: int | None = None) -> None:
        self._entries: deque[Entry] = deque(maxlen=limit)
        self._next = first
        self._closed = False
        self._lock = threading.Lock()
        self._followers: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()

    @property
    def oldest(self) -> int:
        """The number of the oldest entry still kept."""
        with self._lock:
            return self._next - len(self._entries)

    @property
    def end(self) -> int:
        """The number the next entry will have."""
        with self._lock:
            return self._next

    def append(self, entry: Entry) -> int:
        """Add an entry; its number."""
        with self._lock:
            number = self._next
            self._entries.append(entry)
            self._next += 1
        self._wake()
        return number

    def close(self) -> None:
        """Nothing more will come."""
        with self._lock:
            self._closed = True
        self._wake()

    def since(self, number: int) -> tuple[list[tuple[int, Entry]], bool]:
        """Kept entries from `number` on with their numbers, and whether nothing more will come."""
        with self._lock:
            oldest = self._next - len(self._entries)
            start = max(number, oldest)
            wanted = max(0, self._next - start)
            # Followers ask for the newest few, on the event loop, of a journal that may have a hundred thousand.
            few = (self._entries[place] for place in range(-wanted, 0))
            kept = list(few) if wanted < FEW else list(self._entries)[start - oldest :]
            return list(enumerate(kept, start=start)), self._closed

    async def follow(self, number: int) -> AsyncIterator[tuple[int, Entry]]:
        """Entries from `number` on, as they come, until the journal is closed."""
        follower = (asyncio.get_running_loop(), asyncio.Event())
        with self._lock:
            self._followers.add(follower)
        try:
            while True:
                follower[1].clear()
                entries, closed = self.since(number)
                for found, entry in entries:
                    yield found, entry
                    number = found + 1
                if closed:
                    return
                await follower[1].wait()
        finally:
            with self._lock:
                self._followers.discard(follower)

    def _wake(self) -> None:
        with self._lock:
            followers = list(self._followers)
        for loop, event in followers:
            if not loop.is_closed():
                loop.call_soon_threadsafe(event.set)
