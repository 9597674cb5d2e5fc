"""The child process of one job: reads its order, runs the job's function, tells what happens through a pipe.

NumPy comes with what is imported here. It heeds the thread caps of children.py, which are in the environment before the child
is born.
"""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event as ProcessEvent
from pkgutil import resolve_name
from typing import cast

from app.children import stay_with
from app.jobs.coalesce import Coalescer
from app.jobs.naming import by_name
from app.jobs.orders import Failed, Finished, Happened, Order, Stopped
from app.limits import apply_limits, full_disk, is_for_want_of_memory, out_of_memory
from app.process import keep_freed_memory, leave, say_nothing_of_numbers
from app.schemas.common import ErrorDetails, ErrorFacts
from app.schemas.jobs import Outcome
from calib_core.errors import Cancelled, TopicError, UnsweepError
from calib_core.events import OnEvent, ShouldCancel

JobFunction = Callable[[Order, OnEvent, ShouldCancel], Outcome]

#: Answers go before jobs: where processors are short, a solve that takes a little longer is worth less than a page that is
#: there at once.
PATIENCE = 5


def run_worker(entry: str, order_json: str, pipe: Connection, cancel: ProcessEvent, alive: Connection) -> None:
    """Run one order and tell its end. `entry`: module:function of a JobFunction.   alive: as children.py has it."""
    stay_with(alive)
    if sys.platform != "win32":
        os.nice(PATIENCE)
    keep_freed_memory()
    say_nothing_of_numbers()
    order = Order.model_validate_json(order_json)
    if order.limits is not None:
        apply_limits(order.limits)
    try:
        parcel = _perform(entry, order, pipe, cancel)
        pipe.send_bytes(parcel.model_dump_json().encode())
    except (BrokenPipeError, ConnectionResetError):
        return  # the server is gone; it will find this job interrupted
    finally:
        pipe.close()
    leave(0)


def _perform(entry: str, order: Order, pipe: Connection, cancel: ProcessEvent) -> Finished | Failed | Stopped:
    on_event = Coalescer(
        lambda event: pipe.send_bytes(Happened(event=event).model_dump_json().encode()), clock=time.monotonic
    )
    try:
        _log_to_file(order)
        outcome = cast(JobFunction, resolve_name(entry))(order, on_event, cancel.is_set)
        on_event.flush()
        return Finished(outcome=outcome)
    except Cancelled:
        return Stopped()
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as error:  # noqa: BLE001 - the boundary: a defect becomes a sentence, its traceback goes to the job's log
        if isinstance(error, MemoryError) or (order.limits is not None and is_for_want_of_memory(error)):
            return Failed(error=out_of_memory(order.limits))
        if isinstance(error, UnsweepError):
            on_event.flush()
            return Failed(error=_told(order, error))
        if (facts := full_disk(error)) is not None:
            return Failed(error=facts)
        traceback.print_exc()
        text = (
            "The program itself failed in this job; the details are in "
            f"jobs/{order.job_id}/worker.log of the server's data directory. Please report it."
        )
        return Failed(error=ErrorFacts(code="defect", text=text))


def _told(order: Order, error: UnsweepError) -> ErrorFacts:
    candidates = list(error.candidates) if isinstance(error, TopicError) else []
    details = ErrorDetails(candidates=candidates) if candidates else None
    return ErrorFacts(code=error.code, text=by_name(order, str(error)), details=details)


def _log_to_file(order: Order) -> None:
    """What the job prints goes into its own log file."""
    order.folder.mkdir(parents=True, exist_ok=True)
    log = os.open(order.folder / "worker.log", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
