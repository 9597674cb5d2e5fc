"""Uploads that are killed, stopped, cut, doubled, or longer than they said: the bytes stored are the bytes sent."""

from __future__ import annotations

import base64
import random
import signal
import socket
import threading
import time
from contextlib import contextmanager

import pytest

from bench.victim import BODY, TUS, running, status_of
from tests.app.support.live import FAKE_JOBS

MIB = 2**20


@contextmanager
def serving(data_dir):
    """A server process whose jobs do next to nothing."""
    with running(data_dir, entry=FAKE_JOBS) as victim:
        yield victim


def announce(victim, size):
    """A new upload; its path and its recording's id."""
    told = {**TUS, "Upload-Length": str(size), "Upload-Metadata": f"filename {base64.b64encode(b'room.bag').decode()}"}
    made = victim.ask("POST", "/api/uploads", headers=told)
    assert made.status == 201, made.body
    return made.headers["location"], made.headers["x-recording-id"]


def stored(data_dir, recording_id):
    """The bytes that were kept."""
    return (data_dir / "recordings" / recording_id / "source.bag").read_bytes()


@pytest.mark.parametrize(("seed", "end"), [(0, signal.SIGKILL), (1, signal.SIGKILL), (2, signal.SIGTERM)])
def test_a_kill_or_a_stop_within_a_patch_leaves_the_bytes_that_were_sent(tmp_path, seed, end):
    """Oracle: the file that was sent. Mutation: an offset saved at the PATCH's end while bytes are appended as they come."""
    chance = random.Random(seed)
    content = chance.randbytes(24 * MIB)
    with serving(tmp_path) as victim:
        where, recording_id = announce(victim, len(content))
        first = chance.randrange(len(content) // 4)
        assert victim.patch(where, 0, content[:first]).status == 204
        acknowledged = victim.offset(where)
        with victim.patch_begun(where, first, len(content) - first) as sock:
            sock.sendall(content[first : chance.randrange(first, len(content))])
            time.sleep(chance.uniform(0.0, 0.05))
            victim.process.send_signal(end)
            victim.process.wait()
    with serving(tmp_path) as victim:
        assert victim.offset(where) >= acknowledged == first
        offset = victim.offset(where)
        assert victim.patch(where, offset, content[offset:]).status == 204
        assert stored(tmp_path, recording_id) == content


def test_a_second_patch_is_refused_at_once_and_the_server_answers_others_meanwhile(tmp_path):
    """Mutation: waiting for the first one's lock on the event loop leaves the health check unanswered."""
    with serving(tmp_path) as victim:
        where, _ = announce(victim, MIB)
        with victim.patch_begun(where, 0, MIB) as first:
            first.sendall(b"x" * 1000)
            time.sleep(0.2)
            with victim.patch_begun(where, 0, MIB) as second:
                second.sendall(b"y" * 1000)
                health = []
                asking = threading.Thread(target=lambda: health.append(victim.ask("GET", "/healthz").status))
                asking.start()
                assert status_of(second) == 423
                asking.join(5)
                assert health == [200]
            first.sendall(b"x" * (MIB - 1000))
            assert status_of(first) == 204


def test_a_body_longer_than_declared_is_refused_and_nothing_of_it_kept(tmp_path):
    """Mutation: appending what comes stores 81 MB of 51."""
    with serving(tmp_path) as victim:
        where, _ = announce(victim, 1000)
        assert victim.patch(where, 0, b"a" * 400).status == 204
        assert victim.patch(where, 400, b"b" * 601).status == 413
        headers = "".join(f"{name}: {value}\r\n" for name, value in {**BODY, "Upload-Offset": "400"}.items())
        with socket.create_connection(("127.0.0.1", victim.port)) as sock:  # of a length that is not told before
            begin = f"PATCH {where} HTTP/1.1\r\nHost: 127.0.0.1:{victim.port}\r\nTransfer-Encoding: chunked\r\n{headers}\r\n"
            sock.sendall(begin.encode() + b"12c\r\n" + b"c" * 300 + b"\r\n12d\r\n" + b"c" * 301 + b"\r\n0\r\n\r\n")
            assert status_of(sock) == 413
        assert victim.offset(where) == 400
        assert [path.stat().st_size for path in (tmp_path / "uploads").iterdir() if path.suffix == ""] == [400]
