"""Starting and stopping worker processes. The only place that knows how a job becomes a process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
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
#: So often, and after so long each time, a process is started anew that none forks.
BIRTHS, BIRTH_S = 10, 0.05

#: Forked, a job begins with all imported, in some hundredths of a second; elsewhere what libraries hold does not survive it.
FORKED = sys.platform.startswith("linux")
_PROCESSES = multiprocessing.get_context("forkserver") if FORKED else multiprocessing.get_context("spawn")
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
        """The server stops: let go of what jobs were started with."""


class ProcessLauncher:
    """One process per job. `entry`: module:function of the job function.

    The module is imported once, by the process that jobs are forked from, where the system has such: what it imports no job
    imports again. There is one such process, and it has what the first launcher named.
    """

    def __init__(self, entry: str = "app.work.ready:run_job") -> None:
        self._entry = entry

    def launch(self, order: Order) -> RunningJob:
        """Start the job in a process of its own."""
        receiver, sender = _PROCESSES.Pipe(duplex=False)
        alive, server_alive = _PROCESSES.Pipe(duplex=False)
        cancel = _PROCESSES.Event()
        process = _PROCESSES.Process(
            target=run_worker,
            args=(self._entry, order.model_dump_json(), sender, cancel, alive),
            name="unsweep-worker",
            daemon=True,
        )
        with _birth():
            self._name_what_is_needed()
            _start(process)
        sender.close()  # so that the pipe ends when the child does
        alive.close()
        return JobProcess(process, receiver, cancel, server_alive)

    def slots(self) -> None:
        """As many as the settings say."""

    def prepare(self) -> None:
        """Start the process that jobs are forked from: what it imports takes longer than reading a cloud."""
        if FORKED:
            from multiprocessing.forkserver import ensure_running  # not made for every system

            with _birth():
                self._name_what_is_needed()
                ensure_running()

    def close(self) -> None:
        """Nothing: the process that jobs are forked from is this process's, and ends with it."""

    def _name_what_is_needed(self) -> None:
        if FORKED:
            _PROCESSES.set_forkserver_preload(["__main__", self._entry.partition(":")[0]])


class JobProcess:
    """A worker process and the ends of what connects it. alive: by whose end it knows that this process has ended."""

    def __init__(self, process: BaseProcess, pipe: Connection, cancel: ProcessEvent, alive: Connection) -> None:
        self._alive = alive
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
            self._alive.close()

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


def kill_group(process: BaseProcess) -> None:
    """Kill a worker, which leads a group of its own, and all that it has started. Nothing of it is left to be asked."""
    if process.is_alive():
        process.kill()
    if sys.platform != "win32" and process.pid is not None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)


def _start(process: BaseProcess) -> None:
    """Start it; anew where the process that it is to be forked from has just ended, which is seen a moment later."""
    for _ in range(BIRTHS - 1):
        try:
            process.start()
        except (EOFError, ConnectionError):
            time.sleep(BIRTH_S)
        else:
            return
    process.start()


@contextmanager
def _birth() -> Iterator[None]:
    """One child at a time, deaf to Ctrl-C, in the environment of one."""
    with _ENVIRONMENT:
        if FORKED:
            resource_tracker.ensure_running()  # begun on the way to a child, it would have that child hear interrupts
        with interrupts_unheard(), _capped_threads():
            yield


@contextmanager
def _capped_threads() -> Iterator[None]:
    """The environment a child is born with; numerical libraries read it once, when they are loaded."""
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
