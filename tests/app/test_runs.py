"""The history of a recording's runs: compared at one instant, and whole where one of them lies damaged."""

from __future__ import annotations

import json

import pytest

from tests.app.support.damage import cut, overwrite
from tests.app.support.live import serving


@pytest.fixture
def live(tmp_path):
    with serving(tmp_path) as running:
        yield running


def solved_times(live, count):
    """A recording and so many solves of it, the oldest first."""
    recording_id = live.ready()
    jobs = []
    for _ in range(count):
        jobs.append(live.start(recording_id))
        live.finish(jobs[-1])
    return recording_id, jobs


@pytest.mark.parametrize("damage", [overwrite, cut])
def test_a_damaged_result_is_told_of_and_leaves_the_others_alone(live, tmp_path, damage):
    """Oracle: the two that are whole, of which the newer becomes the latest. Mutations: what cannot be read raised for all (the
    whole history was a defect); passed over in silence; bytes that are no text let through."""
    recording_id, jobs = solved_times(live, 3)
    damage(tmp_path / "jobs" / jobs[2] / "result.json")
    newest, middle, oldest = live.http.get(f"/api/recordings/{recording_id}/runs").json()["runs"]
    assert (newest["job"]["id"], newest["error"]["code"], newest["from_latest"]) == (jobs[2], "result.unreadable", None)
    assert [run["error"] for run in (middle, oldest)] == [None, None]
    assert (middle["from_latest"], oldest["from_latest"]["rotation_deg"]) == (None, 0.0)
    for page in ("", "/report", "/export/tum", "/command"):
        assert live.http.get(f"/api/results/{jobs[1]}{page}").status_code == 200, page
        answer = live.http.get(f"/api/results/{jobs[2]}{page}")
        assert (answer.status_code, answer.json()["error"]["code"]) == (409, "result.unreadable"), page


@pytest.mark.parametrize("name", ["thickness", "scans"])
def test_what_lies_beside_a_result_may_be_damaged_too(live, tmp_path, name):
    """Mutation: read as if the disk were sound, a defect."""
    _, (job_id,) = solved_times(live, 1)
    cut(tmp_path / "jobs" / job_id / f"{name}.json")
    answer = live.http.get(f"/api/results/{job_id}/{name}")
    assert (answer.status_code, answer.json()["error"]["code"]) == (409, "result.unreadable")


@pytest.mark.parametrize(("recording", "apart_s"), [("one", 0.0), ("other", 3e-4)])
def test_runs_are_compared_at_one_instant(live, tmp_path, recording, apart_s):
    """A part of a minute and the whole: 15 s at 20 ppm are 0.3 ms, and both are right. Mutation: offsets subtracted as they
    stand."""
    recording_id, jobs = solved_times(live, 2)
    for job_id, sha256, at_s, offset_ns in ((jobs[0], "one", 45.0, 10_300_000), (jobs[1], recording, 30.0, 10_000_000)):
        path = tmp_path / "jobs" / job_id / "result.json"
        document = json.loads(path.read_text())
        document |= {"time_offset_s": offset_ns * 1e-9, "time_offset_ns": offset_ns, "time_offset_at_s": at_s}
        document |= {"clock_rate_ppm": 20.0, "clock_rate_ppm_std": 1.0}
        document["provenance"]["recording"]["sha256"] = sha256
        path.write_text(json.dumps(document))
    _, older = live.http.get(f"/api/recordings/{recording_id}/runs").json()["runs"]
    assert older["from_latest"]["time_offset_s"] == pytest.approx(-apart_s, abs=1e-12)
