"""The executor of a dask.distributed cluster: the same job on other machines' workers.

Each worker needs unsweep installed and the recordings at the same paths; one thread a worker is one recording at a time.
dask is an extra: it is imported when a scheduler is named, never before.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable
from concurrent.futures import Executor as FutureExecutor
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING

from app.fleet.executors import Tell
from app.fleet.job import CALIBRATE, run_order
from app.fleet.orders import OTHER_VERSION, TRIES, FleetOrder, FleetOutcome
from app.kernels import compile_once
from calib_core import __version__
from calib_core.errors import InputError

if TYPE_CHECKING:
    from distributed import Client, Worker

#: A scheduler on the same network answers at once; one that is not there should not be waited for.
_CONNECT_S = 10.0
#: How long a count that nobody has begun is waited for, by the scheduler.
_COUNT_S = 0.02


class DaskCluster:
    """The workers of the scheduler at an address, e.g. tcp://host:8786."""

    def __init__(self, address: str, entry: str = CALIBRATE) -> None:
        self._client = connect(address)
        self._address = address
        self._entry = entry
        self._session = uuid.uuid4().hex
        self._futures: FutureExecutor = self._client.get_executor(pure=False)
        self._count = len(self._client.nthreads())
        self.where = f"{self._count} worker{'' if self._count == 1 else 's'} of {address}"

    def prepare(self, tell: Tell) -> None:
        """Workers prepare themselves; where there are none, say how one is started: nothing else would happen."""
        if not self._count:
            tell(
                "fleet.no_worker",
                f"The scheduler has no worker yet: start `dask worker {self._address} --nworkers 1 --nthreads 1` on a machine "
                "that sees the recordings; its first one begins then",
            )

    def start(self, order_text: str) -> Future[str]:
        """Hand it to the scheduler, which gives it to another worker where the first is lost."""
        if self._client.status != "running":
            raise InputError(
                "The scheduler no longer answers: start it, and the same command goes on where it stopped."
            )
        name = FleetOrder.model_validate_json(order_text).name
        return self._futures.submit(
            calibrate_on_worker, order_text, self._entry, version=__version__, counter=f"unsweep-{self._session}-{name}"
        )

    def stop(self) -> None:
        """Take back what is under way: the workers see it and kill their processes."""
        with suppress(Exception):  # whatever a scheduler that has gone answers
            self._futures.shutdown(wait=False)
        self._client.close()


def calibrate_on_worker(order_text: str, entry: str, *, version: str, counter: str) -> str:
    """The outcome of one recording's order, run by a worker; stopped once nobody waits for it any more.

    version: of the command, which an order is written for.   counter: the name of what counts how often the order was begun.
    """
    from distributed import get_worker

    worker = get_worker()
    other = other_version(worker, version, "command")
    if other is not None:
        return FleetOutcome(code=OTHER_VERSION, text=other).model_dump_json()
    if entry == CALIBRATE:
        compile_once()  # before the recording's time begins
    key = worker.get_current_task()
    return counted(order_text, counter, lambda: run_order(order_text, entry, lambda: is_dropped(worker, str(key))))


def counted(order_text: str, counter: str, run: Callable[[], str]) -> str:
    """The outcome of an order with how often it was begun by any worker; not run where that was often enough.

    dask gives what a lost worker had to the next one, by a count of its own that nobody here sets.
    """
    from distributed import Variable

    begun = Variable(counter)
    try:
        before = int(begun.get(timeout=_COUNT_S))
    except TimeoutError:
        before = 0
    if before >= TRIES:
        outcome = _lost(FleetOrder.model_validate_json(order_text))
    else:
        begun.set(before + 1)
        outcome = FleetOutcome.model_validate_json(run()).model_copy(update={"tries": before + 1})
    if not outcome.is_lost or outcome.tries >= TRIES:
        begun.delete()
    return outcome.model_dump_json()


def _lost(order: FleetOrder) -> FleetOutcome:
    text = (
        f"Each of the {TRIES} workers that had {order.recording} was lost, probably because memory ran out: limit what a "
        "recording may take with --memory-limit-mb, or start larger workers, then give the same command again."
    )
    return FleetOutcome(code="job.lost", text=text, is_lost=True, tries=TRIES)


def other_version(worker: Worker, version: str, asker: str) -> str | None:
    """Why a worker does nothing for a server or a command of that version; None where it has the same."""
    if version == __version__:
        return None
    return (
        f"The worker {worker.name} has unsweep {__version__} and the {asker} {version}: "
        "install the same on both, then run it again."
    )


def is_dropped(worker: Worker, key: str) -> bool:
    """Whether the scheduler has taken the task back; dask itself lets a running function run."""
    task = worker.state.tasks.get(key)
    return task is None or task.state == "cancelled"


def connect(address: str) -> Client:
    """A client of the scheduler at the address. Raises InputError where there is none, or no dask."""
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "--scheduler needs dask.distributed, which is not installed: install it with `pip install unsweep[fleet]`."
        ) from error
    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"No dask scheduler answers at {address}: start one with `dask scheduler`, or correct the address."
        ) from error
