"""What people are told when the server's own disk or store fails: a sentence, no traceback, no path of the machine."""

from __future__ import annotations

import errno
import logging
import subprocess
import sys

import pytest

from app.storage.store import RecordingStore
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
