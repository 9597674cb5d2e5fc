"""Who is next: clients take turns, and each client's recordings do. Pure; knows no process and no store.

Served first is who has least under way; among equals, who was served longest ago; among those, the recording of which the
same holds; among those, what was asked for first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Ticket:
    """A job that waits or runs. sequence: grows with every job asked for."""

    job_id: str
    client: str
    recording_id: str
    sequence: int


@dataclass(frozen=True, slots=True)
class _Line:
    """The jobs of one client about one recording, oldest last."""

    client: str
    recording_id: str
    tickets: list[Ticket]


class Turns:
    """The order in which waiting jobs start, as far as it is known who was served before."""

    def __init__(self) -> None:
        self._served: dict[tuple[str, ...], int] = {}
        self._count = 0

    def serve(self, ticket: Ticket) -> None:
        """The job starts now."""
        self._count += 1
        for key in _keys(ticket.client, ticket.recording_id):
            self._served[key] = self._count

    def order(self, waiting: Iterable[Ticket], running: Iterable[Ticket]) -> list[Ticket]:
        """All that wait, next first, if nothing else is asked for meanwhile. Who has nothing here is forgotten."""
        lines: dict[tuple[str, str], _Line] = {}
        for ticket in sorted(waiting, key=lambda ticket: -ticket.sequence):
            key = (ticket.client, ticket.recording_id)
            lines.setdefault(key, _Line(*key, [])).tickets.append(ticket)
        busy: Counter[tuple[str, ...]] = Counter()
        for ticket in running:
            busy.update(_keys(ticket.client, ticket.recording_id))
        present = {key for line in lines.values() for key in _keys(line.client, line.recording_id)} | set(busy)
        self._served = {key: turn for key, turn in self._served.items() if key in present}
        served, turn, found = dict(self._served), self._count, []
        while lines:
            line = min(lines.values(), key=lambda line: _rank(line, busy, served))
            found.append(line.tickets.pop())
            turn += 1
            for known in _keys(line.client, line.recording_id):
                busy[known] += 1
                served[known] = turn
            if not line.tickets:
                del lines[line.client, line.recording_id]
        return found


def _keys(client: str, recording_id: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    return (client,), (client, recording_id)


def _rank(line: _Line, busy: Counter[tuple[str, ...]], served: dict[tuple[str, ...], int]) -> tuple[int, ...]:
    client, recording = _keys(line.client, line.recording_id)
    return (
        busy[client],
        served.get(client, 0),
        busy[recording],
        served.get(recording, 0),
        line.tickets[-1].sequence,
    )
