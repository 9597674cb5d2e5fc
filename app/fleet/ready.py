"""The door to a fleet's recordings for a process that is forked (app/children.py): with it comes, once, what they import.

There on one thread: of others, what is forked would have the locks that they held, and nobody to open them.
"""

from __future__ import annotations

from contextlib import suppress

from app.children import FORKED
from app.fleet.orders import FleetOrder
from calib_core import api

# Where something of it is missing or broken, the recording that needs it says so.
with suppress(Exception):
    api.get_ready(aside=not FORKED)


def calibrate_one(order: FleetOrder) -> str:
    """The result document of one recording, as text."""
    planes = None if order.planes is None else api.read_planes(order.planes)
    guess = None if order.initial_guess is None else api.read_initial_guess(order.initial_guess)
    recording = api.load(order.recording, order.reading)
    return api.calibrate(recording, order.solving, planes=planes, initial_guess=guess).result.to_json()
