"""Reading and writing records. Every call is one transaction; records are frozen, so threads may share them.

What changes of a recording is written column by column, never as a whole row: the row that somebody read may be old.
Jobs change under one lock (app/jobs/states.py), so their rows are whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

from sqlalchemy import Connection, Engine, delete, func, insert, select, update

from app.schemas.jobs import JobState
from app.schemas.recordings import RecordingState
from app.storage.database import DOCUMENTS, JOBS, RECORDINGS
from app.storage.records import JobRecord, RecordingChanges, RecordingRecord


class RecordingStore:
    """Rows of the table of recordings."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def add(self, record: RecordingRecord) -> None:
        """Keep a new recording."""
        with self._engine.begin() as connection:
            connection.execute(insert(RECORDINGS).values(**asdict(record)))

    def find(self, recording_id: str) -> RecordingRecord | None:
        """The recording, or None."""
        with self._engine.connect() as connection:
            row = connection.execute(select(RECORDINGS).where(RECORDINGS.c.id == recording_id)).mappings().one_or_none()
        return None if row is None else RecordingRecord(**row)

    def all_newest_first(self) -> list[RecordingRecord]:
        """Every recording."""
        with self._engine.connect() as connection:
            rows = connection.execute(select(RECORDINGS).order_by(RECORDINGS.c.created_at.desc())).mappings().all()
        return [RecordingRecord(**row) for row in rows]

    def in_states(self, states: Sequence[RecordingState]) -> list[RecordingRecord]:
        """Recordings in any of the states, newest first."""
        query = select(RECORDINGS).where(RECORDINGS.c.state.in_(states)).order_by(RECORDINGS.c.created_at.desc())
        with self._engine.connect() as connection:
            return [RecordingRecord(**row) for row in connection.execute(query).mappings().all()]

    def change(self, recording_id: str, changes: RecordingChanges, *, where: RecordingChanges | None = None) -> bool:
        """Write these columns; whether that was done: not where the recording was deleted meanwhile.

        where: what must be there still for it to be done, looked at in the same statement.
        """
        with self._engine.begin() as connection:
            return _change_recording(connection, recording_id, changes, where=where)

    def remove(self, recording_id: str) -> None:
        """Delete the row; its jobs and documents go with it."""
        with self._engine.begin() as connection:
            connection.execute(delete(RECORDINGS).where(RECORDINGS.c.id == recording_id))


class JobStore:
    """Rows of the table of jobs."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def add(self, record: JobRecord, *, recording: RecordingChanges | None = None) -> JobRecord:
        """The new job as kept: behind all others.   recording: what changes of its recording with it."""
        with self._engine.begin() as connection:
            _change_recording(connection, record.recording_id, recording or {})
            last = connection.execute(select(func.max(JOBS.c.sequence))).scalar_one()
            kept = replace(record, sequence=(last or 0) + 1)
            connection.execute(insert(JOBS).values(**asdict(kept)))
        return kept

    def find(self, job_id: str) -> JobRecord | None:
        """The job, or None."""
        with self._engine.connect() as connection:
            row = connection.execute(select(JOBS).where(JOBS.c.id == job_id)).mappings().one_or_none()
        return None if row is None else JobRecord(**row)

    def of_recording(self, recording_id: str) -> list[JobRecord]:
        """The recording's jobs, newest first."""
        query = select(JOBS).where(JOBS.c.recording_id == recording_id).order_by(JOBS.c.sequence.desc())
        with self._engine.connect() as connection:
            return [JobRecord(**row) for row in connection.execute(query).mappings().all()]

    def in_states(self, states: Sequence[JobState]) -> list[JobRecord]:
        """Jobs in any of the states, oldest first."""
        query = select(JOBS).where(JOBS.c.state.in_(states)).order_by(JOBS.c.sequence)
        with self._engine.connect() as connection:
            return [JobRecord(**row) for row in connection.execute(query).mappings().all()]

    def save(self, record: JobRecord, *, recording: RecordingChanges | None = None) -> JobRecord:
        """Replace the row of the same id; nothing happens where it has been deleted meanwhile.

        recording: what changes of its recording with it, both or none of them. First, as a deletion takes them.
        """
        with self._engine.begin() as connection:
            _change_recording(connection, record.recording_id, recording or {})
            connection.execute(update(JOBS).where(JOBS.c.id == record.id).values(**asdict(record)))
        return record


class DocumentStore:
    """JSON texts by recording and name."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def read(self, recording_id: str, name: str) -> str | None:
        """The text, or None."""
        query = select(DOCUMENTS.c.content_json).where(
            DOCUMENTS.c.recording_id == recording_id, DOCUMENTS.c.name == name
        )
        with self._engine.connect() as connection:
            return connection.execute(query).scalar_one_or_none()

    def write(self, recording_id: str, name: str, content_json: str) -> None:
        """Replace the text."""
        key = (DOCUMENTS.c.recording_id == recording_id) & (DOCUMENTS.c.name == name)
        with self._engine.begin() as connection:
            if connection.execute(update(DOCUMENTS).where(key).values(content_json=content_json)).rowcount == 0:
                connection.execute(
                    insert(DOCUMENTS).values(recording_id=recording_id, name=name, content_json=content_json)
                )


def _change_recording(
    connection: Connection, recording_id: str, changes: RecordingChanges, *, where: RecordingChanges | None = None
) -> bool:
    """Whether there is such a row, and these columns of it were written."""
    if not changes:
        return False
    wanted = RECORDINGS.c.id == recording_id
    for name, value in (where or {}).items():
        wanted &= RECORDINGS.c[name] == value
    return connection.execute(update(RECORDINGS).where(wanted).values(**changes)).rowcount == 1
