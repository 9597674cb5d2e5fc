"""What takes room on the disk: told by recording, bounded by a quota, removed when nobody uses it any more."""

from __future__ import annotations

import base64
from datetime import UTC, datetime, timedelta

import pytest

from app.errors import DiskFull
from bench.still_server import StillLauncher
from tests.app.support.live import serving

DAY = timedelta(days=1)


@pytest.fixture
def keeping(tmp_path):
    """A server that removes what nobody used for ten days."""
    with serving(tmp_path / "data", launcher=StillLauncher(), keep_days=10) as live:
        yield live


def announced(live, size):
    """The answer to an upload that is about to come."""
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": str(size)}
    headers["Upload-Metadata"] = f"filename {base64.b64encode(b'any.bag').decode()}"
    return live.http.post("/api/uploads", headers=headers)


def swept(live, now, *, hours=7.0):
    """A look at that time, and another so many hours later by the steady clock, which goes on from call to call."""
    keeping = live.services.keeping
    for past_s in (0.0, 3600.0 * hours):
        later_s = keeping._steady_s() + past_s
        keeping._steady_s = lambda later_s=later_s: later_s
        keeping.sweep(now)


def test_what_a_recording_takes_is_told_by_what_it_is(keeping):
    """Oracle: files of known sizes, laid down by hand. Mutations: arrays counted twice; an upload's bytes forgotten."""
    recording_id = keeping.upload("any.bag", b"x" * 5000)
    keeping.wait(lambda: set(keeping.job_states(recording_id).values()) == {"failed"})
    files = keeping.services.files
    record = keeping.services.recordings.get(recording_id)
    before = keeping.http.get("/api/storage").json()
    (files.cache(record) / "recording").mkdir(parents=True, exist_ok=True)
    (files.cache(record) / "recording" / "arrays.npy").write_bytes(bytes(70_000))
    arriving = announced(keeping, 900).headers["x-recording-id"]
    files.partial(arriving).path.write_bytes(bytes(300))
    told = keeping.http.get("/api/storage").json()
    first, second = told["recordings"]
    assert (first["recording_id"], first["source_bytes"], first["arrays_bytes"]) == (recording_id, 5000, 70_000)
    assert first["results_bytes"] == sum(
        file.stat().st_size for job in files.root.glob("jobs/*") for file in job.iterdir()
    )
    assert (second["recording_id"], second["source_bytes"], second["removed_at"]) == (arriving, 300, None)
    assert told["used_bytes"] - before["used_bytes"] >= 70_300
    assert datetime.fromisoformat(first["removed_at"]) == datetime.fromisoformat(first["last_used_at"]) + 10 * DAY
    assert (told["quota_bytes"], told["keep_days"]) == (None, 10)


def test_a_quota_counts_what_is_there_and_what_was_promised(tmp_path):
    """Oracle: the quota. Mutations: only files that have arrived are counted; the quota looked at after the upload."""
    # Eight of these sixteen MB are held back for hard times.
    with serving(tmp_path, launcher=StillLauncher(), quota_bytes=2**24) as live:
        assert announced(live, 2**24).json()["error"]["code"] == "upload.quota"
        first = announced(live, 5 * 2**20)
        assert first.status_code == 201
        refused = announced(live, 5 * 2**20)
        assert (refused.status_code, refused.json()["error"]["code"]) == (507, "upload.quota")
        assert "delete recordings" in refused.json()["error"]["text"]
        live.http.delete(first.headers["location"], headers={"Tus-Resumable": "1.0.0"})
        assert announced(live, 5 * 2**20).status_code == 201


def test_an_upload_whose_size_nobody_told_stays_within_the_quota(tmp_path):
    """It comes in chunks, without a length. Oracle: what is on the disk. Mutations: the quota asked for its announced size
    alone, which is none; asked for each block without what was promised to others.
    """
    put = {"url": "/api/recordings/upload", "params": {"name": "any.bag"}}
    with serving(tmp_path, launcher=StillLauncher(), quota_bytes=2**24) as live:
        fits = live.http.put(**put, content=iter([bytes(2**20)] * 2))
        assert fits.status_code == 201
        assert fits.json()["size_bytes"] == 2 * 2**20
        refused = live.http.put(**put, content=iter([bytes(2**20)] * 7))
        assert (refused.status_code, refused.json()["error"]["code"]) == (507, "upload.quota")
        assert announced(live, 3 * 2**20).status_code == 201
        refused = live.http.put(**put, content=iter([bytes(2**20)] * 4))
        assert (refused.status_code, refused.json()["error"]["code"]) == (507, "upload.quota")
        left = [one["size_bytes"] for one in live.http.get("/api/recordings").json()]
        assert left == [3 * 2**20, 2 * 2**20]


def test_two_uploads_of_unknown_size_are_not_let_grow_into_the_same_room(tmp_path):
    """Both are let go on before either has written. Oracle: the quota. Mutation: only what is on the disk counted."""
    with serving(tmp_path, launcher=StillLauncher(), quota_bytes=2**24) as live:
        arrivals = live.services.arrivals
        first, second = (arrivals.announce_upload(name, 0) for name in ("one.bag", "two.bag"))
        arrivals._admit(first.id, 5 * 2**20)
        with pytest.raises(DiskFull, match="are left; delete recordings"):
            arrivals._admit(second.id, 5 * 2**20)
        assert announced(live, 5 * 2**20).status_code == 507
        arrivals._admit(second.id, 2**20)


def test_only_what_nobody_used_for_so_long_goes_and_what_no_reading_needs(keeping):
    """Times by hand. Mutations: the day it came instead of the last use; jobs that wait not looked at; all arrays gone."""
    old, used, busy = (keeping.upload(name) for name in ("any.bag", "other.bag", "slow.bag"))
    for recording_id in (old, used, busy):
        keeping.wait(lambda one=recording_id: set(keeping.job_states(one).values()) == {"failed"})
    arriving = announced(keeping, 100).headers["x-recording-id"]
    store, now = keeping.services.recordings._store, datetime.now(UTC)
    with keeping.services._engine.begin() as connection:
        for table, column in (("recordings", "created_at"), ("jobs", "created_at"), ("jobs", "ended_at")):
            then = (now - 20 * DAY).isoformat(timespec="microseconds")
            connection.exec_driver_sql(f"UPDATE {table} SET {column} = ? WHERE {column} IS NOT NULL", (then,))
        connection.exec_driver_sql("UPDATE jobs SET state = 'running' WHERE recording_id = ?", (busy,))
    keeping.finish(keeping.start(used))
    record = store.find(used)
    stale = keeping.services.files.recording(used) / "cache" / ("0" * 32)
    for folder in (keeping.services.files.cache(record), stale):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "arrays.npy").write_bytes(b"x")
    swept(keeping, now)
    assert {one["id"] for one in keeping.http.get("/api/recordings").json()} == {used, busy, arriving}
    assert not keeping.services.files.recording(old).exists()
    assert (keeping.services.files.cache(record) / "arrays.npy").exists()
    assert not stale.exists()


def test_without_a_time_nothing_ever_goes(tmp_path):
    """Mutation: a default of so many days."""
    with serving(tmp_path, launcher=StillLauncher()) as live:
        recording_id = live.upload("any.bag")
        live.wait(lambda: set(live.job_states(recording_id).values()) == {"failed"})
        swept(live, datetime.now(UTC) + 3650 * DAY)
        assert [one["id"] for one in live.http.get("/api/recordings").json()] == [recording_id]


def test_a_clock_that_jumps_removes_nothing(keeping):
    """A wrong date that is put right within hours, and comes again. Oracle: the steady clock.

    Mutations: what is due goes at once; what was due once counts on when the date is right again.
    """
    recording_id = keeping.upload("any.bag")
    keeping.wait(lambda: set(keeping.job_states(recording_id).values()) == {"failed"})
    right = datetime.now(UTC)
    for now in (right + 3650 * DAY, right, right + 3650 * DAY, right):
        swept(keeping, now, hours=5.0)
    assert [one["id"] for one in keeping.http.get("/api/recordings").json()] == [recording_id]
    swept(keeping, right + 11 * DAY)
    assert keeping.http.get("/api/recordings").json() == []
