"""The process of one recording of many: takes an order, tells its outcome, and ends."""

from __future__ import annotations

import os
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event as ProcessEvent
from pkgutil import resolve_name
from typing import cast

from app.children import stay_with
from app.fleet.orders import FleetOrder, FleetOutcome, out_of_memory
from app.limits import bound_allocations, is_for_want_of_memory
from app.process import keep_freed_memory, leave, say_nothing_of_numbers
from calib_core.errors import UnsweepError, is_for_want_of_room

FleetFunction = Callable[[FleetOrder], str]


def run_child(entry: str, order_json: str, tells: Connection, _stop: ProcessEvent, alive: Connection) -> None:
    """Run the entry's function on the order and tell the outcome. alive: as children.py has it. Nobody asks it to stop: it is
    killed.
    """
    stay_with(alive)
    keep_freed_memory()
    say_nothing_of_numbers()
    nowhere = os.open(os.devnull, os.O_WRONLY)  # what libraries print must not get into the table
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    outcome = perform(FleetOrder.model_validate_json(order_json), entry)
    tells.send_bytes(outcome.model_dump_json().encode())
    tells.close()
    leave(0)


def perform(order: FleetOrder, entry: str) -> FleetOutcome:
    """The outcome of `entry`, module:function, on the order. No exception leaves."""
    try:
        if order.memory_bytes is not None:
            bound_allocations(order.memory_bytes)
        function = cast(FleetFunction, resolve_name(entry))
        return FleetOutcome(document=function(order))
    except Exception as error:  # noqa: BLE001  the boundary: one recording's defect must not stop the others
        if isinstance(error, MemoryError) or (order.memory_bytes is not None and is_for_want_of_memory(error)):
            return out_of_memory(order)
        if isinstance(error, UnsweepError):
            return FleetOutcome(code=error.code, text=str(error))
        if is_for_want_of_room(error):
            text = f"There was no room to write while {order.recording.name} was calibrated; free some space, then run it again."
            return FleetOutcome(code="disk.full", text=text)
        said = " ".join(str(error).split())
        text = (
            f"A defect in unsweep stopped it at {order.recording} ({type(error).__name__}: {said}); please report it."
        )
        return FleetOutcome(code="defect", text=text)
