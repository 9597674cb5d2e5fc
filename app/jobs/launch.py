"""Starting and stopping worker processes. The only place that knows how a job becomes a process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from multiprocessing.synchronize import Event as ProcessEvent
from typing import Protocol

from app.jobs.orders import PARCEL, Begun, Order, Parcel
from app.jobs.worker import run_worker
from app.process import interrupts_unheard

#: One core per job: many tiny products on many threads were ten times slower than on one.
THREAD_CAPS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "TBB_NUM_THREADS": "1",
}

#: A process that does not end by itself after SIGTERM is killed after this, and all that it has started.
TERMINATE_GRACE_S = 2.0
#: So often a process that says nothing is looked at: a child that it left behind may hold its pipe open.
DEATH_POLL_S = 0.5

_SPAWN = multiprocessing.get_context("spawn")
_ENVIRONMENT = threading.Lock()


class RunningJob(Protocol):
    """A job under way."""

    def parcels(self) -> Iterator[Parcel]:
        """What the job tells, until it ends."""

    def ask_to_stop(self) -> None:
        """Polite: the job looks between its steps."""

    def terminate(self) -> None:
        """Impolite: the job ends now."""


class Launcher(Protocol):
    """What turns an order into a running job: a process here, or another machine's."""

    def launch(self, order: Order) -> RunningJob:
        """Start the job."""

    def slots(self) -> int | None:
        """How many jobs may be under way; None: as many as the settings say."""

    def prepare(self) -> None:
        """The server has started: what makes the first job quicker may be done now."""

    def close(self) -> None:
        """The server stops: end what waits for a job."""


class ProcessLauncher:
    """One spawned process per job. `entry`: module:function of the job function.

    spares: keep so many processes waiting that have imported what jobs need, which takes longer than reading a cloud.
    """

    def __init__(self, entry: str = "app.work.functions:run_job", *, spares: int = 0) -> None:
        self._entry = entry
        self._most_spares = spares
        self._spares: list[Worker] = []
        self._lock = threading.Lock()
        self._closed = False

    def launch(self, order: Order) -> RunningJob:
        """Start the job in a process of its own."""
        worker = self._take_spare() or self._spawn()
        try:
            worker.orders.send_bytes(order.model_dump_json().encode())
        except OSError:  # the spare ended between the look and the word
            worker = self._spawn()
            worker.orders.send_bytes(order.model_dump_json().encode())
        worker.orders.close()
        # The next spare is made when this job has ended: until then the processor is the job's.
        return JobProcess(worker.process, worker.parcels, worker.cancel, on_end=self._replace_spare)

    def slots(self) -> None:
        """As many as the settings say."""

    def prepare(self) -> None:
        """Have all spare processes."""
        for _ in range(self._most_spares):
            self._replace_spare()

    def close(self) -> None:
        """End the spare processes."""
        with self._lock:
            self._closed = True
            workers, self._spares = self._spares, []
        for worker in workers:
            worker.end()

    def _replace_spare(self) -> None:
        if self._most_spares:
            threading.Thread(target=self._make_spare, name="spare-worker", daemon=True).start()

    def _make_spare(self) -> None:
        with self._lock:
            if len(self._spares) < self._most_spares and not self._closed:
                self._spares.append(self._spawn())

    def _take_spare(self) -> Worker | None:
        """The one that has waited longest; those that ended meanwhile are passed over."""
        with self._lock:
            while self._spares:
                worker = self._spares.pop(0)
                if worker.process.is_alive():
                    return worker
        return None

    def _spawn(self) -> Worker:
        orders, order_sender = _SPAWN.Pipe(duplex=False)
        receiver, sender = _SPAWN.Pipe(duplex=False)
        cancel = _SPAWN.Event()
        process = _SPAWN.Process(
            target=run_worker, args=(self._entry, orders, sender, cancel), name="unsweep-worker", daemon=True
        )
        with _capped_threads(), interrupts_unheard():
            process.start()
        orders.close()
        sender.close()  # so that the pipe ends when the child does
        return Worker(process, order_sender, receiver, cancel)


@dataclass(frozen=True)
class Worker:
    """A process that waits for its order, and the ends of what connects it."""

    process: SpawnProcess
    orders: Connection
    parcels: Connection
    cancel: ProcessEvent

    def end(self) -> None:
        """End it; it has no job."""
        self.orders.close()
        self.parcels.close()
        self.process.terminate()
        self.process.join(TERMINATE_GRACE_S)
        kill_group(self.process)


class JobProcess:
    """A worker process and the ends of what connects it."""

    def __init__(
        self,
        process: SpawnProcess,
        pipe: Connection,
        cancel: ProcessEvent,
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self._on_end = on_end
        self._process = process
        self._pipe = pipe
        self._cancel = cancel

    def parcels(self) -> Iterator[Parcel]:
        """What the worker tells, until it ends; the process is gone afterwards, and all that it has started."""
        try:
            yield Begun()
            while self._pipe.poll(DEATH_POLL_S) or self._process.is_alive() or self._pipe.poll():
                if not self._pipe.poll():
                    continue
                yield PARCEL.validate_json(self._pipe.recv_bytes())
        except (EOFError, OSError):
            return
        finally:
            self._pipe.close()
            self._process.join(TERMINATE_GRACE_S)
            kill_group(self._process)
            self._process.join()
            self._on_end()

    def ask_to_stop(self) -> None:
        """Set the event the job polls."""
        self._cancel.set()

    def terminate(self) -> None:
        """End the process: asked by signal, killed after the grace. Harmless when it has ended."""
        if self._process.is_alive():
            self._process.terminate()
            killing = threading.Timer(TERMINATE_GRACE_S, self._kill)
            killing.daemon = True
            killing.start()

    def _kill(self) -> None:
        if self._process.is_alive():
            kill_group(self._process)


def kill_group(process: SpawnProcess) -> None:
    """Kill a worker, which leads a group of its own, and all that it has started. Nothing of it is left to be asked."""
    if process.is_alive():
        process.kill()
    if sys.platform != "win32" and process.pid is not None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def _capped_threads() -> Iterator[None]:
    """The environment a child is born with; numerical libraries read it once, when they are loaded."""
    with _ENVIRONMENT:
        before = {name: os.environ.get(name) for name in THREAD_CAPS}
        os.environ.update(THREAD_CAPS)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
