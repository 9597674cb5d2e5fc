"""What the server's process is set to before it serves: threads that give way, and memory that stays what is used."""

from __future__ import annotations

import ctypes
import sys

#: A thread that computes lets another one have the interpreter after this. A request passes through it a dozen times:
#: beside two threads at Python's own 5 ms it took 70 ms, now 15.
SWITCH_INTERVAL_S = 0.0005

#: The C library's allocator (glibc's mallopt), by its own numbers: at most so many heaps for all threads, of which each
#: keeps what it once had; and blocks of this size, parts of uploads, go back to the system when they are let go.
_ARENA_MAX, _ARENAS = -8, 2
_MMAP_THRESHOLD, _LARGE_BYTES = -3, 512 * 1024


def settle_process() -> None:
    """Set all of it, as far as this system has it."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_ARENA_MAX, _ARENAS)
        mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
