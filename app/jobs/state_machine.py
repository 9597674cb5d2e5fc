"""The life of a job: states, what may happen in each, and a sentence for each. Pure; knows no process and no store.

queued --start--> running --finish--> done
|                  |----fail------> failed
|                  |----lose------> interrupted       (the server went away under it)
|                  |----cancel----> cancelling --stop, fail, lose--> cancelled
`--cancel--> cancelled                          `--finish--> done      (it was faster than the wish)
"""

from __future__ import annotations

from typing import Literal

from app.schemas.jobs import JobState

Signal = Literal["start", "finish", "fail", "cancel", "stop", "lose"]

FINAL: frozenset[JobState] = frozenset({"done", "failed", "cancelled", "interrupted"})

TRANSITIONS: dict[tuple[JobState, Signal], JobState] = {
    ("queued", "start"): "running",
    ("queued", "cancel"): "cancelled",
    ("running", "finish"): "done",
    ("running", "fail"): "failed",
    ("running", "lose"): "interrupted",
    ("running", "cancel"): "cancelling",
    ("cancelling", "cancel"): "cancelling",
    ("cancelling", "stop"): "cancelled",
    ("cancelling", "fail"): "cancelled",
    ("cancelling", "lose"): "cancelled",
    ("cancelling", "finish"): "done",
}

SENTENCES: dict[JobState, str] = {
    "queued": "Waiting for a free slot.",
    "running": "Running.",
    "cancelling": "Stopping.",
    "done": "Done.",
    "failed": "Failed; the error says why.",
    "cancelled": "Stopped on request; nothing was kept.",
    "interrupted": "The server stopped while this ran; the recording is safe, run it again.",
}


class IllegalTransition(Exception):
    """The signal means nothing in this state."""


def transition(state: JobState, signal: Signal) -> JobState:
    """The state after the signal."""
    try:
        return TRANSITIONS[state, signal]
    except KeyError:
        raise IllegalTransition(f"a job that is {state} cannot {signal}") from None


def may_start(queued: int, running: int, limit: int) -> int:
    """How many queued jobs may start now."""
    return max(0, min(queued, limit - running))


def sentence_of(state: JobState, place: int | None) -> str:
    """The state in one sentence.   place: in the queue, 1 is next; None where it does not wait."""
    if state != "queued" or place is None or place == 1:
        return SENTENCES[state]
    before = place - 1
    return f"Waiting for a free slot; {before} job{'s are' if before > 1 else ' is'} before it."
