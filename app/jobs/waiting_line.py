"""Those that wait, and at which place: what the store has of them, in the order of queue.py."""

from __future__ import annotations

import threading
from collections.abc import Callable

from app.jobs.queue import Ticket, Turns
from app.jobs.state_machine import may_start
from app.jobs.stored_parts import request_of
from app.storage.records import JobRecord
from app.storage.store import JobStore


class Line:
    """The queue of one server.   lock: under which states change."""

    def __init__(self, store: JobStore, lock: threading.RLock) -> None:
        self._store = store
        self._lock = lock
        self._turns = Turns()
        self._tickets: dict[str, Ticket] = {}
        self._places: dict[str, int] = {}
        self._moved = True

    def has_moved(self) -> None:
        """A job came, or went before its turn."""
        self._moved = True

    def place(self, job_id: str) -> int | None:
        """Its place; the last known one while a change is being written, for which a disk may take its time."""
        if self._moved and self._lock.acquire(blocking=False):
            try:
                waiting = map(ticket_of, self._store.in_states(["queued"]))
                order = self._turns.order(waiting, self._tickets.values())
                self._places = {ticket.job_id: place for place, ticket in enumerate(order, start=1)}
                self._moved = False
            finally:
                self._lock.release()
        return self._places.get(job_id)

    def advance(self, *, running: int, limit: int, start: Callable[[JobRecord], None]) -> list[JobRecord]:
        """Start those whose turn it is; the others whose place is another now. The lock is held.

        running, limit: how many are under way, and may be.   start: changes the state of one.
        """
        before = {} if self._moved else self._places
        waiting = {record.id: record for record in self._store.in_states(["queued"])}
        order = self._turns.order(map(ticket_of, waiting.values()), self._tickets.values())
        free = may_start(len(order), running, limit)
        for ticket in order[:free]:
            self._turns.serve(ticket)
            self._tickets[ticket.job_id] = ticket
            start(waiting[ticket.job_id])
        places = {ticket.job_id: place for place, ticket in enumerate(order[free:], start=1)}
        self._places, self._moved = places, False
        return [waiting[job_id] for job_id, place in places.items() if before.get(job_id) not in {None, place}]

    def client_of(self, job_id: str) -> str:
        """Who asked for a job that runs."""
        return self._tickets[job_id].client

    def leave(self, job_id: str) -> None:
        """The job runs no more. The lock is held."""
        self._tickets.pop(job_id, None)


def ticket_of(record: JobRecord) -> Ticket:
    """The job as the queue knows it."""
    return Ticket(record.id, request_of(record).client, record.recording_id, record.sequence)
