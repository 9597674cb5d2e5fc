"""Which of a recording's jobs says where it stands."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from app.jobs.stored_parts import answering, telling
from app.results.verdict import solve_outcome
from app.scene.compose import raw_note
from app.schemas.jobs import JobKind, JobState
from app.storage.records import JobRecord
from tests.app.support import world

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def kept(number: int, kind: JobKind, state: JobState = "done") -> JobRecord:
    """A job."""
    return JobRecord(f"{number:032x}", "r", kind, state, "{}", None, None, None, NOW, None, None)


@pytest.mark.parametrize(
    ("newest_first", "told"),
    [
        (["audit", "solve", "planes", "inspect"], 1),
        (["audit", "audit", "planes", "inspect"], 0),
        (["inspect", "audit", "solve"], 2),
        (["audit", "planes", "inspect", "solve"], 3),
        (["solve", "solve", "audit", "inspect"], 0),
    ],
)
def test_a_solve_stands_before_what_only_looked(newest_first: list[JobKind], told: int) -> None:
    """A solved recording stays solved when it is audited or read anew. Mutations: the newest of all; the newest but audits."""
    jobs = [kept(number, kind) for number, kind in enumerate(newest_first)]
    assert telling(jobs) is jobs[told]


@pytest.mark.parametrize("state", ["queued", "running", "cancelling"])
def test_what_is_being_done_stands_before_what_was(state: JobState) -> None:
    """The planes' search that runs is told; an audit that runs is not. Mutation: the newest solve whatever runs."""
    solved = kept(9, "solve")
    looking = kept(0, "planes", state)
    assert telling([looking, solved]) is looking
    assert telling([kept(0, "audit", state), solved]) is solved


def test_a_recording_without_jobs_stands_nowhere() -> None:
    """Nothing is made up. Mutation: records[0] without looking."""
    assert telling([]) is None


def test_an_answer_is_the_newest_that_was_not_refused() -> None:
    """Mutations: the newest solve; the oldest answer; a refusal counted as one; a solve whose end cannot be read."""

    def solved(number: int, status: str) -> JobRecord:
        outcome = world.make_result(status)
        return replace(kept(number, "solve"), outcome_json=solve_outcome(outcome).model_dump_json())

    refused, second, first = solved(0, "refused"), solved(1, "weak"), solved(2, "calibrated")
    torn = replace(kept(3, "solve"), outcome_json="{")
    assert answering([kept(4, "audit"), refused, torn, kept(5, "solve", "cancelled"), second, first]) is second
    assert answering([refused]) is None


@pytest.mark.parametrize(("state", "said"), [("running", "No estimate yet:"), ("done", "No estimate:")])
def test_of_a_run_that_has_ended_no_estimate_is_to_come(state: JobState, said: str) -> None:
    """A refused solve's scene said "No estimate yet". Mutations: said of any run; of another one that has ended."""
    jobs = [kept(1, "solve", state), kept(2, "solve", "done")]
    assert raw_note(jobs[0].id, jobs).startswith(said)
    assert raw_note(None, jobs).startswith("No estimate yet:")
