"""The worker's side of a job on a cluster (launcher.py): a process for the order beside it, and what this tells passed on.

The scheduler takes a task back where its server asks or dies: the worker sees it, asks the process to stop, and ends it.
"""

from __future__ import annotations

import threading
import uuid
from collections.abc import Iterator
from typing import TYPE_CHECKING

from app.fleet.cluster import is_dropped, other_version
from app.fleet.orders import OTHER_VERSION
from app.jobs.launch import ProcessLauncher, RunningJob
from app.jobs.orders import Begun, Failed, Order, Parcel
from app.limits import LEAST_MEMORY_BYTES, fair_memory_bytes
from app.schemas.common import ErrorFacts

if TYPE_CHECKING:
    from distributed import Worker

#: How long nobody looks whether the task was taken back.
_LOOK_S = 0.5


def run_job_on_worker(
    order_text: str, *, entry: str, queue_name: str, version: str, grace_s: float, memory_bytes: int | None
) -> None:
    """Run a job's order in a process beside this worker and pass on what it tells. The arguments are those of ClusterLauncher.

    version: of the server, which an order is written for.
    """
    from distributed import Queue, get_worker

    worker = get_worker()
    queue, turn = Queue(queue_name), uuid.uuid4().hex
    try:
        queue.put((turn, Begun().model_dump_json()))
        for parcel in _seen_through(worker, order_text, entry, version, grace_s, memory_bytes):
            queue.put((turn, parcel.model_dump_json()))
        queue.put((turn, None))
    finally:
        queue.close()


def _seen_through(
    worker: Worker, order_text: str, entry: str, version: str, grace_s: float, memory_bytes: int | None
) -> Iterator[Parcel]:
    """What the order's process tells on its way, but for that it has begun."""
    key = str(worker.get_current_task())
    other = other_version(worker, version, "server")
    if other is not None:
        yield Failed(error=ErrorFacts(code=OTHER_VERSION, text=other))
        return
    order = Order.model_validate_json(order_text)
    if not _sees(order):
        yield Failed(error=_unseen(worker))
        return
    running = ProcessLauncher(entry).launch(_with_memory_of(worker, order, memory_bytes))
    ended = threading.Event()
    threading.Thread(target=_heed, args=(running, worker, key, grace_s, ended), daemon=True).start()
    try:
        yield from (parcel for parcel in running.parcels() if not isinstance(parcel, Begun))
    finally:
        ended.set()


def _heed(running: RunningJob, worker: Worker, key: str, grace_s: float, ended: threading.Event) -> None:
    """Stop the process when its task is taken back: asked first, ended after the grace."""
    while not ended.wait(_LOOK_S):
        if is_dropped(worker, key):
            running.ask_to_stop()
            if not ended.wait(grace_s):
                running.terminate()
            return


def _with_memory_of(worker: Worker, order: Order, memory_bytes: int | None) -> Order:
    """The order with the memory that a job may have here: the server may be a smaller machine, or a larger one."""
    if order.limits is None:
        return order
    if memory_bytes is None:
        threads = worker.state.nthreads
        bound = worker.memory_manager.memory_limit
        share = fair_memory_bytes(threads)
        memory_bytes = share if bound is None else max(LEAST_MEMORY_BYTES, min(share, bound // threads))
    return order.model_copy(update={"limits": order.limits.model_copy(update={"memory_bytes": memory_bytes})})


def _sees(order: Order) -> bool:
    """Whether the data directory of the server is here, and may be used."""
    try:
        order.folder.mkdir(parents=False, exist_ok=True)
    except OSError:
        return False
    return True


def _unseen(worker: Worker) -> ErrorFacts:
    text = (
        f"The worker {worker.name} does not see the server's data directory, or may not write there: "
        "mount it on the workers under the same path, run both as the same user, then run the job again."
    )
    return ErrorFacts(code="job.unseen", text=text)
