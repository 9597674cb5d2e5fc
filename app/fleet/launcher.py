"""The web application's jobs on a dask.distributed cluster: the same process as on the server's machine, beside a worker.

A worker starts it and listens to it by the server's own `ProcessLauncher` and passes on what it tells. Files stay where they
are: workers see the server's data directory and its folder of recordings under the same paths.

server                          scheduler                     worker
launch(order)    ---- a task -------------------------------> run_job_on_worker: a process for the order
parcels()        <--- a queue of (turn, parcel) ------------- what the process tells; (turn, nothing) at its end
ask_to_stop()    ---- the task taken back ------------------> asks the process, and ends it after the grace

A server that dies takes its tasks back, too, since its client is gone. The task of a worker that dies is run again by another
one, in another turn: what a worker that was merely cut off goes on saying is of an earlier turn, and not heard.
dask is an extra: this module is imported when a scheduler is named, never before.
"""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

from app.children import TERMINATE_GRACE_S
from app.errors import Unavailable
from app.fleet.cluster import connect
from app.fleet.on_worker import run_job_on_worker
from app.jobs.launch import RUN_JOB, RunningJob
from app.jobs.orders import PARCEL, Begun, Failed, Happened, Order, Parcel
from app.schemas.common import ErrorFacts
from calib_core import __version__
from calib_core.errors import InputError
from calib_core.events import LogEvent

if TYPE_CHECKING:
    from distributed import Client, Future, Queue

#: How long nothing is heard before it is looked whether the other side is still there.
_LOOK_S = 0.5
#: How long a scheduler that may have gone is waited for when a connection is closed.
_CLOSE_S = 2.0
#: What a message may take on its way, beyond what a job may take to end.
_ON_THE_WAY_S = 5.0

WAITING = Happened(
    event=LogEvent(level="info", code="job.waiting", text="All workers of the cluster are busy; the next one is ours.")
)
MOVED = Happened(
    event=LogEvent(
        level="warning", code="job.moved", text="The worker that ran this was lost; it is run again by another."
    )
)
NO_SCHEDULER = ErrorFacts(
    code="job.no_scheduler",
    text="The cluster's scheduler went away while this ran; the recording is safe, run it again when the scheduler is back.",
)
DOOMED = ErrorFacts(
    code="job.workers_lost",
    text="Every worker that tried this was lost, probably because memory ran out: choose a shorter time span, or larger workers.",
)


class ClusterLauncher:
    """Jobs on the workers of the scheduler at an address, e.g. tcp://host:8786. Raises Unavailable where none answers.

    grace_s: how long a job that was asked to stop may take to.   memory_bytes: of one job; None: its share of its worker's.
    entry: module:function of the job function.
    """

    def __init__(self, address: str, *, grace_s: float, memory_bytes: int | None = None, entry: str = RUN_JOB) -> None:
        self._address = address
        self._grace_s = grace_s
        self._memory_bytes = memory_bytes
        self._entry = entry
        self._lock = threading.Lock()
        self._client = self._connect()

    def launch(self, order: Order) -> RunningJob:
        """Hand the job to the scheduler. Raises Unavailable where it no longer answers."""
        with self._lock:
            if self._client.status != "running":
                self._client.close(timeout=_CLOSE_S)
                self._client = self._connect()
            return ClusterJob(self._client, _whole(order), self._entry, self._grace_s, self._memory_bytes)

    def slots(self) -> int:
        """One job for each thread of the workers; one where there are none yet, which waits for the first."""
        threads = 0
        with suppress(Exception):  # whatever a scheduler that has gone answers; the next job will say so
            threads = sum(self._client.nthreads().values())
        return max(1, threads)

    def prepare(self) -> None:
        """Workers prepare themselves."""

    def close(self) -> None:
        """Let go of the cluster, which takes back what it still has of us."""
        self._client.close(timeout=_CLOSE_S)

    def _connect(self) -> Client:
        try:
            return connect(self._address)
        except InputError as error:
            raise Unavailable("jobs.no_scheduler", str(error)) from error


class ClusterJob:
    """A job that waits for a worker or is run by one."""

    def __init__(self, client: Client, order: Order, entry: str, grace_s: float, memory_bytes: int | None) -> None:
        from distributed import Queue

        self._client = client
        self._longest_end_s = grace_s + TERMINATE_GRACE_S + _ON_THE_WAY_S
        self._stopping_since_s: float | None = None
        self._messages: Queue = Queue(client=client)
        self._future: Future[None] = client.submit(
            run_job_on_worker,
            order.model_dump_json(),
            entry=entry,
            queue_name=self._messages.name,
            version=__version__,
            grace_s=grace_s,
            memory_bytes=memory_bytes,
            key=f"unsweep-{order.kind}-{order.job_id}-{uuid.uuid4().hex[:8]}",
            pure=False,
        )

    def parcels(self) -> Iterator[Parcel]:
        """What the job tells, whoever runs it, until it ends or its cluster does."""
        turn, is_waiting = "", False
        try:
            while True:
                # Looked at before it is listened: what was said up to the end is heard, however late it is looked.
                is_over = self._is_over(has_begun=bool(turn))
                message = self._hear()
                if message is None:
                    if is_over:
                        yield from self._last_words()
                        return
                    if not turn and not is_waiting:
                        is_waiting = True
                        yield WAITING
                    continue
                spoken_in, text = message
                parcel = None if text is None else PARCEL.validate_json(text)
                if isinstance(parcel, Begun):
                    if turn:
                        yield MOVED
                    turn = spoken_in
                if spoken_in != turn:
                    continue
                if parcel is None:
                    return
                yield parcel
        except (OSError, RuntimeError):  # what dask raises where a connection ends
            yield Failed(error=NO_SCHEDULER)
        finally:
            self._take_back()
            with suppress(Exception):  # whatever a scheduler that has gone answers
                self._messages.close()

    def ask_to_stop(self) -> None:
        """Take the task back: the worker sees it and asks the job, which looks between its steps."""
        if self._stopping_since_s is None:
            self._stopping_since_s = time.monotonic()
            self._take_back()

    def terminate(self) -> None:
        """The worker ends the job when its grace is over; there is no quicker word for it."""
        self.ask_to_stop()

    def _take_back(self) -> None:
        with suppress(Exception):  # whatever a scheduler that has gone answers
            self._future.cancel()

    def _hear(self) -> tuple[str, str | None] | None:
        """The next message: in which turn it was spoken, and a parcel as JSON or the end. None where there is none yet."""
        try:
            spoken_in, text = self._messages.get(timeout=_LOOK_S)
        except TimeoutError:
            return None
        return spoken_in, text

    def _is_over(self, *, has_begun: bool) -> bool:
        """Whether nothing more will be said: what is not heard now never will be."""
        if self._stopping_since_s is not None:
            patience_s = self._longest_end_s if has_begun else 2.0 * _LOOK_S
            return time.monotonic() - self._stopping_since_s > patience_s
        return bool(self._future.done())

    def _last_words(self) -> Iterator[Parcel]:
        """Why a job has ended that did not say so itself; nothing where that was asked for, or its process died."""
        if self._client.status != "running" or (self._future.cancelled() and self._stopping_since_s is None):
            yield Failed(error=NO_SCHEDULER)
        elif self._future.status == "error":
            yield Failed(error=_facts_of(self._future))


def _whole(order: Order) -> Order:
    """The order with paths that mean the same in any working directory."""
    paths = {"source": order.source, "cache": order.cache, "folder": order.folder, "unpacked": order.unpacked}
    return order.model_copy(update={name: path and path.absolute() for name, path in paths.items()})


def _facts_of(future: Future[None]) -> ErrorFacts:
    """Why the task itself failed, which the job's own failures never make it do."""
    error = future.exception()
    name = type(error).__name__
    if name == "KilledWorker":
        return DOOMED
    text = (
        f"The cluster's workers could not run the job ({name}): see that the same unsweep is installed on all of them."
    )
    return ErrorFacts(code="job.worker_failed", text=text)
