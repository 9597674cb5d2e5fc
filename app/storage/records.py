"""Records of the store: frozen rows, one class per table. Nested parts are JSON text of their wire models."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import TypedDict

from app.schemas.jobs import JobKind, JobState
from app.schemas.recordings import Origin, RecordingState


@dataclass(frozen=True, slots=True)
class RecordingRecord:
    """One recording. `source` is a path: below the data directory for uploads and samples, absolute for folders.

    name: what people call it.   file_name: what it came as; "" where an earlier version did not keep that.
    source_stamp: of a file or folder that is read in place, what it was when it was last inspected; "" where nobody looked.
    """

    id: str
    name: str
    origin: Origin
    source: str
    scenario: str
    size_bytes: int
    state: RecordingState
    error_json: str | None
    read_settings_json: str
    report_json: str | None
    created_at: datetime
    file_name: str = ""
    source_stamp: str = ""


class RecordingChanges(TypedDict, total=False):
    """The columns of a recording that ever change, named one by one: who changes one leaves the others to others."""

    name: str
    size_bytes: int
    state: RecordingState
    error_json: str | None
    read_settings_json: str
    report_json: str | None
    source_stamp: str


@dataclass(frozen=True, slots=True)
class JobRecord:
    """One run. `request_json` is what it was asked for; `sequence` grows with every job, whatever the clock says."""

    id: str
    recording_id: str
    kind: JobKind
    state: JobState
    request_json: str
    error_json: str | None
    outcome_json: str | None
    retry_of: str | None
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None
    sequence: int = 0
