"""Progress that never goes back, whatever a long computation does twice."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from calib_core.events import PLANNED, Event, ForwardOnly, LogEvent, Stage, StageEvent

STAGES = PLANNED["full"]


def passed_on(events: list[StageEvent | LogEvent]) -> list[Event]:
    heard: list[Event] = []
    listener = ForwardOnly(heard.append, STAGES)
    for event in events:
        listener(event)
    return heard


@given(st.lists(st.tuples(st.sampled_from(STAGES), st.floats(0.0, 1.0))))
def test_neither_stage_nor_fraction_goes_back_and_every_word_is_heard(told: list[tuple[Stage, float]]) -> None:
    """Mutations: pass events on as they are; forget the fraction when a stage is told again; swallow what goes back."""
    events: list[StageEvent | LogEvent] = [
        StageEvent(stage=stage, fraction=fraction, text=str(k)) for k, (stage, fraction) in enumerate(told)
    ]
    heard = [event for event in passed_on(events) if isinstance(event, StageEvent)]
    assert [event.text for event in heard] == [str(k) for k in range(len(told))]
    places = [(STAGES.index(event.stage), event.fraction) for event in heard]
    assert places == sorted(places)
    for event, (stage, fraction) in zip(heard, told, strict=True):
        assert (STAGES.index(event.stage), event.fraction) >= (STAGES.index(stage), fraction)


def test_what_is_no_stage_of_the_plan_is_left_alone() -> None:
    """Reading and deskewing have their own. Mutation: hold back whatever is not planned."""
    events: list[StageEvent | LogEvent] = [
        StageEvent(stage="read", fraction=0.7),
        StageEvent(stage="solve", fraction=0.2),
        LogEvent(level="info", code="imu.noise", text="noise"),
        StageEvent(stage="read", fraction=0.1),
    ]
    assert passed_on(events) == events


def test_a_second_attempt_says_again_only_what_is_new() -> None:
    """The page had a sentence twice of two attempts. Mutations: all passed on; sentences told apart by their codes alone."""
    rough, again = (
        LogEvent(level="warning", code="planes.moved", text=text) for text in ("wall 1 moved", "wall 2 moved")
    )
    assert passed_on([rough, again, rough.model_copy(), again]) == [rough, again]
