"""What the last three screens ask of the server: two recordings at once, old extrinsics, scans, commands, shared pages."""

from __future__ import annotations

import json
import threading

import numpy as np
import pytest

from app.scene.throttle import Throttle
from app.schemas.view import ViewState
from app.work.functions import run_job
from calib_core.errors import Cancelled
from tests.app.support import world
from tests.app.support.orders import order_of


@pytest.fixture(scope="module")
def solved(shared_live):
    """A recording with planes and one answer: its id and the job's."""
    recording_id = shared_live.ready()
    job_id = shared_live.start(recording_id, settings={"excluded_spans_s": [[0.25, 0.5]]})
    assert shared_live.finish(job_id)["state"] == "done"
    return recording_id, job_id


def test_a_busy_recording_keeps_nobody_waiting_who_looks_at_another(shared_live, solved):
    """One scene's lock is held here as a slow scene would. Mutation: one lock for all recordings: the other never answers."""
    other = shared_live.upload("any.bag")
    hub = shared_live.services.scenes
    hub.dial(solved[0])[0].close()
    answers = []
    with hub.open.locked(solved[0]):
        asking = threading.Thread(
            target=lambda: answers.append(
                shared_live.http.post(f"/api/recordings/{other}/view", json={"scan": 0, "dark": True}).json()
            )
        )
        asking.start()
        asking.join(20)
        assert not asking.is_alive()
        hub.dial(other)[0].close()
    assert answers[0]["dark"] is True
    assert shared_live.http.get(f"/api/recordings/{solved[0]}/view").json()["dark"] is False


def test_two_recordings_keep_their_own_views_and_tell_their_own_browsers(shared_live, solved):
    """Oracle: the other recording's event stream stays empty. Mutation: telling every feed."""
    other = shared_live.ready()
    before = shared_live.http.get(f"/api/recordings/{other}/view").json()
    shared_live.http.post(f"/api/recordings/{solved[0]}/view", json={"mode": "inspect", "scan": 3})
    shared_live.http.post(f"/api/recordings/{other}/view", json={"click": "grow"})
    path = f"/api/recordings/{other}/events"
    found = []
    watching = threading.Thread(
        target=lambda: found.extend(shared_live.events(path, until=lambda m: m["event"] == "view-changed"))
    )
    watching.start()
    feed = shared_live.services.feed
    shared_live.wait(lambda: feed._journals.get(other) is not None and feed._journals[other]._followers)
    shared_live.http.post(f"/api/recordings/{solved[0]}/view", json={"scan": 4})
    shared_live.http.post(f"/api/recordings/{other}/view", json={"click": "toggle"})
    watching.join(20)
    told = [message["view"] for _, message in found if message["event"] == "view-changed"]
    assert [(view["click"], view["scan"]) for view in told] == [("toggle", before["scan"])]


def test_an_old_extrinsic_is_read_shown_and_taken_away(shared_live, solved):
    """Oracle: the answer itself given as the old one costs nothing; turned by 3 deg it does. Mutation: costs swapped."""
    text = "\n".join(" ".join(f"{value:.9f}" for value in row) for row in world.transform_matrix())
    old = shared_live.http.post("/api/extrinsic", json={"text": text}).json()
    np.testing.assert_allclose(old["translation_m"], world.P_IMU_LIDAR, atol=1e-8)
    url = f"/api/recordings/{solved[0]}/view"
    shown = shared_live.http.post(url, json={"mode": "inspect", "show": "side", "old": old}).json()
    assert shown["old_blur"]["nudged_rms_m"] == pytest.approx(shown["old_blur"]["solved_rms_m"], abs=1e-4)
    wrong = {**old, "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}
    shown = shared_live.http.post(url, json={"old": wrong}).json()
    assert shown["old_blur"]["nudged_rms_m"] > 10 * shown["old_blur"]["solved_rms_m"]
    assert shared_live.http.post(url, json={"old": None}).json()["old_blur"] is None
    refused = shared_live.http.post("/api/extrinsic", json={"text": "1 2 3"})
    assert (refused.status_code, refused.json()["error"]["code"]) == (422, "extrinsic.unfit")


def test_a_pasted_urdf_is_read_with_the_recordings_frames(shared_live, solved):
    """A rig with two lidars, of whose links the recording's frame is one: an audit found it, Inspect and the start value did not.

    Mutations: the recording not asked; IMU and lidar swapped; a mark at the beginning of the text keeps an audit from waiting
    for the frames.
    """
    joint = '<joint type="fixed"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/></joint>'
    text = "\ufeff<robot>" + joint.format("box", "lidar_low", 0.3) + joint.format("box", "lidar_top", 0.1) + "</robot>"
    post, url = shared_live.http.post, f"/api/extrinsic?recording_id={solved[0]}"
    refused = post(url, json={"text": text})
    assert (refused.status_code, "which link" in refused.json()["error"]["text"]) == (422, True)
    store = shared_live.services.recordings._store
    report = json.loads(store.find(solved[0]).report_json)
    sensors = {"imu": {"frame_id": "box"}, "lidar": {"frame_id": "/lidar_top"}}
    assert store.change(solved[0], {"report_json": json.dumps(report | sensors)})
    try:
        assert post(url, json={"text": text}).json()["translation_m"] == [0.1, 0.0, 0.0]
        assert post("/api/extrinsic", json={"text": text}).status_code == 422
    finally:
        assert store.change(solved[0], {"report_json": json.dumps(report)})
    assert post(f"/api/extrinsic?recording_id={32 * '0'}", json={"text": text}).status_code == 404
    assert post(f"/api/recordings/{solved[0]}/audits", json={"extrinsic": text}).status_code == 201


def test_an_extrinsic_is_audited_before_any_solve(shared_live):
    """The answer itself passes; 5 m off fails unless the limits allow it. Mutations: the limits not handed on; the
    report of a solve given out; a text that is no extrinsic queued."""
    recording_id = shared_live.ready()
    rows = world.transform_matrix()
    url = f"/api/recordings/{recording_id}/audits"

    # The world's covariance is the unit matrix, a radian and a metre each: only limits as wide can be held against it.
    wide = {"rotation_deg": 180, "translation_mm": 4000, "time_offset_ms": 4000}

    def audited(x_m, limits):
        moved = rows.copy()
        moved[0, 3] += x_m
        text = "\n".join(" ".join(f"{value:.9f}" for value in row) for row in moved)
        job = shared_live.http.post(url, json={"extrinsic": text, "limits": limits})
        assert (job.status_code, job.json()["kind"]) == (201, "audit")
        done = shared_live.finish(job.json()["id"])
        report = shared_live.http.get(f"/api/audits/{done['id']}").json()
        assert done["result"] == {"kind": "audit", "verdict": report["verdict"], "text": report["text"]}
        return report

    assert audited(0.0, wide)["verdict"] == "passed"
    off = audited(5.0, wide)
    assert (off["verdict"], round(off["axes"][3]["difference"])) == ("failed", 5000)
    assert audited(5.0, {**wide, "translation_mm": 6000})["verdict"] == "passed"
    refused = shared_live.http.post(url, json={"extrinsic": "1 2 3"})
    assert (refused.status_code, refused.json()["error"]["code"]) == (422, "extrinsic.unfit")
    solve = shared_live.start(recording_id)
    shared_live.finish(solve)
    assert shared_live.http.get(f"/api/audits/{solve}").status_code == 409


def test_scans_command_and_scene_page_of_a_run(shared_live, solved):
    """Mutation: the command of the defaults, without what this run left out."""
    get = shared_live.http.get
    scans = get(f"/api/results/{solved[1]}/scans").json()
    assert (len(scans["t_s"]), max(scans["rms_m"]) < 2e-3) == (world.N_SCANS, True)
    command = get(f"/api/results/{solved[1]}/command").json()
    assert "--exclude=0.25:0.5" in command["text"]
    assert [file["name"] for file in command["files"]] == ["planes.json"]
    page = get(f"/api/results/{solved[1]}/scene.html?dark=true")
    assert "attachment" in page.headers["content-disposition"]
    assert len(page.content) > 500_000


def test_a_refused_run_has_neither_scans_nor_scene(shared_live):
    """Mutation: a missing file told as a defect."""
    job_id = shared_live.start(shared_live.upload("refused.bag"))
    shared_live.finish(job_id)
    for what in ("scans", "scene.html", "thickness"):
        answer = shared_live.http.get(f"/api/results/{job_id}/{what}")
        assert (answer.status_code, answer.json()["error"]["code"][:7]) == (409, "result.")


def test_a_view_kept_by_an_older_version_is_forgotten(shared_live, solved):
    """Mutation: the stored text validated without a net: every look at the recording fails."""
    services = shared_live.services
    services.scenes._documents.write(solved[0], "view", '{"show": "map", "gone": 1}')
    view = shared_live.http.get(f"/api/recordings/{solved[0]}/view")
    assert view.status_code == 200
    assert view.json()["show"] == ViewState().show


def test_a_sample_stops_when_asked(tmp_path):
    """Mutation: the simulation not told that it should stop."""
    source = tmp_path / "sample.bag"
    order = order_of(tmp_path, "simulate", recording_name="sample", source=source, scenario="one-axis")
    asked = []

    def should_cancel():
        asked.append(1)
        return len(asked) > 2

    with pytest.raises(Cancelled):
        run_job(order, lambda _: None, should_cancel)
    assert not order.source.exists()


def test_a_burst_of_requests_is_done_twice_and_its_last_is_not_lost():
    """At once, and once more after the last. Mutations: no interval (a hundred times); nothing after the first."""
    done, last = [], threading.Event()
    state = {"now": 0}

    def act():
        done.append(state["now"])
        if state["now"] == 99:
            last.set()

    throttle = Throttle(act, 0.2)
    for number in range(100):
        state["now"] = number
        throttle.request()
    assert last.wait(20)
    assert done[0] == 0
    assert done[-1] == 99
    assert len(done) < 50
    throttle.stop()


def test_a_urdf_that_is_none_is_refused_when_it_is_asked_for(shared_live):
    """As other texts are. Seen: 201, and a job that failed. Mutation: every text that begins with < left to the job."""
    recording_id = shared_live.ready()
    answer = shared_live.http.post(f"/api/recordings/{recording_id}/audits", json={"extrinsic": "<robot><joint>"})
    assert (answer.status_code, answer.json()["error"]["code"]) == (422, "extrinsic.unfit")


def test_a_refused_solve_says_why_it_has_neither_walls_nor_scans(shared_live):
    """Seen: "solve again to see them", which gives no more. Mutation: the same sentence as for a run of an earlier version."""
    refused = shared_live.start(shared_live.upload("refused.bag"))
    shared_live.finish(refused)
    for part in ("scans", "thickness"):
        answer = shared_live.http.get(f"/api/results/{refused}/{part}")
        assert (answer.status_code, answer.json()["error"]["code"]) == (409, "result.no_answer")
        assert "The solve was refused" in answer.json()["error"]["text"]
