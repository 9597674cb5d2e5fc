"""How a job is started, told, listened to and stopped: a process here (children.py), or another machine's."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Protocol

from app.children import TERMINATE_GRACE_S, Child, begin, get_ready, kill_group
from app.jobs.orders import PARCEL, Begun, Failed, Happened, Order, Parcel
from app.jobs.worker import run_worker
from app.limits import JobLimits, out_of_memory, takes_too_much

#: The function of every job, by name: what it imports is for the process that runs it.
RUN_JOB = "app.work.ready:run_job"
#: So often a process is looked at: what it takes, and whether it is there, since what it left behind may hold its pipe open.
_LOOK_S = 0.1


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
    """One process per job. `entry`: module:function of the job function."""

    def __init__(self, entry: str = RUN_JOB) -> None:
        self._entry = entry

    def launch(self, order: Order) -> RunningJob:
        """Start the job in a process of its own."""
        return JobProcess(begin(run_worker, self._entry, order.model_dump_json()), order.limits)

    def slots(self) -> None:
        """As many as the settings say."""

    def prepare(self) -> None:
        """Import once what jobs need."""
        get_ready(self._entry)

    def close(self) -> None:
        """Nothing: the process that jobs are forked from is this process's, and ends with it."""


class JobProcess:
    """A job's process.   limits: what it may take; of memory that is seen to here."""

    def __init__(self, child: Child, limits: JobLimits | None) -> None:
        self._child = child
        self._limits = limits

    @property
    def pid(self) -> int | None:
        """The process's number."""
        return self._child.process.pid

    def parcels(self) -> Iterator[Parcel]:
        """What the worker tells, until it ends; the process is gone afterwards, and all that it has started."""
        said, process, is_over = self._child.said, self._child.process, False
        try:
            yield Begun()
            while said.poll(_LOOK_S) or process.is_alive() or said.poll():
                if said.poll():
                    parcel = PARCEL.validate_json(said.recv_bytes())
                    yield parcel
                    is_over = not isinstance(parcel, Happened)
                if not is_over and self._takes_too_much():
                    kill_group(process)
                    yield Failed(error=out_of_memory(self._limits))
                    return
        except (EOFError, OSError):
            return
        finally:
            self._child.end()

    def ask_to_stop(self) -> None:
        """Set the event the job polls."""
        self._child.asked_to_stop.set()

    def terminate(self) -> None:
        """End the process: asked by signal, killed after the grace. Harmless when it has ended."""
        if self._child.process.is_alive():
            self._child.process.terminate()
            killing = threading.Timer(TERMINATE_GRACE_S, self._kill)
            killing.daemon = True
            killing.start()

    def _takes_too_much(self) -> bool:
        pid = self._child.process.pid
        return self._limits is not None and pid is not None and takes_too_much(pid, self._limits.memory_bytes)

    def _kill(self) -> None:
        if self._child.process.is_alive():
            kill_group(self._child.process)
