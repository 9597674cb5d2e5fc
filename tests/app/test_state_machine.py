"""The life of a job, exhaustively."""

from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.jobs.state_machine import FINAL, SENTENCES, TRANSITIONS, IllegalTransition, Signal, may_start, transition
from app.schemas.jobs import JobState

STATES = get_args(JobState)
SIGNALS = get_args(Signal)


@pytest.mark.parametrize("state", sorted(FINAL))
@pytest.mark.parametrize("signal", SIGNALS)
def test_nothing_follows_a_final_state(state, signal):
    """Mutation: adding ("done", "cancel"): "cancelled" makes a finished job lose its result."""
    with pytest.raises(IllegalTransition):
        transition(state, signal)


def test_every_state_has_a_sentence_and_can_be_reached():
    """Mutation: removing ("running", "lose") leaves "interrupted" unreachable."""
    assert set(SENTENCES) == set(STATES)
    assert set(TRANSITIONS.values()) | {"queued"} == set(STATES)


@settings(deadline=None)  # a loaded machine is no failure
@given(st.lists(st.sampled_from(SIGNALS), max_size=30))
def test_any_story_ends_at_most_once_and_a_cancelled_job_was_asked(signals):
    """Law: after a final state no signal is accepted; "cancelled" is reached only after "cancel".

    Mutation: ("running", "stop"): "cancelled" reaches it unasked.
    """
    state, accepted = "queued", []
    for signal in signals:
        try:
            state = transition(state, signal)
            accepted.append(signal)
        except IllegalTransition:
            continue
    if state == "cancelled":
        assert "cancel" in accepted
    if state in {"done", "failed", "interrupted"}:
        assert accepted[0] == "start"


@settings(deadline=None)  # a loaded machine is no failure
@given(st.integers(0, 20), st.integers(0, 20), st.integers(1, 20))
def test_never_more_than_the_limit_run(queued, running, limit):
    """Mutation: `limit - running` without max(0, ...) starts a negative number."""
    started = may_start(queued, running, limit)
    assert 0 <= started <= queued
    assert started == 0 or running + started <= limit
    if running < limit:
        assert started == min(queued, limit - running)
