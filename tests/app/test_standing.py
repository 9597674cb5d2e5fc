"""Which of a recording's jobs says where it stands."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from app.jobs.kept import telling
from app.schemas.jobs import JobKind
from app.storage.records import JobRecord

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def kept(number: int, kind: JobKind) -> JobRecord:
    """A job that is done."""
    return JobRecord(f"{number:032x}", "r", kind, "done", "{}", None, None, None, NOW, None, None)


@pytest.mark.parametrize(
    ("newest_first", "told"),
    [
        (["audit", "solve", "planes", "inspect"], 1),
        (["audit", "audit", "planes", "inspect"], 0),
        (["inspect", "audit", "solve"], 0),
        (["audit", "inspect", "solve"], 0),
        (["solve", "audit", "inspect"], 0),
    ],
)
def test_an_audit_does_not_stand_before_a_solve(newest_first: list[JobKind], told: int) -> None:
    """A solved recording stays solved when it is audited; read anew it is not. Mutation: the newest of all is taken."""
    jobs = [kept(number, kind) for number, kind in enumerate(newest_first)]
    assert telling(jobs) is jobs[told]


def test_a_recording_without_jobs_stands_nowhere() -> None:
    """Nothing is made up. Mutation: records[0] without looking."""
    assert telling([]) is None
