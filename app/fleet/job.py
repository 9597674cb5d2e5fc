"""One recording in a process of its own: what every executor runs, on this machine or on another.

A process for each, because a process can be bounded and killed: a thread of a cluster's worker can be neither.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress

from app.fleet.orders import FleetOrder, FleetOutcome
from app.jobs.launch import THREAD_CAPS

CALIBRATE = "app.fleet.child:calibrate_one"

#: How long nobody looks whether the recording's time is up, or whether it is still wanted.
_LOOK_S = 0.1


def run_order(order_text: str, entry: str, should_stop: Callable[[], bool]) -> str:
    """The outcome of an order, JSON both.   entry: module:function of what is done with it.

    Its process is killed, with all that it has started, when its time is up, on should_stop, and when this is left.
    """
    order = FleetOrder.model_validate_json(order_text)
    start_s = time.monotonic()
    command = [sys.executable, "-m", "app.fleet.child", str(os.getpid()), entry]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | THREAD_CAPS,
        start_new_session=True,
    ) as process:
        try:
            said = _listen(process, order_text, order.time_limit_s, should_stop)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
    if said is None:
        outcome = _out_of_time(order)
    elif said and process.returncode == 0:
        outcome = FleetOutcome.model_validate_json(said)
    else:
        outcome = _died(order, process.returncode)
    return outcome.model_copy(update={"duration_s": time.monotonic() - start_s}).model_dump_json()


def _listen(
    process: subprocess.Popen[str], order_text: str, time_limit_s: float | None, should_stop: Callable[[], bool]
) -> str | None:
    """What the process says until it ends or is stopped; None where its time is up."""
    ahead: str | None = order_text
    start_s = time.monotonic()
    while True:
        try:
            return process.communicate(ahead, timeout=_LOOK_S)[0]
        except subprocess.TimeoutExpired:
            ahead = None  # it has been sent, or goes on being sent
        if should_stop():
            return ""
        if time_limit_s is not None and time.monotonic() - start_s > time_limit_s:
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
