"""What a person calls a recording, in the place of the name it is kept under.

An upload is kept as source.bag, since users' file names are never used as paths. Sentences about "the file source.bag"
would be about a file nobody has ever seen, so what a job says and writes is told by the recording's own name.
"""

from __future__ import annotations

import json
import re

from app.jobs.orders import Order
from calib_core.events import Event, IterationEvent, OnEvent


def by_name(order: Order, text: str) -> str:
    """The sentence with the recording called by its name."""
    return _renamed(order, order.recording_name, text)


def document_by_name(order: Order, text: str) -> str:
    """A JSON document with the recording called by its name; its other characters stay what they are."""
    return _renamed(order, json.dumps(order.recording_name, ensure_ascii=False)[1:-1], text)


def events_by_name(order: Order, on_event: OnEvent) -> OnEvent:
    """A listener that hands events on with the recording called by its name."""

    def tell(event: Event) -> None:
        if not isinstance(event, IterationEvent):
            event = event.model_copy(update={"text": by_name(order, event.text)})
        on_event(event)

    return tell


def _renamed(order: Order, name: str, text: str) -> str:
    # Where the server keeps things is nobody's business but its own.
    text = text.replace(str(order.source), name)
    for folder in (order.cache, order.folder, order.unpacked, order.source.parent):
        if folder is not None:
            text = text.replace(f"{folder}/", "")
    # Not where it is part of a longer name, nor of a path: who reads a path looks for the file that is kept.
    return re.sub(rf"(?<![\w./\\-]){re.escape(order.source.name)}(?![\w-])", lambda _: name, text)
