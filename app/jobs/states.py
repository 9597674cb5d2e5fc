"""In which state each job is: changed under one lock, kept in the store, logged and told on the bus.

What may follow what is in state_machine.py. Progress lives in memory: it is worth nothing after a restart.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from app.bus import Bus
from app.errors import NotFound
from app.events import JobMoved, JobSaid, JobStepped
from app.jobs.journal import Journal
from app.jobs.log import JobLogs
from app.jobs.orders import OrderedPlane
from app.jobs.state_machine import FINAL, Signal, transition
from app.jobs.stored_parts import request_of
from app.jobs.waiting_line import Line
from app.jobs.wire import Progress, job_of
from app.schemas.jobs import Job, JobState, JobStateEvent, PlaneLook
from app.storage.records import JobRecord, RecordingChanges
from app.storage.store import JobStore
from calib_core.events import Event, IterationEvent, LogEvent, StageEvent


class JobStates:
    """The states of all jobs.

    lock: under which they change.   means: what changes of a recording with a job of it, in the same transaction.
    looks_of: how planes of a recording's solve are shown.
    """

    def __init__(
        self,
        store: JobStore,
        logs: JobLogs,
        line: Line,
        *,
        lock: threading.RLock,
        bus: Bus,
        means: Callable[[JobRecord], RecordingChanges],
        looks_of: Callable[[str, Sequence[OrderedPlane]], list[PlaneLook]],
    ) -> None:
        self._store = store
        self._logs = logs
        self._line = line
        self._lock = lock
        self._bus = bus
        self._means = means
        self._looks_of = looks_of
        self._progress: dict[str, Progress] = {}

    def get(self, job_id: str) -> JobRecord:
        """The job, or NotFound."""
        record = self._store.find(job_id)
        if record is None:
            raise NotFound("job.not_found", f"No job has the id {job_id}; its recording may have been deleted.")
        return record

    def wire(self, record: JobRecord) -> Job:
        """The job as the wire carries it."""
        place = self._line.place(record.id) if record.state == "queued" else None
        looks = self._looks_of(record.recording_id, request_of(record).planes or ())
        return job_of(record, self._progress.get(record.id), place=place, looks=looks)

    def journal(self, job_id: str) -> Journal[str]:
        """What it has said and will say; at its end where it has come to one."""
        with self._lock:  # so that the job cannot end between the look and the subscription
            return self._logs.journal(job_id, live=self.get(job_id).state not in FINAL)

    def add(self, record: JobRecord) -> None:
        """A job that waits."""
        with self._lock:
            record = self._store.add(record, recording=self._means(record))
            self._line.has_moved()
        self.tell(record)

    def move(self, job_id: str, signal: Signal) -> JobRecord:
        """The job in the state that the signal leads to, told; an ending with an outcome or an error is `enter`'s.

        Raises IllegalTransition, NotFound, DiskFull.
        """
        record = self.enter(job_id, signal)
        self.tell(record)
        return record

    def enter(
        self, job_id: str, signal: Signal, *, outcome_json: str | None = None, error_json: str | None = None
    ) -> JobRecord:
        """The job in the state that the signal leads to, kept and still to be told: telling may be tried again, this not."""
        with self._lock:
            record = self.change(self.get(job_id), signal, outcome_json=outcome_json, error_json=error_json)
            if record.state in FINAL:
                self._logs.end(self.wire(record))
        return record

    def change(
        self, record: JobRecord, signal: Signal, *, outcome_json: str | None = None, error_json: str | None = None
    ) -> JobRecord:
        """The job as it is in the store after the signal, with what that means for its recording. The lock is held."""
        state: JobState = transition(record.state, signal)
        if record.state == "queued":
            self._line.has_moved()
        now = datetime.now(UTC)
        changed = replace(
            record,
            state=state,
            outcome_json=outcome_json if state == "done" else None,
            error_json=error_json if state in {"failed", "interrupted"} else None,
            started_at=now if signal == "start" else record.started_at,
            ended_at=now if state in FINAL else None,
        )
        return self._store.save(changed, recording=self._means(changed))

    def tell(self, record: JobRecord) -> None:
        """Log and bus of its state; the log has had its last word where it has ended."""
        job = self.wire(record)
        if record.state not in FINAL:
            self._logs.write(record.id, JobStateEvent(job=job))
        self._bus.publish(JobMoved(record, job))

    def note(self, record: JobRecord, event: Event) -> None:
        """What a running job has said."""
        if isinstance(event, StageEvent):
            self._progress[record.id] = Progress(event.stage, event.fraction, event.text)
        self._logs.write(record.id, event)
        if isinstance(event, IterationEvent):
            self._bus.publish(JobStepped(record.recording_id))
        elif isinstance(event, LogEvent):
            self._bus.publish(JobSaid(record, event))

    def forget_progress(self, job_id: str) -> None:
        """The job runs no more. The lock is held."""
        self._progress.pop(job_id, None)
