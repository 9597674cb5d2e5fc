"""What people are told when the server's own disk or store fails: a sentence, no traceback, no path of the machine."""

from __future__ import annotations

import errno
import logging
import socket
import subprocess
import sys

import httpx2
import pytest

from app.storage.store import RecordingStore
from calib_core.events import LogEvent
from tests.app.support.live import serving


def serve_once(data_dir):
    """`unsweep serve` on a data directory that cannot be used: its exit code and what it said."""
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data-dir", str(data_dir)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, done.stderr.splitlines()


def test_a_corrupt_store_is_one_sentence_at_the_start(tmp_path):
    """Oracle: the program's own last words. Mutation: the web server's startup printing where it failed."""
    (tmp_path / "unsweep.sqlite").write_bytes(b"\x93 no database" * 900)
    code, said = serve_once(tmp_path)
    assert code == 2
    assert not [line for line in said if "Traceback" in line or 'File "' in line]
    assert "cannot be opened" in said[-1]
    assert said[-1].endswith(".")


def test_a_server_that_cannot_start_prints_no_address(tmp_path):
    """A data directory in use: "unsweep is at ..." stood above the refusal. Mutation: told before the server has started."""
    with serving(tmp_path):
        code, said = serve_once(tmp_path)
    assert code == 2
    assert not [line for line in said if "unsweep is at" in line or "Compiling" in line]
    assert said[-1].startswith("unsweep: ")


def test_a_store_that_breaks_under_way_is_unavailable_and_not_a_defect(tmp_path):
    """Oracle: the status. Mutation: SQLAlchemy's errors as any other exception: 500, "the program itself failed"."""
    with serving(tmp_path) as live:
        live.services._engine.dispose()
        for name in ("unsweep.sqlite-wal", "unsweep.sqlite-shm"):
            (tmp_path / name).unlink(missing_ok=True)
        (tmp_path / "unsweep.sqlite").write_bytes(b"\x00" * 20000 + b"no database")
        answer = live.http.get("/api/recordings")
        assert (answer.status_code, answer.json()["error"]["code"]) == (503, "store.unusable")
        assert str(tmp_path) not in answer.text
        assert live.http.get("/readyz").status_code == 503
        assert live.http.get("/healthz").status_code == 200


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_said_to_be_one(live, monkeypatch, number):
    """Mutation: every OSError a defect."""

    def full(*_):
        raise OSError(number, "No space left on device", str(live.settings.data_dir / "jobs" / "x"))

    monkeypatch.setattr(RecordingStore, "all_newest_first", full)
    answer = live.http.get("/api/recordings")
    assert (answer.status_code, answer.json()["error"]["code"]) == (507, "disk.full")
    assert str(live.settings.data_dir) not in answer.text


def test_no_sentence_tells_where_the_server_keeps_things(tmp_path, caplog):
    """Oracle: the folders' paths, looked for in every answer. Mutation: the sentences as they are."""
    caplog.set_level(logging.CRITICAL)
    folder = tmp_path / "shared"
    folder.mkdir()
    (folder / "gone.bag").write_bytes(b"x")
    with serving(tmp_path / "data", recordings_dir=folder) as live:
        opened = live.http.post("/api/recordings", json={"folder_path": "gone.bag"}).json()["id"]
        live.wait(lambda: set(live.job_states(opened).values()) <= {"done", "failed"})
        (folder / "gone.bag").unlink()
        defect = live.start(live.upload("defect.bag"))
        answers = [
            live.http.post(f"/api/recordings/{opened}/jobs", json={"kind": "solve"}),
            live.http.get(f"/api/recordings/{opened}/planes"),
            live.http.get(f"/api/recordings/{opened}/timeline"),
            live.http.get("/api/folder", params={"path": "nothing/here"}),
        ]
        live.finish(defect)
        answers.append(live.http.get(f"/api/jobs/{defect}"))
        assert "gone.bag" in answers[0].json()["error"]["text"]
        assert "worker.log" in answers[-1].json()["error"]["text"]
        for answer in answers:
            assert str(tmp_path) not in answer.text


def test_a_page_closed_in_the_middle_of_a_stream_is_no_defect(shared_live, caplog):
    """Oracle: the server's log once the request has ended. More is on the way than any socket's buffers hold.

    Fails without ForgiveLeaving: a traceback in the log, found by eight fuzzers at once. Mutation of its own: forgiving a
    stream that fails by itself, see below.
    """
    recording_id = shared_live.upload("slow.bag")
    shared_live.wait(lambda: set(shared_live.job_states(recording_id).values()) == {"done"})
    job_id = shared_live.start(recording_id)
    long = LogEvent(level="info", code="test.long", text="x" * 200_000)
    for _ in range(100):
        shared_live.services.jobs.logs.write(job_id, long)
    with socket.create_connection(("127.0.0.1", shared_live.port)) as page:
        host = shared_live.origin.removeprefix("http://")
        page.sendall(f"GET /api/jobs/{job_id}/events HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        came = page.recv(4096)
        assert b"200 OK" in came
        while b"xxx" not in came:
            came += page.recv(65536)
    shared_live.wait(lambda: not shared_live.server.server_state.tasks)
    shared_live.http.post(f"/api/jobs/{job_id}/cancel")
    shared_live.finish(job_id)
    assert not [record for record in caplog.records if record.levelname == "ERROR" or record.exc_info]


def test_a_stream_that_fails_by_itself_is_a_defect(shared_live, caplog, monkeypatch):
    """Oracle: an error put in. Mutation: every group of exceptions forgiven."""
    recording_id = shared_live.ready()

    async def broken(*_):
        yield next(iter(()))

    monkeypatch.setattr(shared_live.services.feed, "watch", broken)
    with pytest.raises(httpx2.HTTPError):
        shared_live.http.get(f"/api/recordings/{recording_id}/events").read()
    shared_live.wait(lambda: any("defect" in record.message for record in caplog.records))


def test_an_address_of_nothing_is_not_found_and_a_wrong_body_is_invalid(live):
    """Oracle: the status. Mutation: 422, "String should match pattern '^[0-9a-f]{32}$'", for an id that nothing can have."""
    nothing = live.http.get("/api/recordings/not-an-id")
    wrong = live.http.post("/api/recordings", json={"folder_path": 7, "colour": "red"})
    for answer, status in ((nothing, 404), (wrong, 422)):
        assert answer.status_code == status
        text = answer.json()["error"]["text"]
        assert "should match" not in text
        assert "Extra inputs" not in text
    assert "no such thing is known, found 'not-an-id'" in nothing.json()["error"]["text"]
