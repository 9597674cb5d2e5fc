"""What changes about each recording, told to every browser that looks at it."""

from __future__ import annotations

import threading
import uuid
from collections.abc import AsyncIterator
from typing import cast

from fastapi.sse import ServerSentEvent

from app.jobs.journal import Journal, number_of
from app.schemas.view import (
    ClickRefused,
    JobChanged,
    PlanesChanged,
    RecordingChanged,
    RecordingMessage,
    Resync,
    ViewChanged,
)

AnyChange = PlanesChanged | JobChanged | ViewChanged | RecordingChanged | ClickRefused

#: Messages kept for those who come back; who was away longer fetches everything again.
KEPT_MESSAGES = 256


class RecordingFeed:
    """One journal of JSON texts per recording that is or was looked at. Message ids are `{server start}-{number}`.

    Numbers count from 1: a resync has that of the message before it, where there is none as well.
    """

    def __init__(self) -> None:
        self._boot = uuid.uuid4().hex[:8]
        self._lock = threading.Lock()
        self._journals: dict[str, Journal[str]] = {}
        self._closed = False

    def tell(self, recording_id: str, change: AnyChange) -> None:
        """Tell a change to all who look at the recording."""
        with self._lock:
            journal = self._journals.get(recording_id)
        if journal is not None:
            journal.append(change.model_dump_json())

    def forget(self, recording_id: str) -> None:
        """The recording is deleted: followers come to their end."""
        with self._lock:
            journal = self._journals.pop(recording_id, None)
        if journal is not None:
            journal.close()

    def close(self) -> None:
        """The server stops: followers come to their end."""
        with self._lock:
            self._closed = True
            journals = list(self._journals.values())
        for journal in journals:
            journal.close()

    async def watch(self, recording_id: str, last_event_id: str | None) -> AsyncIterator[RecordingMessage]:
        """Changes from now on, or from where a lost connection ended, as server-sent events."""
        journal = self._journal(recording_id)
        start = self._resume(journal, last_event_id)
        if start is None:
            start = journal.end
            yield self._event(start - 1, Resync().model_dump_json())
        async for number, line in journal.follow(start):
            yield self._event(number, line)

    def _journal(self, recording_id: str) -> Journal[str]:
        with self._lock:
            if recording_id not in self._journals:
                self._journals[recording_id] = Journal(first=1, limit=KEPT_MESSAGES)
                if self._closed:
                    self._journals[recording_id].close()
            return self._journals[recording_id]

    def _resume(self, journal: Journal[str], last_event_id: str | None) -> int | None:
        """Where to go on; None where something was missed."""
        if not last_event_id:
            return journal.end
        boot, _, number = last_event_id.partition("-")
        last = number_of(number)
        if boot != self._boot or last is None:
            return None
        start = last + 1
        return start if journal.oldest <= start <= journal.end else None

    def _event(self, number: int, line: str) -> RecordingMessage:
        # Already JSON: FastAPI passes a ServerSentEvent on as it is; the annotation documents its data.
        return cast(RecordingMessage, ServerSentEvent(raw_data=line, id=f"{self._boot}-{number}"))
