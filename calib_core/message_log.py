"""The messages of one result: what is said on the way to it, each sentence once, but for what turned out not to be true of it."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from calib_core.events import Event, LogEvent, OnEvent
from calib_core.result import Message


class MessageLog:
    """A listener to events that keeps the sentences (`LogEvent`) as the result's messages, and passes every event on.

    on_event: who hears all events, at once; what is taken back from the messages has been heard there.
    messages: said so far, each once; those that were known beforehand come first.
    """

    def __init__(self, on_event: OnEvent, messages: Sequence[Message] = ()) -> None:
        self._on_event = on_event
        self.messages = list(messages)

    def __call__(self, event: Event) -> None:
        if isinstance(event, LogEvent):
            message = Message(code=event.code, level=event.level, text=event.text)
            if message not in self.messages:  # a second attempt finds again what the first one did
                self.messages.append(message)
        self._on_event(event)

    def snapshot(self) -> list[Message]:
        """A copy of the messages, for `restore`."""
        return list(self.messages)

    def restore(self, snapshot: Sequence[Message]) -> None:
        """Go back to a snapshot: what an attempt that led nowhere has said, or retracted, is not true of the answer."""
        self.messages[:] = snapshot

    def retract(self, codes: Collection[str]) -> None:
        """Remove the messages of these codes: whoever said them looks again, and says what is true then."""
        self.messages[:] = [message for message in self.messages if message.code not in codes]

    def another(self, snapshot: Sequence[Message]) -> MessageLog:
        """A log of its own that begins with a snapshot and has the same listener, for another way to an answer."""
        return MessageLog(self._on_event, snapshot)
