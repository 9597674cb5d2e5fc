"""A real server in a process of its own, that can be killed at any moment, and a socket to it that can stop half-way."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import httpx2

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 40.0
TUS = {"Tus-Resumable": "1.0.0"}

PROGRAM = """
import json, socket, sys
from app.jobs.launch import ProcessLauncher
from app.server.main import make_server
from app.settings import AppSettings
bound = socket.socket(fileno=int(sys.argv[1]))
settings = AppSettings(min_free_bytes=0, spare_worker=False, cancel_grace_s=0.3, **json.loads(sys.argv[3]))
make_server(settings.model_copy(update={"data_dir": __import__("pathlib").Path(sys.argv[2])}),
            launcher=ProcessLauncher("tests.app.support.fake_jobs:run")).run(sockets=[bound])
"""


class Victim:
    """A server process."""

    def __init__(self, process, port):
        self.process = process
        self.port = port
        self.origin = f"http://127.0.0.1:{port}"
        self.http = httpx2.Client(base_url=self.origin, timeout=30, trust_env=False)

    def kill(self):
        """End it as a power cut would, but for what the kernel still writes."""
        self.process.kill()
        self.process.wait()

    def offset(self, where):
        """What the server says it has of an upload."""
        answer = self.http.head(where, headers=TUS)
        assert answer.status_code == 200, answer
        return int(answer.headers["upload-offset"])

    def wait(self, condition):
        """Until the condition holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, "the server did not get there"
            time.sleep(0.01)


@contextmanager
def running(data_dir, settings="{}"):
    """A server process over a data directory, up when this begins and gone when it ends."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        bound.listen(128)
        port = bound.getsockname()[1]
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(bound.fileno()), str(data_dir), settings],
            pass_fds=[bound.fileno()],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
    victim = Victim(process, port)
    try:
        victim.wait(lambda: process.poll() is not None or victim.http.get("/healthz").status_code == 200)
        assert process.poll() is None, "the server did not start"
        yield victim
    finally:
        victim.http.close()
        victim.kill()


def patch_begun(port, where, offset, size):
    """A socket on which a PATCH of `size` bytes has begun; what follows is up to the caller."""
    sock = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
    sock.sendall(
        f"PATCH {where} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: {offset}\r\n"
        f"Content-Type: application/offset+octet-stream\r\nContent-Length: {size}\r\n\r\n".encode()
    )
    return sock


def status_of(sock):
    """The status of the answer that comes on a socket; 0 where it is closed without one."""
    head = b""
    while b"\r\n\r\n" not in head:
        block = sock.recv(65536)
        if not block:
            return 0
        head += block
    return int(head.split(b" ", 2)[1])
