"""Uploads that are killed, stopped, cut, doubled, or longer than they said: the bytes stored are the bytes sent."""

from __future__ import annotations

import base64
import random
import threading
import time

import pytest

from tests.app.support.killed import TUS, patch_begun, running, status_of

MIB = 2**20


def announce(victim, size, name="room.bag", **metadata):
    """A new upload; its path and its recording's id."""
    pairs = {"filename": name, **metadata}
    told = ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in pairs.items())
    made = victim.http.post("/api/uploads", headers={**TUS, "Upload-Length": str(size), "Upload-Metadata": told})
    assert made.status_code == 201, made.text
    recording_id = made.headers["x-recording-id"]
    return f"/api/uploads/{recording_id}", recording_id


def send_rest(victim, where, content):
    """The upload taken up where the server says it is."""
    offset = victim.offset(where)
    headers = {**TUS, "Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream"}
    answer = victim.http.patch(where, headers=headers, content=content[offset:])
    assert answer.status_code == 204, answer.text
    return answer


def stored(data_dir, recording_id):
    """The bytes that were kept."""
    return (data_dir / "recordings" / recording_id / "source.bag").read_bytes()


@pytest.mark.parametrize("seed", range(3))
def test_a_kill_within_a_patch_leaves_the_bytes_that_were_sent(tmp_path, seed):
    """Oracle: the file that was sent. Mutation: an offset saved at the PATCH's end while bytes are appended as they come."""
    chance = random.Random(seed)
    content = chance.randbytes(24 * MIB)
    with running(tmp_path) as victim:
        where, recording_id = announce(victim, len(content))
        first = chance.randrange(len(content) // 4)
        assert status_of_patch(victim, where, 0, content[:first]) == 204
        acknowledged = victim.offset(where)
        with patch_begun(victim.port, where, first, len(content) - first) as sock:
            sock.sendall(content[first : chance.randrange(first, len(content))])
            time.sleep(chance.uniform(0.0, 0.05))
            victim.kill()
    with running(tmp_path) as victim:
        assert victim.offset(where) >= acknowledged == first
        send_rest(victim, where, content)
        assert stored(tmp_path, recording_id) == content


def status_of_patch(victim, where, offset, chunk):
    """The status of one whole PATCH."""
    headers = {**TUS, "Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream"}
    return victim.http.patch(where, headers=headers, content=chunk).status_code


def test_a_second_patch_is_refused_at_once_and_the_server_answers_others_meanwhile(tmp_path):
    """Mutation: waiting for the first one's lock on the event loop leaves the health check unanswered."""
    with running(tmp_path) as victim:
        where, _ = announce(victim, MIB)
        with patch_begun(victim.port, where, 0, MIB) as first:
            first.sendall(b"x" * 1000)
            time.sleep(0.2)
            with patch_begun(victim.port, where, 0, MIB) as second:
                second.sendall(b"y" * 1000)
                health = []
                asking = threading.Thread(target=lambda: health.append(victim.http.get("/healthz").status_code))
                asking.start()
                assert status_of(second) == 423
                asking.join(5)
                assert health == [200]
            first.sendall(b"x" * (MIB - 1000))
            assert status_of(first) == 204


def test_a_body_longer_than_declared_is_refused_and_nothing_of_it_kept(tmp_path):
    """Mutation: appending what comes stores 81 MB of 51."""
    with running(tmp_path) as victim:
        where, _ = announce(victim, 1000)
        assert status_of_patch(victim, where, 0, b"a" * 400) == 204
        assert status_of_patch(victim, where, 400, b"b" * 601) == 413
        headers = {**TUS, "Upload-Offset": "400", "Content-Type": "application/offset+octet-stream"}
        chunked = victim.http.patch(where, headers=headers, content=(b"c" * 300 for _ in range(3)))
        assert chunked.status_code == 413
        assert victim.offset(where) == 400
        assert [path.stat().st_size for path in (tmp_path / "uploads").iterdir() if path.suffix == ""] == [400]
