"""What no job may do: outlive its end, run for ever, keep others waiting, or depend on the wall clock."""

from __future__ import annotations

import os
import sys
import threading
from datetime import UTC, datetime

import psutil
import pytest

import app.jobs.service as service_module
from app.jobs.worker import PATIENCE
from tests.app.support.live import serving


def gone(pid):
    """Whether no process of that id does anything any more."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def started(live, name):
    """A solve under way, and its worker's process id."""
    job_id = live.start(live.upload(name))
    live.wait(lambda: live.job(job_id)["stage"] == "solve")
    return job_id, live.services.jobs._processes.find(job_id).pid


def test_a_worker_that_ignores_sigterm_is_killed(live):
    """Oracle: the system's list of processes. Mutation: terminate() without the kill after the grace."""
    job_id, pid = started(live, "deaf.bag")
    live.http.post(f"/api/jobs/{job_id}/cancel")
    assert live.finish(job_id)["state"] == "cancelled"
    live.wait(lambda: gone(pid))


@pytest.mark.skipif(sys.platform == "win32", reason="no niceness there")
def test_answers_go_before_jobs(live):
    """Where processors are short, the server's threads come first. Oracle: the system's priorities. Mutation: no `nice`."""
    job_id, pid = started(live, "deaf.bag")
    assert os.getpriority(os.PRIO_PROCESS, pid) == min(19, os.getpriority(os.PRIO_PROCESS, 0) + PATIENCE)
    live.http.post(f"/api/jobs/{job_id}/cancel")
    live.wait(lambda: gone(pid))


def test_a_deleted_recording_takes_a_deaf_worker_with_it(live):
    """Mutation: stop_all_of sending SIGTERM only and giving up waiting."""
    job_id, pid = started(live, "deaf.bag")
    recording_id = live.job(job_id)["recording_id"]
    assert live.http.delete(f"/api/recordings/{recording_id}").status_code == 204
    live.wait(lambda: gone(pid))


def test_a_workers_own_children_go_with_it(live):
    """A child of the worker holds its pipe open: the job still ends, and the child too. Oracle: its process id.

    Mutations: waiting for the pipe's end alone; killing the process and not its group.
    """
    recording_id = live.upload("family.bag")
    job_id = live.start(recording_id)
    assert live.finish(job_id)["error"]["code"] == "job.died"
    messages = live.events(f"/api/jobs/{job_id}/events", until=lambda _: False)
    child = next(int(m["text"]) for _, m in messages if m.get("code") == "fake.child")
    live.wait(lambda: gone(child))


def test_a_job_has_a_longest_time_and_says_so(tmp_path):
    """Mutations: no timer; a timer that asks and never insists; the end told as a death for want of memory."""
    with serving(tmp_path, solve_limit_s=0.5) as live:
        error = live.finish(live.start(live.upload("deaf.bag")))["error"]
    assert error["code"] == "job.too_long"
    assert "the longest" in error["text"]


def test_who_queues_much_waits_longer_than_who_queues_little(tmp_path):
    """One asks for five solves, then another for one, then for one of a second recording: they take turns.

    Oracle: the order worked out by hand. Mutation: first come, first served: the others wait for all five.
    """
    with serving(tmp_path, concurrent_jobs=1) as live:
        first, second = live.upload("slow.bag"), live.upload("slow-too.bag")
        for recording_id in (first, second):
            live.wait(lambda recording_id=recording_id: set(live.job_states(recording_id).values()) == {"done"})
        many = [live.start(first) for _ in range(5)]
        live.wait(lambda: live.job(many[0])["state"] == "running")
        one = live.start(second)
        places = {job_id: live.job(job_id)["queue_place"] for job_id in (*many, one)}
        assert [places[job_id] for job_id in many] == [None, 2, 3, 4, 5]
        assert places[one] == 1
        assert "1 job is before it" in live.job(many[1])["state_text"]
        live.http.post(f"/api/jobs/{many[0]}/cancel")
        live.wait(lambda: live.job(one)["state"] == "running")
        assert live.job(many[1])["state"] == "queued"


def test_the_order_of_jobs_does_not_hang_on_the_clock(live, monkeypatch):
    """The clock is set back by a year between two jobs: the later one is still the later one.

    Oracle: the order in which they were asked for. Mutation: ordering by created_at.
    """
    recording_id = live.upload("any.bag")
    live.wait(lambda: set(live.job_states(recording_id).values()) == {"done"})
    before = live.start(recording_id)
    live.finish(before)

    class Back(datetime):
        @classmethod
        def now(cls, tz=UTC):
            return datetime(2020, 1, 1, tzinfo=tz)

    monkeypatch.setattr(service_module, "datetime", Back)
    after = live.start(recording_id)
    monkeypatch.undo()
    listed = [job["id"] for job in live.http.get(f"/api/recordings/{recording_id}/jobs").json()]
    assert listed[:2] == [after, before]
    assert live.http.get(f"/api/recordings/{recording_id}").json()["latest_job"]["id"] == after


@pytest.mark.parametrize("last", ["9" * 5000, "-1", "1.5", "x", "٣"])
def test_a_senseless_last_event_id_is_no_defect(live, last):
    """Mutation: int() of whatever isdecimal: five thousand digits are a 500."""
    recording_id = live.upload("any.bag")
    job_id = live.start(recording_id)
    live.finish(job_id)
    headers = {"Last-Event-ID": last.encode()}
    assert live.http.get(f"/api/jobs/{job_id}/events", headers=headers).status_code == 200
    boot = live.services.feed._boot
    resumed = live.events(
        f"/api/recordings/{recording_id}/events",
        until=lambda _: True,
        headers={"Last-Event-ID": f"{boot}-".encode() + last.encode()},
    )
    assert resumed[0][1] == {"event": "resync"}


def test_lists_do_not_wait_while_a_change_of_a_job_is_being_written(live):
    """The jobs' lock is held here as a slow disk would hold it, and one waits in the queue. Oracle: the lists, with its place.

    Mutation: the lock taken for a job's place.
    """
    recordings = [live.upload(f"deaf{k}.bag") for k in range(3)]
    jobs = [live.start(recording) for recording in recordings]
    waits = jobs[-1]
    live.wait(lambda: live.job(waits)["queue_place"] is not None)
    answers = []
    paths = ["/api/recordings", f"/api/recordings/{recordings[-1]}/jobs", f"/api/jobs/{waits}"]
    asking = threading.Thread(target=lambda: answers.extend(live.http.get(path).json() for path in paths))
    with live.services.jobs._lock:
        asking.start()
        asking.join(20)
        in_time = not asking.is_alive()
    asking.join(20)
    assert in_time
    assert answers[-1]["queue_place"] == answers[1][0]["queue_place"] >= 1
    for job_id in jobs:
        live.http.post(f"/api/jobs/{job_id}/cancel")


def test_watching_a_job_does_not_stop_the_server_while_jobs_are_busy(live):
    """The jobs' lock is held here as a slow disk would hold it: others are answered. Oracle: their answers.

    Mutation: the lock, the store and the log's file taken on the event loop.
    """
    job_id = live.start(live.upload("any.bag"))
    live.finish(job_id)
    watching = threading.Thread(target=lambda: live.http.get(f"/api/jobs/{job_id}/events"))
    answered = threading.Event()

    def ask():
        live.http.get("/healthz")
        answered.set()

    asking = threading.Thread(target=ask)
    with live.services.jobs._lock:
        watching.start()
        watching.join(0.5)  # it has reached the lock
        asking.start()
        in_time = answered.wait(10)
    watching.join(20)
    asking.join(20)
    assert in_time


def test_no_job_that_is_asked_for_waits_beyond_the_limit(tmp_path):
    """Solves, audits, surfaces and tries again. Oracle: the queue. Mutations: audits, or surfaces, let past the limit."""
    with serving(tmp_path, concurrent_jobs=1, max_waiting_jobs=1) as live:
        recording_id = live.ready("room.bag")
        solve = live.start(recording_id)
        live.finish(solve)
        deaf = live.upload("deaf.bag")
        live.wait(lambda: set(live.job_states(deaf).values()) == {"done"})
        busy = live.start(deaf)
        live.wait(lambda: live.job(busy)["state"] == "running")
        waits = live.start(deaf)
        url = f"/api/recordings/{recording_id}"
        refused = [
            live.http.post(f"{url}/jobs", json={"kind": "solve"}),
            live.http.post(f"{url}/audits", json={"extrinsic": "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"}),
            live.http.post(f"{url}/view", json={"mode": "inspect", "job_id": solve, "extent": "surface"}),
            live.http.post(f"/api/jobs/{solve}/retry"),
        ]
        assert [(one.status_code, one.json()["error"]["code"]) for one in refused] == [(429, "jobs.too_many")] * 4
        assert live.services.jobs.count_under_way() == {"running": 1, "queued": 1}
        for job_id in (waits, busy):
            live.http.post(f"/api/jobs/{job_id}/cancel")
        live.finish(busy)
        assert live.http.post(f"{url}/view", json={"mode": "inspect"}).status_code == 200
        live.wait(lambda: live.job_states(recording_id).get("surface") == "done")
