"""How a process that computes keeps its memory and ends: what it lets go is there for the next array, and nothing is taken apart.

A solve makes and drops arrays of tens of megabytes with every linearisation. Given back each time, their pages have to be
fetched anew and wiped by the system, a tenth of the whole solve's time; kept, the process takes no more than at its height.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

#: Numbers of the GNU library's mallopt: how much free memory at the end is kept, how much more is asked for at once, how many
#: arrays may have pages of their own, how many heaps there are.
_TRIM_THRESHOLD, _TOP_PAD, _MMAP_MAX, _ARENA_MAX = -1, -2, -4, -8
#: All of it: whoever computes ends when he is done.
_KEPT_BYTES = 2**31 - 1
_AT_ONCE_BYTES = 2**26


def keep_freed_memory() -> None:
    """For processes that compute and end, from here on. Where the system's library knows no such wish nothing happens."""
    with suppress(OSError, AttributeError):
        wish = ctypes.CDLL(None).mallopt
        wish(_ARENA_MAX, 1)  # what one thread drops, another may take
        wish(_TRIM_THRESHOLD, _KEPT_BYTES)
        wish(_TOP_PAD, _AT_ONCE_BYTES)
        wish(_MMAP_MAX, 0)  # those would be given back, and wiped when they are asked for again


def say_nothing_of_numbers() -> None:
    """For processes that compute, from here on: a number that overflows on the way is judged by what comes of it, in a sentence
    of ours; the libraries' own lines about it tell a person nothing, and come out where there is to be none."""
    warnings.filterwarnings("ignore", category=RuntimeWarning)


@contextmanager
def interrupts_unheard() -> Iterator[None]:
    """What this thread starts meanwhile hears no Ctrl-C, which a terminal sends to all of a group, until `hear_no_interrupts`.

    Before its first line runs it would have nobody to ask what to do then, and tell of every import that was cut off.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def hear_no_interrupts() -> None:
    """For a process that another one ends: it decides what Ctrl-C means. Of those that it starts each decides for itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def forget_stdout() -> None:
    """Where whoever read stdout has left: what is still to be flushed goes nowhere, instead of failing into the closed pipe."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def leave(exit_code: int) -> NoReturn:
    """End, all told and cleared away. Taking apart what compiled loops are kept in would take a third of a second, for nobody.

    In the interpreter's own order: first threads come to their end, then what they read is closed; the other way round an
    interrupted solve's thread reads of a file that is mapped no more. Who asks to end once more meanwhile is not answered twice.
    """
    for asked in (signal.SIGINT, signal.SIGTERM):
        signal.signal(asked, signal.SIG_IGN)
    threading._shutdown()  # type: ignore[attr-defined]  # noqa: SLF001  the interpreter has no other door to these two
    atexit._run_exitfuncs()  # noqa: SLF001
    for stream in (sys.stdout, sys.stderr):
        with suppress(BrokenPipeError):
            stream.flush()
    os._exit(exit_code)
