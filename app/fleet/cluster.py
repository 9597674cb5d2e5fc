"""The executor of a dask.distributed cluster: the same job on other machines' workers.

Each worker needs unsweep installed and the recordings at the same paths; one thread a worker is one recording at a time.
dask is an extra: it is imported when a scheduler is named, never before.
"""

from __future__ import annotations

from concurrent.futures import Executor as FutureExecutor
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING

from app.fleet.job import CALIBRATE, run_order
from calib_core.errors import InputError

if TYPE_CHECKING:
    from distributed import Client, Worker

#: A scheduler on the same network answers at once; one that is not there should not be waited for.
_CONNECT_S = 10.0


class DaskCluster:
    """The workers of the scheduler at an address, e.g. tcp://host:8786."""

    def __init__(self, address: str, entry: str = CALIBRATE) -> None:
        self._client = connect(address)
        self._entry = entry
        self._futures: FutureExecutor = self._client.get_executor(pure=False)
        self.where = f"{len(self._client.scheduler_info()['workers'])} workers of {address}"

    def start(self, order_text: str) -> Future[str]:
        """Hand it to the scheduler, which gives it to another worker where the first is lost."""
        if self._client.status != "running":
            raise InputError(
                "The scheduler no longer answers: start it, and the same command goes on where it stopped."
            )
        return self._futures.submit(run_on_worker, order_text, self._entry)

    def stop(self) -> None:
        """Take back what is under way: the workers see it and kill their processes."""
        with suppress(Exception):  # whatever a scheduler that has gone answers
            self._futures.shutdown(wait=False)
        self._client.close()


def run_on_worker(order_text: str, entry: str) -> str:
    """The outcome of an order, run by a worker; stopped once nobody waits for it any more."""
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()
    return run_order(order_text, entry, lambda: is_dropped(worker, str(key)))


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
