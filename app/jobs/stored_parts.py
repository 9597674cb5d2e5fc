"""The JSON parts of a job's row, read without trust: a part that cannot be read costs that part, not the list it is in."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import TypeAdapter, ValidationError

from app.jobs.orders import StoredRequest
from app.jobs.state_machine import FINAL, SENTENCES
from app.schemas.common import ErrorFacts
from app.schemas.jobs import JobKind, Outcome, SolveOutcome
from app.storage.records import JobRecord

_OUTCOME: TypeAdapter[Outcome] = TypeAdapter(Outcome)
#: What begins by itself for a recording, and again after the server ended under it.
BY_ITSELF: frozenset[JobKind] = frozenset({"simulate", "inspect", "planes"})
#: So often in a row the server dies under a job before that counts as what ends it.
MOST_INTERRUPTIONS = 3
SERVER_STOPPED = ErrorFacts(code="job.server_stopped", text=SENTENCES["interrupted"])
UNREADABLE = ErrorFacts(
    code="job.unreadable", text="What this job was asked for cannot be read any more; start it anew from its screen."
)


def request_of(record: JobRecord) -> StoredRequest:
    """What was asked for; a request for nothing in particular where that cannot be read."""
    return readable_request(record) or StoredRequest()


def readable_request(record: JobRecord) -> StoredRequest | None:
    """What was asked for; None where that cannot be read."""
    try:
        return StoredRequest.model_validate_json(record.request_json)
    except ValidationError:
        return None


def error_of(record: JobRecord) -> ErrorFacts | None:
    """Why the job failed; that it cannot be read where it cannot."""
    if readable_request(record) is None:
        return UNREADABLE
    try:
        return None if record.error_json is None else ErrorFacts.model_validate_json(record.error_json)
    except ValidationError:
        return UNREADABLE


def outcome_of(record: JobRecord) -> Outcome | None:
    """How the job ended, where it ended well."""
    try:
        return None if record.outcome_json is None else _OUTCOME.validate_json(record.outcome_json)
    except ValidationError:
        return None


def telling(records: Sequence[JobRecord]) -> JobRecord | None:
    """The job that says where a recording stands, of its jobs newest first.

    What is being done, else the newest solve: its answer is there whatever was read anew, audited or drawn since. Without a
    solve, the newest.
    """
    own = next((record for record in records if record.kind not in {"audit", "surface"}), None)
    if own is not None and own.state not in FINAL:
        return own
    solve = next((record for record in records if record.kind == "solve"), None)
    return solve or next(iter(records), None)


def answering(records: Sequence[JobRecord]) -> JobRecord | None:
    """The newest solve that came to an answer, of a recording's jobs newest first."""
    for record in records:
        if record.kind == "solve" and record.state == "done":
            outcome = outcome_of(record)
            if isinstance(outcome, SolveOutcome) and outcome.status != "refused":
                return record
    return None


def begins_again(job: JobRecord, records: Sequence[JobRecord]) -> bool:
    """Whether a server that starts runs an interrupted job again by itself: not one under which it has died again and again.

    records: of its recording. A server that was told to stop says so in the job's row, one that died says nothing.
    """
    if job.kind not in BY_ITSELF or job.state != "interrupted":
        return False
    by_id = {record.id: record for record in records}
    deaths, one = 0, job
    while one.state == "interrupted":
        deaths += error_of(one) != SERVER_STOPPED
        if one.retry_of not in by_id:
            break
        one = by_id[one.retry_of]
    return deaths < MOST_INTERRUPTIONS
