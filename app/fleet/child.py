"""`python -m app.fleet.child MODULE:FUNCTION`: the process of one recording. An order on stdin, its outcome on stdout.

It leads a group of its own and ends when whoever started it has gone, so that a killed worker leaves nothing behind.
"""

from __future__ import annotations

import importlib
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import cast

from app.fleet.orders import FleetOrder, FleetOutcome
from app.process import keep_freed_memory, leave
from calib_core.errors import UnsweepError

FleetFunction = Callable[[FleetOrder], str]

#: Looked at so often: a process whose parent was killed must not go on computing.
_PARENT_POLL_S = 0.5


def calibrate_one(order: FleetOrder) -> str:
    """The result document of one recording, as text."""
    from calib_core import api

    planes = None if order.planes is None else api.read_planes(order.planes)
    guess = None if order.initial_guess is None else api.read_initial_guess(order.initial_guess)
    api.get_ready()
    recording = api.load(order.recording, order.reading)
    return api.calibrate(recording, order.solving, planes=planes, initial_guess=guess).result.to_json()


def main(arguments: list[str]) -> None:
    """Read the order, run the function, write the outcome."""
    parent, entry = int(arguments[0]), arguments[1]
    threading.Thread(target=_leave_with_parent, args=(parent,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    keep_freed_memory()
    # What libraries print must not get between the outcome and its reader.
    answer = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    outcome = perform(FleetOrder.model_validate_json(sys.stdin.read()), entry)
    answer.write(outcome.model_dump_json())
    answer.close()


def perform(order: FleetOrder, entry: str) -> FleetOutcome:
    """The outcome of `entry`, module:function, on the order. No exception leaves."""
    module, _, name = entry.partition(":")
    try:
        if order.memory_bytes is not None:
            _bound_memory(order.memory_bytes)
        function = cast(FleetFunction, getattr(importlib.import_module(module), name))
        return FleetOutcome(document=function(order))
    except UnsweepError as error:
        return FleetOutcome(code=error.code, text=str(error))
    except MemoryError:
        return FleetOutcome(code="job.memory", text=_too_much(order))
    except Exception as error:  # noqa: BLE001  the boundary: one recording's defect must not stop the others
        said = " ".join(str(error).split())
        text = (
            f"A defect in unsweep stopped it at {order.recording} ({type(error).__name__}: {said}); please report it."
        )
        return FleetOutcome(code="defect", text=text)


def _bound_memory(memory_bytes: int) -> None:
    """What the process allocates, not what it maps of files; and no core file, which would hold the recording."""
    for kind, most in ((resource.RLIMIT_DATA, memory_bytes), (resource.RLIMIT_CORE, 0)):
        _, hard = resource.getrlimit(kind)
        bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (bound, bound))


def _too_much(order: FleetOrder) -> str:
    most = (
        "memory than there is" if order.memory_bytes is None else f"than the {order.memory_bytes / 1e6:.0f} MB allowed"
    )
    return f"{order.recording} needed more {most}: allow more with --memory-limit-mb, or calibrate a part with --end-s."


def _leave_with_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_PARENT_POLL_S)
    with suppress(OSError):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


if __name__ == "__main__":
    main(sys.argv[1:])
    leave(0)
