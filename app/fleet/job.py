"""One recording in a process of its own: what every executor runs, on this machine or on another.

A process for each, because a process can be bounded and killed: a thread of a cluster's worker can be neither.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from app.children import Child, begin, kill_group
from app.fleet.child import run_child
from app.fleet.orders import FleetOrder, FleetOutcome

CALIBRATE = "app.fleet.ready:calibrate_one"

#: How long nobody looks whether the recording's time is up, or whether it is still wanted.
_LOOK_S = 0.1


def run_order(order_text: str, entry: str, should_stop: Callable[[], bool]) -> str:
    """The outcome of an order, JSON both.   entry: module:function of what is done with it.

    Its process is killed, with all that it has started, when its time is up, on should_stop, and when this is left.
    """
    order = FleetOrder.model_validate_json(order_text)
    start_s = time.monotonic()
    child = begin(run_child, entry, order_text)
    try:
        said = _listen(child, order.time_limit_s, should_stop)
    finally:
        child.end()
    if said is None:
        outcome = _out_of_time(order)
    elif said:
        outcome = FleetOutcome.model_validate_json(said)
    else:
        outcome = _died(order, child.process.exitcode or 0)
    return outcome.model_copy(update={"duration_s": time.monotonic() - start_s}).model_dump_json()


def _listen(child: Child, time_limit_s: float | None, should_stop: Callable[[], bool]) -> bytes | None:
    """What the process says until it ends or is stopped; None where its time is up."""
    start_s = time.monotonic()
    while not child.said.poll(_LOOK_S):
        is_late = time.monotonic() - start_s > (time_limit_s or math.inf)
        if is_late or should_stop():
            kill_group(child.process)
            return None if is_late else b""
    try:
        return child.said.recv_bytes()
    except (EOFError, OSError):
        return b""


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
