"""What tests of fleets share: orders for the fake calibration, and its runs."""

from __future__ import annotations

import time

from app.fleet.campaign import run_fleet
from app.fleet.executors import LocalProcesses
from app.fleet.orders import FleetOrder

FAKE = "tests.app.support.fake_fleet:run"
PATIENCE_S = 60.0


def orders(folder, *names, **more):
    return [FleetOrder(name=name, recording=folder / f"{name}.bag", **more) for name in names]


def run_here(asked, folder, workers=2):
    return {row.name: row for row in run_fleet(asked, folder, LocalProcesses(workers, FAKE), lambda _: None)}


def wait_for(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)
