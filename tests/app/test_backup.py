"""A copy of the data directory is the server: put anywhere, it has every recording, plane, run and answer."""

from __future__ import annotations

import shutil

from tests.app.support.live import serving


def everything(live, recording_id, job_id):
    """What people see of a recording."""
    told = [
        live.http.get(path)
        for path in (
            f"/api/recordings/{recording_id}",
            f"/api/recordings/{recording_id}/planes",
            f"/api/recordings/{recording_id}/timeline",
            f"/api/recordings/{recording_id}/jobs",
            f"/api/results/{job_id}",
            f"/api/results/{job_id}/thickness",
        )
    ]
    assert [answer.status_code for answer in told] == [200] * 6
    return [answer.json() for answer in told]


def test_a_copy_of_the_data_directory_is_the_whole_server_wherever_it_is_put(tmp_path):
    """Backup: stop, copy with times, start. Restore: the copy, in another place, the original gone.

    Oracle: the answers before. Mutations: keys of arrays made of where the directory lies, which then are not found;
    the log of SQLite left behind.
    """
    with serving(tmp_path / "data") as live:
        recording_id = live.ready()
        rename = {"op": "rename", "expected_revision": 0, "index": 0, "name": "workbench"}
        assert live.http.post(f"/api/recordings/{recording_id}/planes/operations", json=rename).status_code == 200
        job_id = live.start(recording_id)
        live.finish(job_id)
        before = everything(live, recording_id, job_id)
    shutil.copytree(tmp_path / "data", tmp_path / "restored" / "elsewhere")
    shutil.rmtree(tmp_path / "data")
    with serving(tmp_path / "restored" / "elsewhere") as live:
        assert everything(live, recording_id, job_id) == before
        again = live.finish(live.http.post(f"/api/jobs/{job_id}/retry").json()["id"])
        assert again["state"] == "done"
