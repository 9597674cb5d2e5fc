"""Jobs: queue fairly, run N at once, cancel, survive restarts. Thread-safe; one supervising thread per running job.

states.py has what state each is in, waiting_line.py who waits where; here is what can be done with them, and how one is seen
through.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
import uuid
from collections import Counter
from collections.abc import AsyncIterator, Callable, Sequence
from datetime import UTC, datetime
from typing import cast

from anyio import to_thread
from fastapi.sse import ServerSentEvent

from app.bus import Bus
from app.errors import Conflict, DiskFull, NotFound, TooMany, facts_of
from app.events import QueueMoved
from app.jobs.asking import ASKING
from app.jobs.journal import number_of
from app.jobs.launch import Launcher
from app.jobs.log import JobLogs
from app.jobs.orders import Failed, Finished, Order, OrderedPlane, Parcel, Stopped, StoredRequest
from app.jobs.processes import Processes
from app.jobs.state_machine import FINAL, IllegalTransition
from app.jobs.states import JobStates
from app.jobs.stored_parts import SERVER_STOPPED, answering, telling
from app.jobs.waiting_line import Line
from app.jobs.wire import DIED, STOPPED, too_long
from app.logs import about
from app.schemas.jobs import Job, JobKind, JobMessage, JobState, PlaneLook
from app.settings import AppSettings
from app.storage.files import DataFolder
from app.storage.records import JobRecord, RecordingChanges
from app.storage.store import JobStore

_LOG = logging.getLogger("unsweep")

#: So many of those that wait are told when their place has changed; who is farther back sees it at the next look.
TOLD_PLACES = 50

#: How often a job that has ended looks whether the disk has room for its state.
FULL_DISK_POLL_S = 1.0
#: How long a deleted recording's jobs have to go away.
STOP_WAIT_S = 10.0


class JobService:
    """All jobs of the application.

    make_order: what a job's worker is told.   means: what changes of a recording with a job of it.
    looks_of: how planes of a recording's solve are shown.
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
        means: Callable[[JobRecord], RecordingChanges] = lambda _: {},
        looks_of: Callable[[str, Sequence[OrderedPlane]], list[PlaneLook]] = lambda _, __: [],
    ) -> None:
        self.logs = JobLogs(files)
        self._store = store
        self._files = files
        self._settings = settings
        self._launcher = launcher
        self._processes = Processes(launcher, grace_s=settings.cancel_grace_s)
        self._make_order = make_order
        self._bus = bus
        self._lock = threading.RLock()
        self._line = Line(store, self._lock)
        self._states = JobStates(store, self.logs, self._line, lock=self._lock, bus=bus, means=means, looks_of=looks_of)
        self._threads: dict[str, threading.Thread] = {}
        self._closing = False

    # What there is

    def get(self, job_id: str) -> JobRecord:
        """The job, or NotFound."""
        return self._states.get(job_id)

    def list_of(self, recording_id: str) -> list[Job]:
        """The recording's jobs, newest first."""
        return [self.wire(record) for record in self._store.of_recording(recording_id)]

    def latest(self, recording_id: str) -> Job | None:
        """The job that says where the recording stands."""
        record = telling(self._store.of_recording(recording_id))
        return None if record is None else self.wire(record)

    def latest_answer(self, recording_id: str) -> Job | None:
        """The newest solve that came to an answer."""
        record = answering(self._store.of_recording(recording_id))
        return None if record is None else self.wire(record)

    def records_of(self, recording_id: str) -> list[JobRecord]:
        """The recording's jobs as kept, newest first."""
        return self._store.of_recording(recording_id)

    def interrupted(self) -> list[JobRecord]:
        """Jobs under which a server ended, and which no later one of the kind and recording has made up for; oldest first."""
        found = self._store.in_states(["interrupted"])
        newest = {
            (job.kind, job.recording_id): job.id
            for recording_id in {job.recording_id for job in found}
            for job in reversed(self._store.of_recording(recording_id))
        }
        return [job for job in found if newest.get((job.kind, job.recording_id)) == job.id]

    def wire(self, record: JobRecord) -> Job:
        """The job as the wire carries it."""
        return self._states.wire(record)

    async def watch(self, job_id: str, last_event_id: str | None) -> AsyncIterator[JobMessage]:
        """The job's messages after `last_event_id`, as server-sent events, until its final state."""
        journal = await to_thread.run_sync(self._states.journal, job_id)
        last = number_of(last_event_id)
        # A number that was never given out, or of a log that has lost its end on a full disk: all is told again.
        start = 0 if last is None or last >= journal.end else last + 1
        async for number, line in journal.follow(start):
            # Already JSON: FastAPI passes a ServerSentEvent on as it is; the annotation documents its data.
            yield cast(JobMessage, ServerSentEvent(raw_data=line, id=str(number)))

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
        self._states.add(record)
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
            record = self._states.move(job_id, "cancel")
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
                self._states.move(record.id, "cancel")
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
            self._states.move(record.id, "lose")
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
        slots = self._launcher.slots()  # not under the lock: another machine may have to be asked
        limit = self._settings.concurrent_jobs if slots is None else slots
        with self._lock:
            if self._closing:
                return
            moved = self._line.advance(running=len(self._threads), limit=limit, start=self._start)
        if moved:
            self._bus.publish(QueueMoved([self.wire(record) for record in moved[:TOLD_PLACES]]))

    # How it is done

    def _start(self, record: JobRecord) -> None:
        record = self._states.change(record, "start")
        thread = threading.Thread(target=self._supervise, args=(record,), name=f"job-{record.id[:8]}", daemon=True)
        self._threads[record.id] = thread
        thread.start()

    def _supervise(self, record: JobRecord) -> None:
        with about(recording_id=record.recording_id, job_id=record.id):
            self._see_through(record)

    def _see_through(self, record: JobRecord) -> None:
        ASKING.set(self._line.client_of(record.id))  # what follows from the job is asked for by the same
        try:
            self._states.tell(record)
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
                self._line.leave(record.id)
                self._states.forget_progress(record.id)
            self.start_queued()

    def _end_when_there_is_room(self, job_id: str, ending: Parcel | None) -> None:
        """End the job, and have drawn what follows from that; on a full disk once it can be kept.

        It ends once, however often what follows has to be tried.
        """
        ended: JobRecord | None = None
        while True:
            try:
                if ended is None:
                    ended = self._end(job_id, ending)
                self._states.tell(ended)
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
            on_parcel=lambda parcel: self._states.note(record, parcel.event),
        )

    def _heed(self, job_id: str) -> None:
        """What was asked for while the process was being started."""
        if self._closing:
            self._processes.terminate(job_id)
        elif self.get(job_id).state == "cancelling":
            self._processes.ask_to_stop(job_id)

    def _end(self, job_id: str, ending: Parcel | None) -> JobRecord:
        if isinstance(ending, Finished):
            return self._states.enter(job_id, "finish", outcome_json=ending.outcome.model_dump_json())
        if isinstance(ending, Failed):
            return self._states.enter(job_id, "fail", error_json=ending.error.model_dump_json())
        if self._closing:
            return self._states.enter(job_id, "lose", error_json=SERVER_STOPPED.model_dump_json())
        if self._processes.is_overdue(job_id):
            facts = too_long(self._settings.limit_s(self.get(job_id).kind))
            return self._states.enter(job_id, "fail", error_json=facts.model_dump_json())
        if self.get(job_id).state == "cancelling":
            return self._states.enter(job_id, "stop")
        facts = STOPPED if isinstance(ending, Stopped) else DIED
        return self._states.enter(job_id, "fail", error_json=facts.model_dump_json())
