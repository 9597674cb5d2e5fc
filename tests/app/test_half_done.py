"""A job's end and what follows from it are not left half: on a disk that is full for a moment, over a restart, beside others."""

from __future__ import annotations

import sqlite3
from collections import Counter
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from sqlalchemy import event

import app.jobs.service as service_module
from app.errors import DiskFull
from app.jobs.stored_parts import MOST_INTERRUPTIONS
from app.schemas.recordings import ChangeRecording
from app.server.consequences import Consequences
from app.storage.database import open_database
from app.storage.records import JobRecord, RecordingRecord
from app.storage.store import JobStore, RecordingStore
from tests.app.support.live import serving
from tests.app.support.report import report_json

NOW = datetime(2026, 7, 1, tzinfo=UTC)


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """A full disk is looked at again soon."""
    monkeypatch.setattr(service_module, "FULL_DISK_POLL_S", 0.02)


def kinds_of(live, recording_id):
    """How many jobs of each kind there are."""
    return Counter(job.kind for job in live.services.jobs.records_of(recording_id))


def recording(live, recording_id):
    """The recording as the wire has it."""
    return live.http.get(f"/api/recordings/{recording_id}").json()


@contextmanager
def full_once(live, words):
    """The store's disk is full the first time that a statement on recordings has a value of these."""
    told = []

    def refuse(_connection, _cursor, statement, values, *_):
        if statement.startswith("UPDATE recordings") and not told and words in list(values):
            told.append(statement)
            raise DiskFull("store.disk_full", "The data directory's disk is full.")

    event.listen(live.services._engine, "before_cursor_execute", refuse)
    yield told
    event.remove(live.services._engine, "before_cursor_execute", refuse)


def test_an_inspection_that_ends_on_a_full_disk_leaves_its_recording_ready(live):
    """Both rows are written, or none. Mutation: the job's state and the recording's in transactions of their own, of which
    the second fails: the job is done, cannot end again, and its recording is inspected for ever.
    """
    with full_once(live, "ready") as told:
        recording_id = live.upload("any.bag")
        live.wait(lambda: live.job_states(recording_id).get("inspect") == "done")
        shown = recording(live, recording_id)
    assert len(told) == 1
    assert (shown["state"], shown["report"]["verdict"]) == ("ready", "good")


def test_a_cancelled_inspection_is_seen_at_its_recording_or_is_not_cancelled(live):
    """A wish that met a full disk can be made again. Mutation: as above: the second wish is refused, for it has ended."""
    for name in ("deaf.bag", "deaf-too.bag"):
        busy = live.upload(name)
        live.wait(lambda busy=busy: live.job_states(busy) == {"inspect": "done", "planes": "done"})
        solve = live.start(busy)
        live.wait(lambda solve=solve: live.job(solve)["stage"] == "solve")
    recording_id = live.upload("any.bag")
    waits = next(job for job in live.services.jobs.records_of(recording_id) if job.kind == "inspect")
    with full_once(live, "failed"):
        assert live.http.post(f"/api/jobs/{waits.id}/cancel").status_code == 507
        assert live.job(waits.id)["state"] == "queued"
        assert live.http.post(f"/api/jobs/{waits.id}/cancel").json()["state"] == "cancelled"
    assert recording(live, recording_id)["state"] == "failed"


def test_what_follows_from_an_end_is_tried_again_and_begun_once(live, monkeypatch):
    """After a simulation the planes' job is queued, then the disk is full. Oracle: the jobs that there are.

    Mutations: the end of the job tried again with what follows from it, which no state allows; everything begun anew, and
    the planes twice.
    """
    submit, told = live.services.workflow._jobs.submit, []

    def refuse_once(recording_id, kind, request, **more):
        if kind == "inspect" and not told:
            told.append(kind)
            raise DiskFull("store.disk_full", "The data directory's disk is full.")
        return submit(recording_id, kind, request, **more)

    monkeypatch.setattr(live.services.workflow._jobs, "submit", refuse_once)
    recording_id = live.http.post("/api/recordings", json={"sample": "paper-normal"}).json()["id"]
    live.wait(lambda: told and set(live.job_states(recording_id).values()) == {"done"})
    live.wait(lambda: recording(live, recording_id)["state"] == "ready")
    assert kinds_of(live, recording_id) == {"simulate": 1, "planes": 1, "inspect": 1}


def test_a_start_takes_up_what_has_no_job(tmp_path):
    """Recordings as a server left them that died between two rows, or an earlier version. Oracle: they are ready.

    Mutations: nobody looks at the start; samples left out; recordings taken up whose jobs wait in the queue.
    """
    with serving(tmp_path) as live:
        done, waiting = live.ready(), live.ready()
        store = live.services.recordings._store
        assert store.change(done, {"state": "inspecting", "report_json": None})
        assert store.change(waiting, {"state": "inspecting", "report_json": None})
        sample = replace(store.find(done), id="5" * 32, name="s.bag", origin="sample", source="source.bag")
        store.add(replace(sample, scenario="paper-normal", state="receiving"))
        jobs = live.services.jobs._store
        queued = replace(jobs.of_recording(waiting)[0], id="6" * 32, kind="inspect", state="queued", ended_at=None)
        jobs.add(queued)
    with serving(tmp_path) as live:
        for recording_id in (done, waiting, sample.id):
            live.wait(lambda recording_id=recording_id: recording(live, recording_id)["state"] == "ready")
            assert recording(live, recording_id)["report"]["verdict"] == "good"
        assert kinds_of(live, done) == {"planes": 2, "inspect": 2}
        assert kinds_of(live, waiting) == {"planes": 1, "inspect": 2}


def newest_of(live, recording_id, kind):
    """The newest job of that kind."""
    return next(job for job in live.services.jobs.records_of(recording_id) if job.kind == kind)


def under_way(live, recording_id, kind):
    """Wait until the newest job of that kind runs and has said something."""
    live.wait(lambda: newest_of(live, recording_id, kind).state == "running")
    live.wait((live.services.files.job(newest_of(live, recording_id, kind).id) / "events.jsonl").is_file)


@pytest.mark.parametrize("killed", [False, True])
def test_what_begins_by_itself_begins_again_after_a_restart(tmp_path, killed):
    """An inspection, the planes of another recording, and a solve, which somebody has to want. Oracle: the recordings as without
    the restart.

    Mutations: nothing begun again; the inspection alone, and the planes are never found; solves too; an interruption that
    fails the recording, on which whoever waits for it gives up.
    """
    with serving(tmp_path, concurrent_jobs=4) as live:
        room = live.ready("room.bag")
        hold = live.services.files.recording(room) / "hold"
        hold.touch()
        live.http.patch(f"/api/recordings/{room}", json={"start_s": 1.5})
        live.wait(lambda: live.job_states(room)["inspect"] == "done")
        halfway, slow = live.upload("halfway.bag"), live.ready("slow.bag")
        solve = live.start(slow)
        live.wait(lambda: live.job(solve)["stage"] == "solve")
        under_way(live, halfway, "inspect")
        under_way(live, room, "planes")
        ran = [newest_of(live, halfway, "inspect").id, newest_of(live, room, "planes").id, solve]
    engine = open_database(f"sqlite:///{tmp_path / 'unsweep.sqlite'}")
    left = RecordingStore(engine).find(halfway)
    assert (left.state, left.error_json) == ("inspecting", None)
    for job_id in ran if killed else ():
        store = JobStore(engine)
        store.save(replace(store.find(job_id), state="running", ended_at=None))
    engine.dispose()
    with serving(tmp_path, concurrent_jobs=4) as live:
        assert [live.job(job_id)["state"] for job_id in ran] == ["interrupted"] * 3
        assert recording(live, halfway)["state"] == "inspecting"
        under_way(live, halfway, "inspect")
        again = [newest_of(live, halfway, "inspect"), newest_of(live, room, "planes")]
        assert [job.retry_of for job in again] == ran[:2]
        (live.services.files.job(again[0].id) / "go-on").touch()
        hold.unlink()
        live.wait(lambda: recording(live, halfway)["state"] == "ready")
        live.wait(lambda: recording(live, room)["has_planes"])
        assert kinds_of(live, slow)["solve"] == 1
        assert kinds_of(live, halfway)["inspect"] == 2


def server_died(folder):
    """A server that dies leaves its jobs' rows as they were."""
    with sqlite3.connect(folder / "unsweep.sqlite") as store:
        changed = store.execute(
            "UPDATE jobs SET state = 'running', error_json = NULL, ended_at = NULL "
            "WHERE state = 'interrupted' AND error_json IS NOT NULL RETURNING 1"
        ).fetchall()
    assert changed


def test_a_server_that_is_told_to_stop_blames_no_inspection(tmp_path):
    """Seen: three ordinary restarts within one inspection, and the recording counted as what ends the server. Oracle: the jobs
    that there are. Mutations: every interruption counts; a stop that says nothing.
    """
    with serving(tmp_path) as live:
        recording_id = live.upload("halfway.bag")
        under_way(live, recording_id, "inspect")
    for times in range(2, MOST_INTERRUPTIONS + 3):
        with serving(tmp_path) as live:
            under_way(live, recording_id, "inspect")
            assert kinds_of(live, recording_id)["inspect"] == times
            assert recording(live, recording_id)["error"] is None


def test_an_inspection_that_ends_the_server_is_not_begun_for_ever(tmp_path):
    """Oracle: the jobs that there are. Mutations: no bound; a bound without a reason at the recording; one that holds for what
    somebody asks for afterwards.
    """
    with serving(tmp_path) as live:
        recording_id = live.upload("halfway.bag")
        under_way(live, recording_id, "inspect")
        folder = live.settings.data_dir
    server_died(folder)
    for times in range(2, MOST_INTERRUPTIONS + 1):
        with serving(tmp_path) as live:
            under_way(live, recording_id, "inspect")
            assert kinds_of(live, recording_id)["inspect"] == times
        server_died(folder)
    with serving(tmp_path) as live:
        shown = recording(live, recording_id)
        assert (shown["state"], shown["error"]["code"]) == ("failed", "job.interrupted")
        assert "3 times in a row" in shown["error"]["text"]
        assert kinds_of(live, recording_id)["inspect"] == MOST_INTERRUPTIONS
        live.start(recording_id, "inspect")
        under_way(live, recording_id, "inspect")
    server_died(folder)
    with serving(tmp_path) as live:
        under_way(live, recording_id, "inspect")
        assert kinds_of(live, recording_id)["inspect"] == MOST_INTERRUPTIONS + 2


def test_a_start_on_a_full_disk_leaves_them_for_the_next_one(tmp_path, monkeypatch, caplog):
    """Mutation: the refusal let through, with which no server starts."""
    with serving(tmp_path) as live:
        recording_id = live.ready()
        live.services.recordings._store.change(recording_id, {"state": "inspecting"})

    def full(*_, **__):
        raise DiskFull("store.disk_full", "The data directory's disk is full.")

    with monkeypatch.context() as disk:
        disk.setattr("app.jobs.service.JobService.submit", full)
        with serving(tmp_path) as live:
            assert recording(live, recording_id)["state"] == "inspecting"
    assert "room.bag is still to be read" in caplog.text
    with serving(tmp_path) as live:
        live.wait(lambda: recording(live, recording_id)["state"] == "ready")


def test_a_name_given_while_a_recording_is_inspected_costs_nothing(live):
    """The row is read before the inspection ends and the name saved after it. Mutation: the whole row written."""
    recording_id = live.upload("any.bag")
    before = live.services.recordings.get(recording_id)
    before = replace(before, state="inspecting", report_json=None)  # as it was, however fast the inspection
    live.wait(lambda: live.job_states(recording_id) == {"inspect": "done", "planes": "done"})
    live.services.recordings.change(before, ChangeRecording(name="the hall"))
    after = recording(live, recording_id)
    assert (after["name"], after["state"], after["report"]["verdict"]) == ("the hall", "ready", "good")


def test_two_who_change_how_a_recording_is_read_both_have_it(live):
    """Both look, then both write: the later had to wait for jobs. Mutation: settings written whatever they are by now."""
    recording_id = live.ready()
    before = live.services.recordings.get(recording_id)
    live.services.recordings.change(before, ChangeRecording(imu_topic="/imu2"))
    live.services.recordings.change(before, ChangeRecording(start_s=1.5))
    settings = recording(live, recording_id)["read_settings"]
    assert (settings["imu_topic"], settings["start_s"]) == ("/imu2", 1.5)


def test_an_upload_that_two_requests_finish_arrives_once(live, monkeypatch):
    """Both have seen it arriving. Oracle: its jobs. Mutation: the state written whatever it is by now."""
    recordings = live.services.recordings
    recording_id = live.ready()
    seen = replace(recordings.get(recording_id), state="receiving")
    with monkeypatch.context() as late:
        late.setattr(recordings, "get", lambda _: seen)
        live.services.arrivals.finish_upload(recording_id)
    assert kinds_of(live, recording_id) == {"inspect": 1, "planes": 1}
    assert recording(live, recording_id)["state"] == "ready"


@pytest.fixture
def stores(tmp_path):
    """Recordings and jobs in a store of their own, with one recording that is inspected a second time."""
    engine = open_database(f"sqlite:///{tmp_path / 'a.sqlite'}")
    recordings, jobs = RecordingStore(engine), JobStore(engine)
    recordings.add(RecordingRecord("1" * 32, "a", "upload", "s", "", 1, "inspecting", None, "{}", None, NOW))
    for number in ("2", "3"):
        jobs.add(JobRecord(number * 32, "1" * 32, "inspect", "running", "{}", None, None, None, NOW, NOW, None))
    yield recordings, jobs
    engine.dispose()


class Folder:
    """Where reports are."""

    def __init__(self, root):
        self.root = root

    def job(self, job_id):
        return self.root / job_id


def test_an_inspection_that_ends_after_a_newer_one_was_asked_for_says_nothing(stores, tmp_path):
    """It is of how the recording was read before. Mutation: every inspection tells."""
    _, jobs = stores
    newer, older = jobs.of_recording("1" * 32)
    means = Consequences(jobs, Folder(tmp_path))
    for job in (older, newer):
        (tmp_path / job.id).mkdir()
        (tmp_path / job.id / "report.json").write_text(report_json(job.id))
    assert means.of(replace(older, state="cancelled")) == {}
    assert means.of(replace(older, state="done")) == {}
    assert means.of(replace(newer, state="done"))["state"] == "ready"


def test_an_interruption_leaves_a_recording_where_it_was(stores, tmp_path):
    """Until it counts as the reason. Mutations: samples left out; a recording that is to be made said to be read."""
    _, jobs = stores
    newest = jobs.of_recording("1" * 32)[0]
    means = Consequences(jobs, Folder(tmp_path))
    assert means.of(replace(newest, state="interrupted")) == {"state": "inspecting", "error_json": None}
    made = replace(newest, kind="simulate", state="interrupted")
    assert means.of(made) == {"state": "receiving", "error_json": None}


def test_a_report_that_is_gone_is_a_failure_and_not_the_end_of_a_thread(stores, tmp_path):
    """Mutation: the file's error let through: the job runs for ever."""
    _, jobs = stores
    newest = jobs.of_recording("1" * 32)[0]
    changes = Consequences(jobs, Folder(tmp_path)).of(replace(newest, state="done"))
    assert changes["state"] == "failed"
    assert "cannot be read any more" in changes["error_json"]


def test_columns_are_changed_only_where_what_must_be_there_is(stores):
    """Oracle: the row. Mutation: `where` left out."""
    recordings, jobs = stores
    key = "1" * 32
    assert not recordings.change(key, {"name": "b"}, where={"state": "ready"})
    assert not recordings.change("9" * 32, {"name": "b"})
    assert recordings.change(key, {"name": "b"}, where={"state": "inspecting", "report_json": None})
    newest = jobs.of_recording(key)[0]
    jobs.save(replace(newest, state="done"), recording={"state": "ready"})
    kept = recordings.find(key)
    assert (kept.name, kept.state, kept.size_bytes) == ("b", "ready", 1)
