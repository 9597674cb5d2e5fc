"""A real server in a process of its own, that can be killed at any moment, and a socket to it that can stop half-way."""

from __future__ import annotations

import http.client
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Long enough for the busiest machine; nothing is judged by it.
PATIENCE_S = 180.0
TUS = {"Tus-Resumable": "1.0.0"}
BODY = {**TUS, "Content-Type": "application/offset+octet-stream"}

PROGRAM = """
import json, socket, sys
from pathlib import Path
from app.jobs.launch import ProcessLauncher
from app.application import make_server
from app.settings import AppSettings
bound = socket.socket(fileno=int(sys.argv[1]))
settings = AppSettings(
    data_dir=Path(sys.argv[2]), cancel_grace_s=0.3, **{"min_free_bytes": 0, **json.loads(sys.argv[4])}
)
make_server(settings, launcher=ProcessLauncher(sys.argv[3])).run(sockets=[bound])
"""


@dataclass(frozen=True, slots=True)
class Answer:
    """What came back."""

    status: int
    headers: Mapping[str, str]
    body: bytes


class Victim:
    """A server process."""

    def __init__(self, process: subprocess.Popen[bytes], port: int) -> None:
        self.process = process
        self.port = port

    def ask(self, method: str, path: str, *, headers: Mapping[str, str] | None = None, body: bytes = b"") -> Answer:
        """One request on a connection of its own."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        try:
            connection.request(method, path, body=body, headers=dict(headers or {}))
            answer = connection.getresponse()
            return Answer(answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read())
        finally:
            connection.close()

    def kill(self) -> None:
        """End it as a power cut would, but for what the kernel still writes."""
        self.process.kill()
        self.process.wait()

    def offset(self, where: str) -> int:
        """What the server says it has of an upload."""
        return int(self.ask("HEAD", where, headers=TUS).headers["upload-offset"])

    def patch(self, where: str, offset: int, chunk: bytes) -> Answer:
        """One whole PATCH."""
        return self.ask("PATCH", where, headers={**BODY, "Upload-Offset": str(offset)}, body=chunk)

    def patch_begun(self, where: str, offset: int, size: int) -> socket.socket:
        """A socket on which a PATCH of `size` bytes has begun; what follows is up to the caller."""
        sock = socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S)
        lines = [f"PATCH {where} HTTP/1.1", f"Host: 127.0.0.1:{self.port}", f"Content-Length: {size}"]
        lines += [f"{name}: {value}" for name, value in {**BODY, "Upload-Offset": str(offset)}.items()]
        sock.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        return sock

    def is_up(self) -> bool:
        """Whether it answers."""
        with suppress(OSError):
            return self.ask("GET", "/healthz").status == 200
        return False


def until(holds: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
    """Wait until it holds."""
    end = time.monotonic() + patience_s
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError("the server did not get there")
        time.sleep(0.01)


@contextmanager
def running(
    data_dir: Path, *, entry: str = "app.work.ready:run_job", port: int = 0, **settings: object
) -> Iterator[Victim]:
    """A server process over a data directory, up when this begins and gone when it ends.   port: 0 is any free one."""
    with socket.socket() as bound:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(("127.0.0.1", port))
        bound.listen(128)
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, str(bound.fileno()), str(data_dir), entry, json.dumps(settings)],
            pass_fds=[bound.fileno()],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        victim = Victim(process, bound.getsockname()[1])
    try:
        until(lambda: process.poll() is not None or victim.is_up())
        if process.poll() is not None:
            raise RuntimeError("the server did not start")
        yield victim
    finally:
        victim.kill()


def status_of(sock: socket.socket) -> int:
    """The status of the answer that comes on a socket; 0 where it is closed without one."""
    head = b""
    while b"\r\n\r\n" not in head:
        try:
            block = sock.recv(65536)
        except ConnectionError:
            block = b""
        if not block:
            return 0
        head += block
    return int(head.split(b" ", 2)[1])
