"""A real cluster on this machine: a scheduler and workers, processes of their own as `dask` starts them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 60.0


@contextmanager
def dask_processes(folder, workers, *, nannies=False):
    """The scheduler's address and its workers' processes.   nannies: who start a worker again, as `dask worker` has them."""
    file = folder / "scheduler.json"
    quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}
    dask = [sys.executable, "-m", "dask"]
    scheduler = ["scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    worker = ["worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard"]
    worker += ["--host", "127.0.0.1", "--local-directory", str(folder), *([] if nannies else ["--no-nanny"])]
    started = [subprocess.Popen([*dask, *scheduler], **quiet)]
    try:
        _wait_for(lambda: file.exists() and file.read_text().strip().endswith("}"))
        started += [subprocess.Popen([*dask, *worker], **quiet) for _ in range(workers)]
        yield json.loads(file.read_text())["address"], started
    finally:
        for process in reversed(started):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _wait_for(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "the cluster did not start"
        time.sleep(0.02)
