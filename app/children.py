"""How a process that computes begins, and that it ends: the only place that knows how one is made.

On Linux it is forked from one process that has imported what is needed, and begins in some hundredths of a second with that
memory shared; elsewhere what libraries hold does not survive a fork, and it is made anew. It leads a group of its own, so that
what it starts ends with it, hears no Ctrl-C, has one numerical thread, and ends with whoever asked for it: a pipe between the
two says nothing and closes with him. (Its parent tells nothing: what it is forked from lives as long as any of its children.)
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.synchronize import Event as ProcessEvent
from typing import TYPE_CHECKING

from app.process import hear_no_interrupts, interrupts_unheard

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext  # not all of them are made for every system

#: One core per process: many tiny products on many threads were ten times slower than on one.
THREAD_CAPS = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "TBB_NUM_THREADS": "1",
}

#: A process that does not end by itself after SIGTERM is killed after this, and all that it has started.
TERMINATE_GRACE_S = 2.0
#: So often, and after so long each time, a process is started anew that none forks.
BIRTHS, BIRTH_S = 10, 0.05

FORKED = sys.platform.startswith("linux")
_SPAWNED = multiprocessing.get_context("spawn")
if FORKED:
    _FORKED = multiprocessing.get_context("forkserver")
_ENVIRONMENT = threading.Lock()


@dataclass(frozen=True)
class Child:
    """A process under way. said: what it tells.   asked_to_stop: what it may look at.   alive: by whose end it knows of ours."""

    process: BaseProcess
    said: Connection
    asked_to_stop: ProcessEvent
    alive: Connection

    def end(self) -> None:
        """Have it end, if it has not, and all that it has started; wait until it has."""
        self.said.close()
        self.process.join(TERMINATE_GRACE_S)
        kill_group(self.process)
        self.process.join()
        self.alive.close()


def begin(
    target: Callable[[str, str, Connection, ProcessEvent, Connection], None], entry: str, order_json: str
) -> Child:
    """A process that calls target(entry, order, what tells, what asks to stop, what `stay_with` takes).

    target: a function of a module that imports nothing heavy, lest numerical libraries are there before their bounds.
    entry: module:function of what it does. The module is imported once, by the process that others are forked from, where the
    system has such. There is one such process, and it has what the first entry named.
    """
    # dask starts its workers as daemons, which may have no children lest they be left behind. Ours leave with their parent.
    multiprocessing.current_process().daemon = False
    with _birth(entry) as processes:
        said, tells = processes.Pipe(duplex=False)
        alive, alive_here = processes.Pipe(duplex=False)
        stop = processes.Event()
        process = processes.Process(
            target=target, args=(entry, order_json, tells, stop, alive), name="unsweep-worker", daemon=True
        )
        _start(process)
    tells.close()  # so that the pipe ends when the child does
    alive.close()
    return Child(process, said, stop, alive_here)


def get_ready(entry: str) -> None:
    """Start the process that those of an entry are forked from: what it imports takes longer than reading a cloud."""
    with _birth(entry):
        pass


def stay_with(alive: Connection) -> None:
    """Said by the process itself, first of all: a group of its own, no interrupts, and an end with whoever asked for it."""
    if sys.platform != "win32":
        os.setpgid(0, 0)
    hear_no_interrupts()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_leave_with, args=(alive,), daemon=True).start()


def kill_group(process: BaseProcess) -> None:
    """Kill a process, which leads a group of its own, and all that it has started. Nothing of it is left to be asked."""
    if process.is_alive():
        process.kill()
    if sys.platform != "win32" and process.pid is not None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)


def _leave_with(alive: Connection) -> None:
    with suppress(EOFError, OSError):
        alive.recv_bytes()
    if sys.platform != "win32":
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _start(process: BaseProcess) -> None:
    """Start it; anew where the process that it is to be forked from has just ended, which is seen a moment later."""
    for _ in range(BIRTHS - 1):
        try:
            process.start()
        except (EOFError, ConnectionError):
            time.sleep(BIRTH_S)
        else:
            return
    process.start()


@contextmanager
def _birth(entry: str) -> Iterator[ForkServerContext | SpawnContext]:
    """One at a time, deaf to Ctrl-C, in the environment of one: how processes are made. What they are forked from, which imports
    the entry's module, is there then.
    """
    with _ENVIRONMENT:
        if FORKED:
            _FORKED.set_forkserver_preload(["__main__", entry.partition(":")[0]])
            resource_tracker.ensure_running()  # begun on the way to a child, it would have that child hear interrupts
        with interrupts_unheard(), _capped_threads():
            yield _FORKED if _can_fork() else _SPAWNED


def _can_fork() -> bool:
    """Whether there is a process to fork from; it is started where there is none. Its socket is among the temporary files, whose
    folder may be read-only, or have a name too long for one.
    """
    if not FORKED:
        return False
    from multiprocessing.forkserver import ensure_running  # not made for every system

    try:
        ensure_running()
    except OSError:
        return False
    return True


@contextmanager
def _capped_threads() -> Iterator[None]:
    """The environment a child is born with; numerical libraries read it once, when they are loaded."""
    before = {name: os.environ.get(name) for name in THREAD_CAPS}
    os.environ.update(THREAD_CAPS)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
