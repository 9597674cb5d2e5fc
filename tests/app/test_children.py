"""How a process begins: what it is forked from, what is there then, and with whom it ends."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.children import FORKED, THREAD_CAPS
from app.jobs.launch import ProcessLauncher
from app.jobs.orders import Finished, Happened, Order
from tests.app.support.live import FAKE_JOBS, PATIENCE_S
from tests.app.support.processes import is_alive

ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def waiting_job(folder, number):
    """A job that is under way, in a process of its own, until the block ends: that process's id."""
    order = Order(
        job_id=number * 32,
        kind="inspect",
        recording_name="halfway.bag",
        source=folder,
        cache=folder,
        folder=folder / number,
    )
    running = ProcessLauncher(FAKE_JOBS).launch(order)
    parcels = running.parcels()
    while not isinstance(next(parcels), Happened):
        pass
    yield running.pid
    (order.folder / "go-on").touch()
    assert isinstance(list(parcels)[-1], Finished)


def status_of(pid, name):
    """A line of what Linux tells of a process."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(line.split(maxsplit=1)[1] for line in lines if line.startswith(f"{name}:"))


@pytest.mark.skipif(not FORKED, reason="jobs are forked on Linux only")
def test_jobs_are_forked_from_one_process_of_one_thread(tmp_path):
    """Oracle: what Linux says of the processes. What is forked beside another thread has the locks that it held, for ever.

    Mutations: a process made anew for each job; imports on a thread of their own (`aside`).
    """
    with waiting_job(tmp_path, "1") as first, waiting_job(tmp_path, "2") as second:
        begun_by = int(status_of(first, "PPid"))
        assert int(status_of(second, "PPid")) == begun_by != os.getpid()
        assert int(status_of(begun_by, "PPid")) == os.getpid()
        assert status_of(begun_by, "Threads") == "1"


@pytest.mark.skipif(not FORKED, reason="jobs are forked on Linux only")
def test_what_the_application_makes_ready_is_there_once_and_starts_no_threads():
    """Where the server's own jobs are forked from: SciPy, Numba and the library are in, and there is one thread.

    Mutations: `aside` (a second thread); the import of the doctor left out, or that of the forecast, which it brings
    late.
    """
    told = in_a_process("""
        import json, sys
        from pathlib import Path
        import app.work.ready
        status = Path("/proc/self/status").read_text().splitlines()
        needed = ["scipy.linalg", "scipy.spatial", "numba", "calib_core.full.joint.solve", "calib_core.doctor.examine",
                  "calib_core.doctor.outlook", "calib_core.full.forecast_by_choice"]
        print(json.dumps({
            "threads": next(line.split()[1] for line in status if line.startswith("Threads:")),
            "missing": [name for name in needed if name not in sys.modules],
        }))
    """)
    assert told == {"threads": "1", "missing": []}


@pytest.mark.skipif(not FORKED, reason="jobs are forked on Linux only")
def test_what_jobs_are_forked_from_hears_no_interrupt_from_its_first_line_on():
    """Seen: Ctrl-C in a server's first two seconds printed the imports that it cut off.

    Mutations: started with interrupts heard; the starter deaf ever after.
    """
    told = in_a_process("""
        import json, os, signal
        from pathlib import Path
        from app.jobs.launch import ProcessLauncher
        def blocked(pid):
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
            return next(int(line.split()[1], 16) for line in lines if line.startswith("SigBlk:")) >> (signal.SIGINT - 1) & 1
        ProcessLauncher().prepare()
        from multiprocessing.forkserver import _forkserver  # in the middle of an exec, command lines are empty
        print(json.dumps([blocked(os.getpid()), blocked(_forkserver._forkserver_pid)]))
    """)
    assert told == [0, 1]


def test_jobs_end_with_a_server_that_was_killed(tmp_path):
    """Seen: what a job is forked from goes on as long as the job does, and neither sees its parent change.

    Mutations: the parent asked for instead of the pipe that ends with the server; nobody listens.
    """
    server = subprocess.Popen(
        [sys.executable, "-c", _SERVER, FAKE_JOBS, str(tmp_path)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    try:
        process = int(server.stdout.readline())
        assert int(server.stdout.readline()) == process  # all is said that is: what is said after the kill finds nobody
        assert is_alive(process)
    finally:
        server.kill()
        server.wait()
        server.stdout.close()
    end = time.monotonic() + PATIENCE_S
    while is_alive(process):
        assert time.monotonic() < end
        time.sleep(0.02)


_SERVER = """
import sys
from pathlib import Path
from app.jobs.launch import ProcessLauncher
from app.jobs.orders import Happened, Order
folder = Path(sys.argv[2])
order = Order(job_id="1" * 32, kind="inspect", recording_name="halfway.bag", source=folder, cache=folder, folder=folder / "1")
running = ProcessLauncher(sys.argv[1]).launch(order)
for parcel in running.parcels():
    if isinstance(parcel, Happened):
        print(running.pid, flush=True)
"""


def test_where_nothing_can_be_forked_a_process_is_made_anew(tmp_path):
    """The name of the folder of temporary files leaves no room for a socket's. Mutation: only what is forked is tried."""
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    code = _SERVER.replace("if isinstance(parcel, Happened):", "if parcel.parcel == 'finished':")
    (tmp_path / "1").mkdir()
    (tmp_path / "1" / "go-on").touch()
    server = [sys.executable, "-c", code, FAKE_JOBS, str(tmp_path)]
    told = subprocess.run(
        server, capture_output=True, text=True, check=True, cwd=ROOT, env=os.environ | {"TMPDIR": str(deep)}
    )
    assert told.stdout.strip().isdigit()


def in_a_process(code):
    """What a Python of its own prints, with the environment of one that jobs are forked from."""
    command = [sys.executable, "-c", textwrap.dedent(code)]
    return json.loads(
        subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | THREAD_CAPS).stdout
    )


@pytest.mark.skipif(not FORKED, reason="jobs are forked on Linux only")
def test_a_process_to_fork_from_that_was_killed_is_no_loss(tmp_path):
    """The next job has another one. Mutation: what has ended is not begun again (a launcher that starts it once only)."""
    with waiting_job(tmp_path, "1") as first:
        begun_by = int(status_of(first, "PPid"))
    assert begun_by != os.getpid()
    os.kill(begun_by, signal.SIGKILL)
    with waiting_job(tmp_path, "2") as second:
        assert int(status_of(second, "PPid")) != begun_by
