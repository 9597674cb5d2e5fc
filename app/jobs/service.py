"""Jobs: queue fairly, run N at once, cancel, survive restarts. Thread-safe; one supervising thread per running job.

The store is the truth about states, machine.py about what may follow what. Progress lives in memory: it is worth
nothing after a restart.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
import uuid
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import cast

from anyio import to_thread
from fastapi.sse import ServerSentEvent

from app.bus import Bus
from app.errors import Conflict, DiskFull, NotFound, TooMany, facts_of
from app.events import JobMoved, JobSaid, JobStepped, QueueMoved
from app.jobs.client import ASKING
from app.jobs.journal import Journal, number_of
from app.jobs.kept import request_of, telling
from app.jobs.launch import Launcher
from app.jobs.log import JobLogs
from app.jobs.machine import FINAL, IllegalTransition, Signal, may_start, transition
from app.jobs.orders import Failed, Finished, Happened, Order, OrderedPlane, Parcel, Stopped, StoredRequest
from app.jobs.processes import Processes
from app.jobs.queue import Ticket, Turns
from app.jobs.wire import DIED, STOPPED, Progress, job_of, too_long
from app.logs import about
from app.schemas.jobs import Job, JobKind, JobMessage, JobState, JobStateEvent, PlaneLook
from app.settings import AppSettings
from app.storage.files import DataFolder
from app.storage.records import JobRecord
from app.storage.store import JobStore
from calib_core.events import IterationEvent, LogEvent, StageEvent

_LOG = logging.getLogger("unsweep")

#: So many of those that wait are told when their place has changed; who is farther back sees it at the next look.
TOLD_PLACES = 50

#: How often a job that has ended looks whether the disk has room for its state.
FULL_DISK_POLL_S = 1.0
#: How long a deleted recording's jobs have to go away.
STOP_WAIT_S = 10.0


class JobService:
    """All jobs of the application.

    make_order: what a job's worker is told.   looks_of: how planes of a recording's solve are shown.
    Tells the bus of every change of state, of what jobs say, and of who has come nearer to the front of the queue.
    """

    def __init__(
        self,
        store: JobStore,
        files: DataFolder,
        *,
        settings: AppSettings,
        launcher: Launcher,
        bus: Bus,
        make_order: Callable[[JobRecord], Order],
        looks_of: Callable[[str, Sequence[OrderedPlane]], list[PlaneLook]] = lambda _, __: [],
    ) -> None:
        self.logs = JobLogs(files)
        self._store = store
        self._files = files
        self._settings = settings
        self._processes = Processes(launcher, grace_s=settings.cancel_grace_s)
        self._make_order = make_order
        self._looks_of = looks_of
        self._bus = bus
        self._lock = threading.RLock()
        self._threads: dict[str, threading.Thread] = {}
        self._progress: dict[str, Progress] = {}
        self._tickets: dict[str, Ticket] = {}
        self._turns = Turns()
        self._places: dict[str, int] = {}
        self._line_moved = True
        self._closing = False

    # What there is

    def get(self, job_id: str) -> JobRecord:
        """The job, or NotFound."""
        record = self._store.find(job_id)
        if record is None:
            raise NotFound("job.not_found", f"No job has the id {job_id}; its recording may have been deleted.")
        return record

    def list_of(self, recording_id: str) -> list[Job]:
        """The recording's jobs, newest first."""
        return [self.wire(record) for record in self._store.of_recording(recording_id)]

    def latest(self, recording_id: str) -> Job | None:
        """The job that says where the recording stands."""
        record = telling(self._store.of_recording(recording_id))
        return None if record is None else self.wire(record)

    def records_of(self, recording_id: str) -> list[JobRecord]:
        """The recording's jobs as kept, newest first."""
        return self._store.of_recording(recording_id)

    def wire(self, record: JobRecord) -> Job:
        """The job as the wire carries it."""
        place = self._place(record.id) if record.state == "queued" else None
        looks = self._looks_of(record.recording_id, request_of(record).planes or ())
        return job_of(record, self._progress.get(record.id), place=place, looks=looks)

    async def watch(self, job_id: str, last_event_id: str | None) -> AsyncIterator[JobMessage]:
        """The job's messages after `last_event_id`, as server-sent events, until its final state."""
        journal = await to_thread.run_sync(self._journal, job_id)
        last = number_of(last_event_id)
        async for number, line in journal.follow(0 if last is None else last + 1):
            # Already JSON: FastAPI passes a ServerSentEvent on as it is; the annotation documents its data.
            yield cast(JobMessage, ServerSentEvent(raw_data=line, id=str(number)))

    def _journal(self, job_id: str) -> Journal[str]:
        with self._lock:  # so that the job cannot end between the look and the subscription
            return self.logs.journal(job_id, live=self.get(job_id).state not in FINAL)

    # What can be done

    def submit(self, recording_id: str, kind: JobKind, request: StoredRequest, *, retry_of: str | None = None) -> Job:
        """Queue a job for whoever asks."""
        request = request.model_copy(update={"client": ASKING.get()})
        record = JobRecord(
            id=uuid.uuid4().hex,
            recording_id=recording_id,
            kind=kind,
            state="queued",
            request_json=request.model_dump_json(),
            error_json=None,
            outcome_json=None,
            retry_of=retry_of,
            created_at=datetime.now(UTC),
            started_at=None,
            ended_at=None,
        )
        with self._lock:
            record = self._store.add(record)
            self._line_moved = True
        self._tell(record)
        self.start_queued()
        return self.wire(self.get(record.id))

    def count_under_way(self) -> Counter[JobState]:
        """How many jobs wait, run, or are being stopped."""
        return Counter(record.state for record in self._store.in_states(["queued", "running", "cancelling"]))

    def check_room(self) -> None:
        """Raise TooMany where no more jobs may wait."""
        if len(self._store.in_states(["queued"])) >= self._settings.max_waiting_jobs:
            raise TooMany(
                "jobs.too_many",
                f"{self._settings.max_waiting_jobs} jobs wait already, the most this server takes: cancel some, or wait.",
            )

    def cancel(self, job_id: str) -> Job:
        """Ask the job to stop, and stop it when the grace has passed."""
        try:
            record = self._move(job_id, "cancel")
        except IllegalTransition:
            found = self.get(job_id)
            raise Conflict("job.ended", f"The job cannot be cancelled: it is {found.state} already.") from None
        self._processes.ask_to_stop(job_id)
        return self.wire(record)

    def stop_all_of(self, recording_id: str) -> None:
        """Stop the recording's jobs and wait until their processes are gone."""
        for record in self._store.of_recording(recording_id):
            if record.state in FINAL:
                continue
            try:
                self._move(record.id, "cancel")
            except IllegalTransition:
                continue
            with self._lock:
                thread = self._threads.get(record.id)
            self._processes.terminate(record.id)
            if thread is not None:
                thread.join(STOP_WAIT_S)

    def recover(self) -> None:
        """After a start of the server: what ran when it ended was interrupted; what was queued starts."""
        for record in self._store.in_states(["running", "cancelling"]):
            self._move(record.id, "lose")
        self.start_queued()

    def close(self) -> None:
        """Stop every job; they will be found interrupted and can be run again."""
        with self._lock:
            self._closing = True
            threads = list(self._threads.values())
        self._processes.terminate_all()
        for thread in threads:
            thread.join(STOP_WAIT_S)
        self.logs.close()

    def start_queued(self) -> None:
        """Start what waits, as far as slots are free, and tell those who wait on where they are."""
        with self._lock:
            if self._closing:
                return
            before = {} if self._line_moved else self._places
            waiting = {record.id: record for record in self._store.in_states(["queued"])}
            order = self._turns.order(map(ticket_of, waiting.values()), self._tickets.values())
            free = may_start(len(order), len(self._threads), self._settings.concurrent_jobs)
            for ticket in order[:free]:
                self._turns.serve(ticket)
                self._tickets[ticket.job_id] = ticket
                self._start(self._change(waiting[ticket.job_id], "start"))
            places = {ticket.job_id: place for place, ticket in enumerate(order[free:], start=1)}
            self._places, self._line_moved = places, False
        moved = [job_id for job_id, place in places.items() if before.get(job_id) not in {None, place}]
        if moved:
            self._bus.publish(QueueMoved([self.wire(waiting[job_id]) for job_id in moved[:TOLD_PLACES]]))

    # How it is done

    def _place(self, job_id: str) -> int | None:
        """Its place in the queue; the last known one while a change is being written, for which a disk may take its time."""
        if self._line_moved and self._lock.acquire(blocking=False):
            try:
                waiting = map(ticket_of, self._store.in_states(["queued"]))
                order = self._turns.order(waiting, self._tickets.values())
                self._places = {ticket.job_id: place for place, ticket in enumerate(order, start=1)}
                self._line_moved = False
            finally:
                self._lock.release()
        return self._places.get(job_id)

    def _start(self, record: JobRecord) -> None:
        thread = threading.Thread(target=self._supervise, args=(record,), name=f"job-{record.id[:8]}", daemon=True)
        self._threads[record.id] = thread
        thread.start()

    def _supervise(self, record: JobRecord) -> None:
        with about(recording_id=record.recording_id, job_id=record.id):
            self._see_through(record)

    def _see_through(self, record: JobRecord) -> None:
        ASKING.set(self._tickets[record.id].client)  # what follows from the job is asked for by the same
        try:
            self._tell(record)
            ending = self._run(record)
        except Exception as error:  # noqa: BLE001 - whatever went wrong, the job must not stay "running" for ever
            status, facts = facts_of(error)
            if status >= 500:
                _LOG.exception("the job could not be run")
            ending = Failed(error=facts)
        try:
            self._end_when_there_is_room(record.id, ending)
            _LOG.info("%s is %s", record.kind, self.get(record.id).state)
        except NotFound:
            shutil.rmtree(self._files.job(record.id), ignore_errors=True)  # its recording was deleted meanwhile
        finally:
            self._processes.forget(record.id)
            with self._lock:
                self._threads.pop(record.id, None)
                self._tickets.pop(record.id, None)
                self._progress.pop(record.id, None)
            self.start_queued()

    def _end_when_there_is_room(self, job_id: str, ending: Parcel | None) -> None:
        """End the job; on a full disk once its state can be kept."""
        while True:
            try:
                self._end(job_id, ending)
            except DiskFull:
                if self._closing:
                    return  # found interrupted at the next start
                time.sleep(FULL_DISK_POLL_S)
            else:
                return

    def _run(self, record: JobRecord) -> Parcel | None:
        """Run the job to its end: its last parcel, or None where the process died without a word."""
        return self._processes.run(
            record.id,
            self._make_order(record),
            limit_s=self._settings.limit_s(record.kind),
            on_start=lambda: self._heed(record.id),
            on_parcel=lambda parcel: self._note(record, parcel),
        )

    def _heed(self, job_id: str) -> None:
        """What was asked for while the process was being started."""
        if self._closing:
            self._processes.terminate(job_id)
        elif self.get(job_id).state == "cancelling":
            self._processes.ask_to_stop(job_id)

    def _note(self, record: JobRecord, parcel: Happened) -> None:
        event = parcel.event
        if isinstance(event, StageEvent):
            self._progress[record.id] = Progress(event.stage, event.fraction, event.text)
        self.logs.write(record.id, event)
        if isinstance(event, IterationEvent):
            self._bus.publish(JobStepped(record.recording_id))
        elif isinstance(event, LogEvent):
            self._bus.publish(JobSaid(record, event))

    def _end(self, job_id: str, ending: Parcel | None) -> None:
        if isinstance(ending, Finished):
            self._move(job_id, "finish", outcome_json=ending.outcome.model_dump_json())
        elif isinstance(ending, Failed):
            self._move(job_id, "fail", error_json=ending.error.model_dump_json())
        elif self._closing:
            self._move(job_id, "lose")
        elif self._processes.is_overdue(job_id):
            facts = too_long(self._settings.limit_s(self.get(job_id).kind))
            self._move(job_id, "fail", error_json=facts.model_dump_json())
        elif self.get(job_id).state == "cancelling":
            self._move(job_id, "stop")
        else:
            self._move(job_id, "fail", error_json=(STOPPED if isinstance(ending, Stopped) else DIED).model_dump_json())

    def _move(
        self, job_id: str, signal: Signal, *, outcome_json: str | None = None, error_json: str | None = None
    ) -> JobRecord:
        with self._lock:
            record = self._change(self.get(job_id), signal, outcome_json=outcome_json, error_json=error_json)
            if record.state in FINAL:
                self.logs.end(self.wire(record))
        self._tell(record, logged=record.state in FINAL)
        return record

    def _change(
        self, record: JobRecord, signal: Signal, *, outcome_json: str | None = None, error_json: str | None = None
    ) -> JobRecord:
        state: JobState = transition(record.state, signal)
        if record.state == "queued":
            self._line_moved = True
        now = datetime.now(UTC)
        return self._store.save(
            replace(
                record,
                state=state,
                outcome_json=outcome_json if state == "done" else None,
                error_json=error_json if state == "failed" else None,
                started_at=now if signal == "start" else record.started_at,
                ended_at=now if state in FINAL else None,
            )
        )

    def _tell(self, record: JobRecord, *, logged: bool = False) -> None:
        job = self.wire(record)
        if not logged:
            self.logs.write(record.id, JobStateEvent(job=job))
        self._bus.publish(JobMoved(record, job))


def ticket_of(record: JobRecord) -> Ticket:
    """The job as the queue knows it."""
    return Ticket(record.id, request_of(record).client, record.recording_id, record.sequence)
