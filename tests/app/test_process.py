"""Pages that a computing process keeps, counted by the system, and what it does before it ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

_COUNTED = """
import resource, sys
import numpy as np
if sys.argv[1] == "kept":
    from app.process import keep_freed_memory
    keep_freed_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
def round_():
    some = [np.ones(2**21) for _ in range(4)]
round_()
before = faults()
for _ in range(5):
    round_()
print(faults() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux's counters of the GNU library's memory")
def test_arrays_of_a_next_step_have_the_pages_of_the_last() -> None:
    """Five times four arrays of 16 MB: 80 000 pages of 4 kB, or 160 of 2 MB, where they are fetched anew; hardly any where kept.

    Mutation: arrays with pages of their own.
    """
    told = [
        int(subprocess.run([sys.executable, "-c", _COUNTED, how], capture_output=True, text=True, check=True).stdout)
        for how in ("given back", "kept")
    ]
    assert told[1] < 0.1 * told[0]


_LEAVING = """
import atexit, sys, tempfile
from pathlib import Path
from app.process import leave
folder = tempfile.TemporaryDirectory(prefix="unsweep-leaving-")
print(folder.name)
atexit.register(lambda: print("cleared"))
leave(3)
print("not reached")
"""


_BUSY = """
import atexit, os, signal, threading, time
from concurrent.futures import ThreadPoolExecutor
from app.process import leave
def work():
    time.sleep(0.5)
    print("worked", flush=True)
ThreadPoolExecutor(1).submit(work)
atexit.register(lambda: print("cleared", flush=True))
threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGTERM)).start()
leave(130)
"""


def test_who_leaves_waits_for_threads_before_what_they_read_is_closed() -> None:
    """An interrupted solve had ended by a segmentation fault. And asked once more to end meanwhile, it says nothing of it.

    Mutations: what was registered first; no wait at all; a second signal heard.
    """
    done = subprocess.run([sys.executable, "-c", _BUSY], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split(), done.stderr) == (130, ["worked", "cleared"], "")


def test_who_leaves_has_told_all_and_cleared_away() -> None:
    """Mutations: without what was registered for the end; without the last lines; another exit code."""
    done = subprocess.run([sys.executable, "-c", _LEAVING], capture_output=True, text=True, check=False)
    folder, cleared = done.stdout.splitlines()
    assert (done.returncode, cleared, done.stderr) == (3, "cleared", "")
    assert not Path(folder).exists()


_OVERFLOWING = """
import sys, warnings
import app.cli.main as main
def overflows(_):
    import numpy as np
    np.float64(1e300) * np.float64(1e300)
    warnings.warn("something else", UserWarning)
main.COMMANDS = {"export": overflows}
sys.argv = ["unsweep", "export", "--format", "kalibr-imu", "result.json"]
main.main()
"""


def test_a_number_that_overflows_is_no_line_on_the_terminal() -> None:
    """What comes of it is judged; other warnings are still heard. Mutation: told by the library."""
    ended = subprocess.run([sys.executable, "-c", _OVERFLOWING], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "overflow" not in ended.stderr
    assert "something else" in ended.stderr
