"""Stands in for a calibration in tests of fleets: told by the recording's name how to behave.

- sleepy: sleeps until killed, once; when it is run again it succeeds. What it writes beside its recording tells its process
- doomed: its process is killed every time; slow: sleeps for ten minutes; greedy: asks for 8 GB; defect: raises
- refused, weak: such a result; broken: refuses the input; anything else is calibrated

The documents lie beside the recordings, made by the test: SciPy would take each process a second to load.
"""

from __future__ import annotations

import os
import signal
import time

from calib_core.errors import UnreadableRecording


def run(order):
    """The document of one recording."""
    kind = order.recording.stem.split("-")[0]
    if kind == "broken":
        raise UnreadableRecording("Expected a bag, found porridge in broken.bag; choose another file.")
    if kind == "doomed":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "greedy":
        bytearray(8 * 10**9)
    if kind == "defect":
        raise RuntimeError("no\nsuch luck")
    started = order.recording.with_suffix(".started")
    if kind == "slow" or (kind == "sleepy" and not started.exists()):
        started.with_suffix(".new").write_text(str(os.getpid()))
        started.with_suffix(".new").replace(started)
        time.sleep(600)
    status = kind if kind in {"refused", "weak"} else "calibrated"
    return (order.recording.parent / f"{status}.document").read_text()
