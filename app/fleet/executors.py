"""Where recordings are calibrated. A new machine to run on is one more `Executor`, here or beside `cluster.py`."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

from app.fleet.job import CALIBRATE, run_order
from app.kernels import compile_once, is_compiled
from calib_core.threads import usable_cores

#: Tells a person: a code, and what is to be said.
Tell = Callable[[str, str], None]


class Executor(Protocol):
    """Takes orders and gives a future of each outcome, JSON both; a future that raises is an order lost on the way."""

    where: str

    def prepare(self, tell: Tell) -> None:
        """Have done what the first recording would wait for, and tell what a person waits for."""

    def start(self, order_text: str) -> Future[str]:
        """Have it run as soon as there is room."""

    def stop(self) -> None:
        """End everything, started or waiting, and let go of the machines."""


class LocalProcesses:
    """Processes on this machine, so many at a time: by default one for each core."""

    def __init__(self, workers: int | None = None, entry: str = CALIBRATE) -> None:
        count = workers or usable_cores()
        self.where = f"{count} process{'' if count == 1 else 'es'} on this machine"
        self._entry = entry
        self._stopping = threading.Event()
        # Its threads only wait: each has a process that does the work.
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="fleet")

    def prepare(self, tell: Tell) -> None:
        """Compile loops, which may take a minute and is in no recording's time."""
        if self._entry == CALIBRATE and not is_compiled():
            tell("fleet.compiling", "Compiling the program's loops for this machine (once, about a minute)")
            compile_once()

    def start(self, order_text: str) -> Future[str]:
        """Run it in a process of its own when one of the threads is free."""
        return self._threads.submit(run_order, order_text, self._entry, self._stopping.is_set)

    def stop(self) -> None:
        """Kill what runs and forget what waits."""
        self._stopping.set()
        self._threads.shutdown(wait=True, cancel_futures=True)
