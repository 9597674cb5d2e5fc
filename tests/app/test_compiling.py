"""What is compiled while a job runs is said, once, and not taken for what it does."""

from __future__ import annotations

import numpy as np
from numba import njit

from app.compiling import COMPILING, compiling_told
from calib_core.events import LogEvent, StageEvent

SOLVING = StageEvent(stage="solve", fraction=0.3, text="round 2")


def texts(heard: list[StageEvent | LogEvent]) -> list[str]:
    return [event.text for event in heard]


def test_a_loop_that_is_compiled_is_said_and_what_goes_on_said_again() -> None:
    """Mutations: told for each loop that another needs; told of one that is compiled already; the stage's words not restored."""

    @njit
    def inner(x):
        return x * 2.0

    @njit
    def outer(x):
        return inner(x) + 1.0

    heard: list[StageEvent | LogEvent] = []
    with compiling_told(heard.append) as told:
        outer(1.0)  # nothing was said yet that could be repeated
        told(SOLVING)
        outer(2.0)  # compiled for numbers already
        assert texts(heard) == ["round 2"]
        outer(np.ones(3))
        assert texts(heard) == ["round 2", COMPILING, "round 2"]
        told(LogEvent(level="info", code="x", text="a remark"))
        assert heard[-1].text == "a remark"
        assert {event.fraction for event in heard if isinstance(event, StageEvent)} == {SOLVING.fraction}
    outer(np.ones((3, 3)))
    assert len(heard) == 4


def test_what_is_not_of_a_stage_is_passed_on() -> None:
    """Mutation: only stages passed on."""
    heard: list[StageEvent | LogEvent] = []
    with compiling_told(heard.append) as told:
        told(LogEvent(level="info", code="x", text="a remark"))
    assert texts(heard) == ["a remark"]
