"""Jobs in real processes behind a real server: their ends, their events, and what a restart leaves."""

from __future__ import annotations

import sqlite3
from datetime import datetime

import pytest

from tests.app.support.live import serving


def final(message):
    return message["event"] == "state" and message["job"]["state"] in {"done", "failed", "cancelled", "interrupted"}


def test_an_upload_is_inspected_and_its_planes_proposed_by_itself(shared_live):
    """Oracle: issue's order of steps. Mutation: ON_ARRIVAL without "planes" shows no cloud."""
    recording_id = shared_live.ready()
    recording = shared_live.http.get(f"/api/recordings/{recording_id}").json()
    assert recording["state"] == "ready"
    assert recording["report"]["schema"] == "unsweep.report/1"
    assert shared_live.job_states(recording_id) == {"inspect": "done", "planes": "done"}


def test_a_report_is_shown_while_it_is_made(shared_live):
    """Some of it is there while its job goes on, without a verdict; then all of it.

    Mutation: job_said deaf to REPORTED; the verdict of what is not final shown in the list.
    """
    recording_id = shared_live.upload("halfway.bag")
    path = f"/api/recordings/{recording_id}"
    shared_live.wait(lambda: shared_live.http.get(path).json()["report"] is not None)
    early = shared_live.http.get(path).json()
    assert (early["state"], early["report"]["final"], early["verdict"]) == ("inspecting", False, None)
    (job,) = [job for job in shared_live.http.get(f"{path}/jobs").json() if job["kind"] == "inspect"]
    assert job["state"] == "running"
    (shared_live.settings.data_dir / "jobs" / job["id"] / "go-on").touch()
    shared_live.wait(lambda: shared_live.http.get(path).json()["state"] == "ready")
    whole = shared_live.http.get(path).json()
    assert (whole["report"]["final"], whole["verdict"]) == (True, "good")


def test_events_come_in_order_and_resume_after_the_last_id(shared_live):
    """Oracle: the first reading of the whole stream. Mutation: starting at `last` instead of `last + 1` repeats one."""
    job_id = shared_live.start(shared_live.upload("any.bag"))
    whole = shared_live.events(f"/api/jobs/{job_id}/events", until=final)
    kinds = [message["event"] for _, message in whole]
    assert [m["job"]["state"] for _, m in whole if m["event"] == "state"] == ["queued", "running", "done"]
    assert kinds.index("iteration") > kinds.index("log")
    assert [int(event_id) for event_id, _ in whole] == list(range(len(whole)))
    costs = [m["cost"] for _, m in whole if m["event"] == "iteration"]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == 20.0  # the last of the burst is never dropped
    rest = shared_live.events(f"/api/jobs/{job_id}/events", until=final, headers={"Last-Event-ID": whole[1][0]})
    assert rest == whole[2:]


def test_workers_have_one_numerical_thread(shared_live, monkeypatch):
    """Oracle: the environment the worker itself saw. Mutation: launching outside _capped_threads gives 4."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    job_id = shared_live.start(shared_live.upload("any.bag"))
    messages = shared_live.events(f"/api/jobs/{job_id}/events", until=final)
    assert next(m["text"] for _, m in messages if m["event"] == "log") == "1"


@pytest.mark.parametrize(
    ("name", "state", "code"),
    [("crash.bag", "failed", "job.died"), ("defect.bag", "failed", "defect"), ("refused.bag", "done", None)],
)
def test_every_end_of_a_job_has_its_state_and_sentence(shared_live, name, state, code):
    """Mutation: passing str(error) of a defect on shows "secret internals"."""
    job = shared_live.finish(shared_live.start(shared_live.upload(name)))
    assert job["state"] == state
    assert (job["error"] or {}).get("code") == code
    assert "secret internals" not in str(job)
    if name == "refused.bag":
        assert job["result"]["verdict"] == "Refused. Nothing moves; record motion."


def test_an_unreadable_recording_fails_with_the_readers_sentence(shared_live):
    """Mutation: state_after returning "ready" for a failed inspection."""
    recording_id = shared_live.upload("broken.bag")
    shared_live.wait(lambda: shared_live.http.get(f"/api/recordings/{recording_id}").json()["state"] == "failed")
    error = shared_live.http.get(f"/api/recordings/{recording_id}").json()["error"]
    assert error["code"] == "recording.unreadable"
    assert "porridge" in error["text"]


@pytest.mark.parametrize("name", ["slow.bag", "stubborn.bag"])
def test_cancel_asks_politely_and_then_insists(shared_live, name):
    """Mutation: without the timer the stubborn job never ends; without the event the slow one ends by signal."""
    job_id = shared_live.start(shared_live.upload(name))
    shared_live.wait(lambda: shared_live.job(job_id)["stage"] == "solve")
    assert shared_live.http.post(f"/api/jobs/{job_id}/cancel").json()["state"] in {"cancelling", "cancelled"}
    assert shared_live.finish(job_id)["state"] == "cancelled"
    assert shared_live.http.post(f"/api/jobs/{job_id}/cancel").status_code == 409
    assert shared_live.http.get(f"/api/results/{job_id}").json()["error"]["code"] == "result.not_there"


def test_only_so_many_jobs_run_at_once(tmp_path):
    """Oracle: states while three want to run and one may. Mutation: may_start ignoring `running` starts all."""
    with serving(tmp_path, concurrent_jobs=1) as live:
        recording_id = live.upload("slow.bag")
        jobs = [live.start(recording_id) for _ in range(3)]
        live.wait(lambda: live.job(jobs[0])["stage"] == "solve")
        assert [live.job(job_id)["state"] for job_id in jobs] == ["running", "queued", "queued"]
        assert live.http.post(f"/api/jobs/{jobs[1]}/cancel").json()["state"] == "cancelled"
        live.http.post(f"/api/jobs/{jobs[0]}/cancel")
        live.wait(lambda: live.job(jobs[2])["state"] == "running")
        first, third = live.finish(jobs[0]), live.job(jobs[2])
        assert datetime.fromisoformat(third["started_at"]) >= datetime.fromisoformat(first["ended_at"])


def test_a_restart_leaves_the_upload_and_an_interrupted_job_that_runs_again(tmp_path):
    """Mutation: recover() doing nothing leaves the job "running" for ever."""
    with serving(tmp_path) as live:
        recording_id = live.upload("slow.bag")
        job_id = live.start(recording_id)
        live.wait(lambda: live.job(job_id)["stage"] == "solve")
    with serving(tmp_path) as live:
        assert live.job(job_id)["state"] == "interrupted"
        assert "run it again" in live.job(job_id)["state_text"]
        assert live.http.get(f"/api/recordings/{recording_id}").status_code == 200
        again = live.http.post(f"/api/jobs/{job_id}/retry").json()
        assert (again["retry_of"], again["kind"]) == (job_id, "solve")
        live.wait(lambda: live.job(again["id"])["stage"] == "solve")
        assert live.events(f"/api/jobs/{job_id}/events", until=final)[-1][1]["job"]["state"] == "interrupted"


def test_a_solve_is_not_run_again_on_another_reading(live):
    """Seen: a recording cut by four seconds, and the retry of a solve from before laid the old planes into the new map: off by
    2 deg and 30 mm. What is not told in a scan's frame is read anew.

    Mutations: no refusal; that of a name; that of an inspection; one that outlasts the change.
    """
    recording_id = live.ready()
    path = f"/api/recordings/{recording_id}"
    solve = live.finish(live.start(recording_id))["id"]
    (inspection,) = [job["id"] for job in live.http.get(f"{path}/jobs").json() if job["kind"] == "inspect"]
    again = f"/api/jobs/{solve}/retry"
    live.http.patch(path, json={"name": "other.bag"})
    assert live.finish(live.http.post(again).json()["id"])["state"] == "done"
    live.http.patch(path, json={"start_s": 4.0})
    live.wait(
        lambda: (
            live.http.get(path).json()["state"] == "ready" and "queued" not in live.job_states(recording_id).values()
        )
    )
    refused = live.http.post(again)
    assert (refused.status_code, refused.json()["error"]["code"]) == (409, "job.read_otherwise")
    assert "start a new one" in refused.json()["error"]["text"]
    assert live.http.post(f"/api/jobs/{inspection}/retry").status_code == 201
    live.http.patch(path, json={"start_s": None})
    assert live.http.post(again).status_code == 201


def test_an_audit_and_a_surface_are_not_run_again_on_another_reading(live):
    """An audit's extrinsic may be of another lidar, a surface is of its solve's scans. Mutations: the reading kept of neither;
    that of now kept for a surface."""
    recording_id = live.ready()
    path = f"/api/recordings/{recording_id}"
    solve = live.finish(live.start(recording_id))["id"]
    audit = live.http.post(f"{path}/audits", json={"extrinsic": "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"}).json()
    live.finish(audit["id"])
    live.http.post(f"{path}/view", json={"mode": "inspect", "extent": "surface", "job_id": solve})
    live.wait(lambda: [job for job in live.http.get(f"{path}/jobs").json() if job["kind"] == "surface"])
    (surface,) = [job for job in live.http.get(f"{path}/jobs").json() if job["kind"] == "surface"]
    live.finish(surface["id"])
    live.http.patch(path, json={"start_s": 4.0})
    live.wait(
        lambda: (
            live.http.get(path).json()["state"] == "ready" and "queued" not in live.job_states(recording_id).values()
        )
    )
    for job in (audit, surface):
        refused = live.http.post(f"/api/jobs/{job['id']}/retry")
        assert (refused.status_code, refused.json()["error"]["code"]) == (409, "job.read_otherwise"), job["kind"]


def test_a_solve_of_an_earlier_version_is_not_run_again_on_another_reading(live):
    """Its row says nothing of the reading; the file beside its result does. Where that is not there either, nobody knows.

    Mutations: the file not looked at; a solve without one refused.
    """
    recording_id = live.ready()
    solve = live.finish(live.start(recording_id))["id"]
    with sqlite3.connect(live.settings.data_dir / "unsweep.sqlite") as store:
        (changed,) = store.execute(
            "UPDATE jobs SET request_json = json_remove(request_json, '$.read_settings') WHERE id = ? RETURNING 1",
            (solve,),
        ).fetchone()
    assert changed
    again = f"/api/jobs/{solve}/retry"
    assert live.http.post(again).status_code == 201
    reading = live.settings.data_dir / "jobs" / solve / "reading.json"
    reading.write_text('{"start_s": 4.0}')
    assert live.http.post(again).json()["error"]["code"] == "job.read_otherwise"
    reading.write_text("{}")
    assert live.http.post(again).status_code == 201


_TZ = {"axis": "tz", "value": 0.1, "std": 0.001}
_ROWS = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"settings": {"random_seed": -1}}, "random_seed: it should be greater than or equal to 0, found -1"),
        ({"settings": {"random_seed": 10**30}}, "random_seed: it should be less than or equal to 9007199254740991"),
        ({"settings": {"priors": [_TZ, _TZ]}}, "priors: expected one prior for each axis, found several for tz"),
        (
            {"settings": {"gravity": {"magnitude_m_s2": -9.0}}},
            "magnitude_m_s2: it should be greater than 9, found -9.0",
        ),
        (
            {"settings": {"gravity": {"magnitude_m_s2": 1e300}}},
            "magnitude_m_s2: it should be less than 10, found 1e+300",
        ),
        ({"settings": {"lidar": "lawnmower"}}, "Expected the name of a lidar"),
        ({"settings": {"imu_noise": "lawnmower"}}, "Expected the name of an IMU"),
        ({"settings": {"priors": [{**_TZ, "axis": "rx"}]}}, "Expected an initial guess with a rotation"),
        ({"initial_guess": {"matrix": [row[:3] for row in _ROWS[:3]]}}, "Expected 4 rows of 4 numbers"),
        ({"initial_guess": {"matrix": [[2.0, 0.0, 0.0, 0.0], *_ROWS[1:]]}}, "Expected a rotation in T_imu_lidar"),
    ],
)
def test_what_no_solve_can_be_asked_is_said_at_once(shared_live, wish, said):
    """Seen: 201, and a job that failed when its turn came, at times as a defect of the program. The words are the command line's.

    Oracle: no job. Mutations: each check left to the job; a guess that fits refused as well.
    """
    recording_id = shared_live.ready()
    url = f"/api/recordings/{recording_id}/jobs"
    before = len(shared_live.http.get(url).json())
    refused = shared_live.http.post(url, json={"kind": "solve", **wish})
    assert refused.status_code == 422, refused.text
    assert said in refused.json()["error"]["text"]
    assert len(shared_live.http.get(url).json()) == before
    right = {"settings": {"priors": [{**_TZ, "axis": "rx"}], "lidar": "VLP 16"}, "initial_guess": {"matrix": _ROWS}}
    assert shared_live.http.post(url, json={"kind": "solve", **right}).status_code == 201


def test_deleting_a_recording_stops_its_jobs_and_leaves_no_file(live):
    """Oracle: the file system. Mutation: not stopping the job first leaves its folder behind."""
    recording_id = live.upload("stubborn.bag")
    job_id = live.start(recording_id)
    live.wait(lambda: live.job(job_id)["stage"] == "solve")
    assert live.http.delete(f"/api/recordings/{recording_id}").status_code == 204
    assert live.http.get(f"/api/recordings/{recording_id}").status_code == 404
    assert live.http.get(f"/api/jobs/{job_id}").status_code == 404
    left = [path for path in live.settings.data_dir.rglob("*") if recording_id in str(path) or job_id in str(path)]
    live.wait(lambda: not [p for p in left if p.exists() and ".locks" not in str(p)])


def test_a_sample_is_simulated_then_inspected(shared_live):
    """Mutation: job_changed without _arrived stops after the simulation."""
    made = shared_live.http.post("/api/recordings", json={"sample": "paper-normal"}).json()
    assert made["origin"] == "sample"
    shared_live.wait(lambda: shared_live.job_states(made["id"]).get("planes") == "done")
    assert shared_live.http.get(f"/api/recordings/{made['id']}").json()["size_bytes"] == 9
    assert shared_live.http.post("/api/recordings", json={"sample": "../../etc"}).status_code == 422


def test_what_was_unpacked_goes_with_the_last_job_that_might_read_it(tmp_path):
    """Mutations: kept until the recording is deleted; removed while another job still runs; left by a server that died."""
    with serving(tmp_path / "data", concurrent_jobs=2) as live:
        slow = live.upload("slow.bag")
        live.wait(lambda: set(live.job_states(slow).values()) == {"done"})
        job_id = live.start(slow)
        live.wait(lambda: live.job(job_id)["state"] == "running")
        files = live.services.files.unpacked(slow) / "1-2"
        files.mkdir(parents=True)
        live.finish(live.start(slow, "inspect"))
        assert files.is_dir()
        live.http.post(f"/api/jobs/{job_id}/cancel")
        live.finish(job_id)
        live.wait(lambda: not files.exists())
        files.mkdir(parents=True)
    with serving(tmp_path / "data"):
        assert not files.exists()


@pytest.mark.parametrize("begun", [True, False])
def test_an_inspection_that_is_stopped_leaves_the_recording_as_the_one_before_found_it(live, begun):
    """Begun, it has written the half of a report over the earlier one. Oracle: what was told before it was asked for.

    Mutations: it counts as failed; its half report stays; an earlier one of another reading is put back.
    """
    recording_id = live.upload("halfway.bag")
    home = f"/api/recordings/{recording_id}"

    def stop_one(job_id):
        if begun:
            live.wait(lambda: (live.http.get(home).json()["report"] or {}).get("final") is False)
        live.http.post(f"/api/jobs/{job_id}/cancel")
        live.finish(job_id)
        return live.http.get(home).json()

    first = next(job for job in live.http.get(f"{home}/jobs").json() if job["kind"] == "inspect")["id"]
    live.wait(lambda: live.job(first)["state"] == "running")
    (live.settings.data_dir / "jobs" / first / "go-on").touch()
    live.finish(first)
    before = live.http.get(home).json()
    assert (before["state"], before["report"]["final"]) == ("ready", True)
    if not begun:  # all slots taken
        slow = live.upload("slow.bag")
        taken = [live.start(slow) for _ in range(live.settings.concurrent_jobs)]
    after = stop_one(live.start(recording_id, kind="inspect"))
    assert {key: after[key] for key in ("state", "error", "report", "verdict")} == {
        key: before[key] for key in ("state", "error", "report", "verdict")
    }
    if begun:
        live.http.patch(home, json={"range_max_m": 50})
        shown = stop_one(next(job for job in live.http.get(f"{home}/jobs").json() if job["kind"] == "inspect")["id"])
        assert (shown["state"], shown["error"]["code"]) == ("failed", "job.cancelled")
    else:
        for job_id in taken:
            live.http.post(f"/api/jobs/{job_id}/cancel")


def test_a_stream_from_beyond_its_end_is_told_from_its_beginning(live):
    """Oracle: the whole stream. Seen: no message at all, where the document promises a final state. Mutation: waiting for a
    number that was never given out; the last message told again to who has had it.
    """
    job_id = live.start(live.upload("any.bag"))
    live.finish(job_id)
    whole = live.events(f"/api/jobs/{job_id}/events", until=final)
    for beyond in (len(whole), 999_999):
        told = live.events(f"/api/jobs/{job_id}/events", until=final, headers={"Last-Event-ID": str(beyond)})
        assert told == whole
    assert live.events(f"/api/jobs/{job_id}/events", until=final, headers={"Last-Event-ID": whole[-1][0]}) == []
    slow = live.start(live.upload("slow.bag"))
    live.wait(lambda: live.job(slow)["state"] == "running")
    first = live.events(f"/api/jobs/{slow}/events", until=lambda _: True, headers={"Last-Event-ID": "999999"})
    assert first[0][0] == "0"
    live.http.post(f"/api/jobs/{slow}/cancel")
