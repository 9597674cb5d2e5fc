"""Starting and stopping worker processes. The only place that knows how a job becomes a process."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from multiprocessing.synchronize import Event as ProcessEvent
from typing import Protocol

from app.jobs.orders import PARCEL, Order, Parcel
from app.jobs.worker import run_worker

#: One core per job: many tiny products on many threads were ten times slower than on one.
THREAD_CAPS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "TBB_NUM_THREADS": "1",
}

#: A process is asked once more after this, then killed.
TERMINATE_GRACE_S = 2.0

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


class ProcessLauncher:
    """One spawned process per job. `entry`: module:function of the job function."""

    def __init__(self, entry: str = "app.jobs.functions:run_job") -> None:
        self._entry = entry

    def launch(self, order: Order) -> RunningJob:
        """Start the job in a process of its own."""
        receiver, sender = _SPAWN.Pipe(duplex=False)
        cancel = _SPAWN.Event()
        process = _SPAWN.Process(
            target=run_worker,
            args=(self._entry, order.model_dump_json(), sender, cancel),
            name=f"unsweep-{order.kind}-{order.job_id[:8]}",
            daemon=True,
        )
        with _capped_threads():
            process.start()
        sender.close()  # so that the pipe ends when the child does
        return JobProcess(process, receiver, cancel)


class JobProcess:
    """A worker process and the ends of what connects it."""

    def __init__(self, process: SpawnProcess, pipe: Connection, cancel: ProcessEvent) -> None:
        self._process = process
        self._pipe = pipe
        self._cancel = cancel

    def parcels(self) -> Iterator[Parcel]:
        """What the worker tells, until its pipe ends; the process is gone afterwards."""
        try:
            while True:
                yield PARCEL.validate_json(self._pipe.recv_bytes())
        except (EOFError, OSError):
            return
        finally:
            self._pipe.close()
            self._process.join(TERMINATE_GRACE_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()

    def ask_to_stop(self) -> None:
        """Set the event the job polls."""
        self._cancel.set()

    def terminate(self) -> None:
        """End the process; harmless when it has ended."""
        if self._process.is_alive():
            self._process.terminate()


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
