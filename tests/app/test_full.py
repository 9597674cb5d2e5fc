"""A machine that is full: jobs that ask for too much, disks without room, and what still works then."""

from __future__ import annotations

import errno
import gc
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from sqlalchemy import event

from app.arrays import folder as array_folder
from app.limits import JobLimits, fair_memory_bytes, full_disk
from app.storage.files import RESERVE_BYTES, RESERVE_NAME
from tests.app.support.live import serving

ROOT = Path(__file__).resolve().parents[2]
#: More than the free space within the pages that the store has.
LONG_JOB = {"kind": "solve", "settings": {"excluded_spans_s": [[100.0 + k, 100.5 + k] for k in range(4000)]}}


@pytest.mark.parametrize(
    ("name", "code", "words"),
    [
        ("greedy.bag", "job.memory", "1.1 GB a job may have"),
        ("hungry.bag", "job.memory", "1.1 GB a job may have"),
        ("threads.bag", "job.memory", "1.1 GB a job may have"),
        ("filling.bag", "job.disk_full", "delete recordings"),
    ],
)
def test_a_job_that_asks_for_too_much_is_one_sentence(tmp_path, name, code, words):
    """The kernel refuses, or whoever started the process ends it. Mutations: no setrlimit, with which 64 GB are granted; nobody
    looks at what it takes; a thread without a stack told as a defect; so an OSError.
    """
    with serving(tmp_path, job_memory_bytes=2**30, job_file_bytes=2**20) as live:
        job = live.finish(live.start(live.upload(name)))
        assert (job["state"], job["error"]["code"]) == ("failed", code)
        assert words in job["error"]["text"]
        assert live.http.get("/readyz").status_code == 200


def test_only_a_full_disk_is_called_one():
    """Mutation: taking every OSError for it."""
    assert full_disk(OSError(errno.ENOSPC, "")) is not None
    assert full_disk(OSError("579072 requested and 342008 written")) is not None  # NumPy, of the first cloud
    assert full_disk(OSError(errno.EACCES, "")) is None


def test_a_job_s_share_of_memory_follows_from_the_machine_s():
    """Oracle: the machine's own count. Mutation: the whole for each of several."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert 2**30 <= fair_memory_bytes(2) <= max(2**30, whole // 2)
    assert fair_memory_bytes(10_000) == 2**30
    with pytest.raises(ValueError, match="greater than 0"):
        JobLimits(memory_bytes=0, file_bytes=1)


def test_a_full_disk_still_lets_recordings_be_deleted_and_is_not_ready(tmp_path, monkeypatch):
    """Oracle: the reserve on the disk. Mutations: no reserve, so that SQLite finds no page to delete with; os.access as
    readiness, which says nothing about room.
    """

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with serving(tmp_path) as live:
        recording_id = live.ready()
        assert (tmp_path / RESERVE_NAME).stat().st_blocks * 512 >= RESERVE_BYTES
        with monkeypatch.context() as disk:
            disk.setattr("app.storage.files.shutil.disk_usage", lambda _: SimpleNamespace(free=100))
            disk.setattr("app.storage.files.os", SimpleNamespace(**(vars(os) | {"fsync": full})))
            assert live.http.get("/readyz").status_code == 503
            assert live.http.delete(f"/api/recordings/{recording_id}").status_code == 204
            assert not (tmp_path / RESERVE_NAME).exists()
        assert live.http.get("/readyz").status_code == 200
        assert live.http.get("/api/recordings").json() == []
        assert (tmp_path / RESERVE_NAME).exists()


def test_a_job_ends_though_its_log_cannot_be_written(tmp_path):
    """Mutation: the write's error out of the log leaves the job running for ever."""
    with serving(tmp_path) as live:
        recording_id = live.upload("slow.bag")
        job_id = live.start(recording_id)
        live.wait(lambda: live.job(job_id)["stage"] == "solve")
        log = tmp_path / "jobs" / job_id / "events.jsonl"
        log.unlink()
        log.mkdir()
        live.http.post(f"/api/jobs/{job_id}/cancel")
        assert live.finish(job_id)["state"] == "cancelled"


def test_a_store_without_a_page_left_says_so(tmp_path):
    """SQLite's own refusal, by a bound on its pages. Mutation: without the engine's translation it is a 500."""
    with serving(tmp_path) as live:
        recording_id = live.upload("slow.bag")
        job_id = live.start(recording_id)
        live.wait(lambda: live.job(job_id)["stage"] == "solve")
        engine = live.services._engine

        def bound(pages):
            engine.dispose()
            event.listen(engine, "connect", lambda connection, _: connection.execute(f"PRAGMA max_page_count={pages}"))

        bound(1)
        refused = live.http.post(f"/api/recordings/{recording_id}/jobs", json=LONG_JOB)
        assert (refused.status_code, refused.json()["error"]["code"]) == (507, "store.disk_full")
        bound(2**30)
        live.http.post(f"/api/jobs/{job_id}/cancel")
        assert live.finish(job_id)["state"] == "cancelled"


#: Run in a mount namespace of its own, where a small disk can be had and filled to its last byte.
FILLED = """
import os, subprocess, sys
from pathlib import Path
from tests.app.support.live import serving

def fill(folder):
    with (folder / "filling").open("ab", buffering=0) as file:
        block = bytes(1 << 16)
        while block:
            try:
                file.write(block)
            except OSError:
                block = block[: len(block) // 2]

def main():
    disk = Path(sys.argv[1])
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=48M", "tmpfs", str(disk)], check=True)
    data = disk / "data"
    with serving(data) as live:
        recording = live.ready()
    assert (data / "reserve").stat().st_size == 8 << 20
    fill(disk)
    assert os.statvfs(disk).f_bfree == 0
    with serving(data) as live:
        print("started", [found["id"] == recording for found in live.http.get("/api/recordings").json()])
        fill(disk)
        print("ready", live.http.get("/readyz").status_code)
        refused = live.http.put("/api/recordings/upload", params={"name": "b.bag"}, content=b"x" * 10**6)
        print("upload", refused.status_code, refused.json()["error"]["text"].endswith("."))
        print("deleted", live.http.delete(f"/api/recordings/{recording}").status_code)
        (disk / "filling").unlink()
        print("ready", live.http.get("/readyz").status_code, live.http.get("/api/recordings").json())

if __name__ == "__main__":
    main()
"""


def can_mount(folder):
    """Whether a namespace with a disk of its own can be had here."""
    if shutil.which("unshare") is None or shutil.which("mount") is None:
        return False
    made = [*NAMESPACE, "mount", "-t", "tmpfs", "tmpfs", str(folder)]
    return subprocess.run(made, capture_output=True, check=False).returncode == 0


NAMESPACE = ("unshare", "--map-root-user", "--mount")


def test_a_server_starts_and_makes_room_on_a_disk_that_is_full_to_the_last_byte(tmp_path):
    """Oracle: a real disk of 48 MB, filled before the start and again after it.

    Mutations: no reserve given away at the start (no start); rows deleted before files (507).
    """
    disk = tmp_path / "disk"
    disk.mkdir()
    if not can_mount(disk):
        pytest.skip("no mount namespaces here")
    program = tmp_path / "filled.py"
    program.write_text(FILLED, encoding="utf-8")
    told = subprocess.run(
        [*NAMESPACE, sys.executable, str(program), str(disk)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.stdout.splitlines() == [
        "started [True]",
        "ready 507",
        "upload 507 True",
        "deleted 204",
        "ready 200 []",
    ], told.stderr[-2000:]


@pytest.fixture
def no_collector():
    """Nothing is let go but by whoever held it last."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.skipif(not Path("/proc/self/maps").is_file(), reason="the kernel's list of maps is Linux's")
def test_a_deleted_recording_gives_its_room_back_at_once(shared_live, no_collector):
    """What is mapped stays on the disk after its name is gone. Oracle: the kernel's list of the process's maps.

    Mutations: scenes' arrays kept until eight other recordings were looked at; a closed scene that holds what it showed;
    hashes of every folder ever read.
    """
    recording_id = shared_live.ready()
    shared_live.finish(shared_live.start(recording_id))
    shared_live.http.post(f"/api/recordings/{recording_id}/view", json={"mode": "inspect"})
    with shared_live.scene(recording_id) as scene:
        assert len(scene.recv(timeout=30)) > 16
    maps = Path("/proc/self/maps")
    assert recording_id in maps.read_text()
    assert any(recording_id in str(path) for path in array_folder._VERIFIED)
    shared_live.http.delete(f"/api/recordings/{recording_id}")
    assert recording_id not in maps.read_text()
    assert not any(recording_id in str(path) for path in array_folder._VERIFIED)
