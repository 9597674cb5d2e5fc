"""What is compiled while a job runs is said, once, and not taken for what it does."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from numba import njit

from app.compiling import COMPILING, compiling_told
from calib_core.events import LogEvent, StageEvent

SOLVING = StageEvent(stage="solve", fraction=0.3, text="round 2")


def texts(heard: list[StageEvent | LogEvent]) -> list[str]:
    return [event.text for event in heard]


def test_a_loop_that_is_compiled_is_said_and_what_goes_on_said_again() -> None:
    """Mutations: told for each loop that another needs; told of one that is compiled already; the stage's words not restored."""

    @njit
    def inner(x):
        return x * 2.0

    @njit
    def outer(x):
        return inner(x) + 1.0

    heard: list[StageEvent | LogEvent] = []
    with compiling_told(heard.append) as told:
        outer(1.0)  # nothing was said yet that could be repeated
        told(SOLVING)
        outer(2.0)  # compiled for numbers already
        assert texts(heard) == ["round 2"]
        outer(np.ones(3))
        assert texts(heard) == ["round 2", COMPILING, "round 2"]
        told(LogEvent(level="info", code="x", text="a remark"))
        assert heard[-1].text == "a remark"
        assert {event.fraction for event in heard if isinstance(event, StageEvent)} == {SOLVING.fraction}
    outer(np.ones((3, 3)))
    assert len(heard) == 4


def test_what_is_not_of_a_stage_is_passed_on() -> None:
    """Mutation: only stages passed on."""
    heard: list[StageEvent | LogEvent] = []
    with compiling_told(heard.append) as told:
        told(LogEvent(level="info", code="x", text="a remark"))
    assert texts(heard) == ["a remark"]


BESIDE_A_THREAD = """
import sys, threading
from importlib.abc import MetaPathFinder

from app.compiling import compiling_told

halfway, go_on = threading.Event(), threading.Event()


class Slow(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "llvmlite" and threading.current_thread() is not threading.main_thread():
            halfway.set()
            go_on.wait(1.0)
        return None


sys.meta_path.insert(0, Slow())
thread = threading.Thread(target=lambda: __import__("numba"), daemon=True)
thread.start()
halfway.wait()
with compiling_told(lambda event: None):
    print("whole" if not sys.modules["numba"].__spec__._initializing else "half made")
"""


def test_a_compiler_that_a_thread_brings_in_is_waited_for() -> None:
    """Seen: `unsweep calibrate` stood still for ever, seldom. What comes in while a recording is read and what
    tells of compiling met in the middle of numba; the thread failed within LLVM's lock, and kept it. Mutation: the part alone."""
    done = subprocess.run(
        [sys.executable, "-c", BESIDE_A_THREAD], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "whole\n"
