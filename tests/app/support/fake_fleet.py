"""Stands in for a calibration in tests of fleets: told by the recording's name how to behave.

- sleepy: sleeps until killed, once; when it is run again it succeeds. What it writes beside its recording tells its process
- doomed: its process is killed every time; murder: and the worker that started it, each time noted beside the recording
- slow: sleeps for ten minutes; greedy: asks for 8 GB; defect: raises
- hungry: fills 1 GB, bit by bit; roomy: allocates 1 GB and touches none of it; stubborn: allocates on, and asks again for ever
  where it is refused; threads: starts one whose stack has 8 GB; caused: raises what comes of a MemoryError
- refused, weak: such a result; broken: refuses the input; anything else is calibrated

The documents lie beside the recordings, made by the test: SciPy would take each process a second to load.
"""

from __future__ import annotations

import mmap
import os
import signal
import threading
import time

import psutil

from calib_core.errors import UnreadableRecording


def run(order):
    """The document of one recording."""
    kind = order.recording.stem.split("-")[0]
    if kind == "broken":
        raise UnreadableRecording("Expected a bag, found porridge in broken.bag; choose another file.")
    if kind == "doomed":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "murder":
        with order.recording.with_suffix(".begun").open("a") as notes:
            notes.write("x")
        psutil.Process().parent().parent().kill()  # what it was forked from has the worker for its own
        time.sleep(600)
    if kind == "greedy":
        bytearray(8 * 10**9)
    take(kind)
    if kind == "defect":
        raise RuntimeError("no\nsuch luck")
    started = order.recording.with_suffix(".started")
    if kind == "slow" or (kind == "sleepy" and not started.exists()):
        started.with_suffix(".new").write_text(str(os.getpid()))
        started.with_suffix(".new").replace(started)
        time.sleep(600)
    status = kind if kind in {"refused", "weak"} else "calibrated"
    return (order.recording.parent / f"{status}.document").read_text()


def take(kind):
    """Memory, in the way that the kind has."""
    kept = []
    if kind == "hungry":
        for _ in range(100):
            kept.append(b"x" * 10**7)
            time.sleep(0.01)
    if kind == "roomy":
        kept.append(allocated(10**9))
    while kind == "stubborn":
        try:
            kept.append(allocated(2**25))
        except OSError:
            time.sleep(0.001)
    if kind == "threads":
        threading.stack_size(8 * 10**9)
        threading.Thread(target=time.sleep, args=(0,)).start()
    if kind == "caused":
        try:
            bytearray(8 * 10**12)
        except MemoryError as error:
            raise ValueError("it did not work") from error


def allocated(size):
    """Memory that is there to be written to, and is not."""
    return mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
