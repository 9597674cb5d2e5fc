"""How rooms that do not know each other hear of one another: events, and who wants them. Wired once, in services.py."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from app.events import Event

E = TypeVar("E", bound=Event)


class Bus:
    """Passes each event on to those who subscribed to its kind, in their order, in the thread that publishes it.

    Subscribe before anything is published: the table does not change afterwards, so it needs no lock.
    """

    def __init__(self) -> None:
        self._handlers: dict[type[Event], list[Callable[[Event], None]]] = {}

    def subscribe(self, kind: type[E], handler: Callable[[E], None]) -> None:
        """Have the handler called with every event of exactly that kind."""
        self._handlers.setdefault(kind, []).append(cast("Callable[[Event], None]", handler))

    def publish(self, event: Event) -> None:
        """Tell all who want to know. Nobody wants most of them in a test of one room."""
        for handler in self._handlers.get(type(event), ()):
            handler(event)
