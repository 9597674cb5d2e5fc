"""One recording in a process of its own: what every executor runs, on this machine or on another.

A process for each, because a process can be bounded and killed: a thread of a cluster's worker can be neither.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from app.children import Child, begin, kill_group
from app.fleet.child import run_child
from app.fleet.orders import FleetOrder, FleetOutcome, out_of_memory
from app.limits import takes_too_much

CALIBRATE = "app.fleet.ready:calibrate_one"

#: How long nobody looks whether the recording's time is up, what its process takes, or whether it is still wanted.
_LOOK_S = 0.1


def run_order(order_text: str, entry: str, should_stop: Callable[[], bool]) -> str:
    """The outcome of an order, JSON both.   entry: module:function of what is done with it.

    Its process is killed, with all that it has started, when its time is up, when it takes more memory than it may, on
    should_stop, and when this is left.
    """
    order = FleetOrder.model_validate_json(order_text)
    start_s = time.monotonic()
    child = begin(run_child, entry, order_text)
    try:
        outcome = _listen(child, order, should_stop)
    finally:
        child.end()
    if outcome is None:
        outcome = _died(order, child.process.exitcode or 0)
    return outcome.model_copy(update={"duration_s": time.monotonic() - start_s}).model_dump_json()


def _listen(child: Child, order: FleetOrder, should_stop: Callable[[], bool]) -> FleetOutcome | None:
    """What the process says, or why it was ended; None where it died without a word, or was no longer wanted."""
    start_s = time.monotonic()
    while not child.said.poll(_LOOK_S):
        beyond = _beyond(order, child, time.monotonic() - start_s)
        if beyond is not None or should_stop():
            kill_group(child.process)
            return beyond
    try:
        return FleetOutcome.model_validate_json(child.said.recv_bytes())
    except (EOFError, OSError):
        return None


def _beyond(order: FleetOrder, child: Child, taken_s: float) -> FleetOutcome | None:
    """Which bound the process is beyond, as an outcome; None where it is within all."""
    if taken_s > (order.time_limit_s or math.inf):
        return _out_of_time(order)
    if order.memory_bytes is not None and takes_too_much(child.process.pid or 0, order.memory_bytes):
        return out_of_memory(order)
    return None


def _out_of_time(order: FleetOrder) -> FleetOutcome:
    text = (
        f"{order.recording} took longer than the {order.time_limit_s:g} s allowed: allow more with --time-limit-s, "
        "or calibrate a part with --end-s."
    )
    return FleetOutcome(code="job.time", text=text)


def _died(order: FleetOrder, code: int) -> FleetOutcome:
    how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
    text = f"The process that calibrated {order.recording} {how}: the machine may be short of memory; run it again."
    return FleetOutcome(code="job.lost", text=text, is_lost=True)
