"""Nothing leaves the machine: a server at work in a network of its own, whose way out is counted; see bench/away.py."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from bench.away import apart, isolated

ROOT = Path(__file__).resolve().parents[2]


def test_a_server_at_work_sends_nothing_anywhere():
    """Oracle: the kernel's count of packets, seen to count one. With a real solve it is `python -m bench.away`.

    Mutations: a library that asks for its newest version; viser's tunnel opened at the start of a scene.
    """
    if not isolated():
        pytest.skip("a network namespace takes root and iproute2")
    told = subprocess.run(
        apart("tests.app.support.fake_jobs:run"),
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "UNSWEEP_SKIP_COMPILE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stderr[-2000:]
    *_, answers, sent, on_purpose = told.stdout.splitlines()
    assert answers == "answers [200] to 15 requests"
    assert (sent, on_purpose) == ("sent by the server 0, tried without a way 0", "sent on purpose 1")
