"""Uploads: resumable (tus) and in one request; refused before they cost disk; never a path of the user's making."""

from __future__ import annotations

import base64

import pytest

from app.errors import BadRequest
from app.storage.files import display_name, suffix_of
from tests.app.support.live import serving

TUS = {"Tus-Resumable": "1.0.0"}


def create(live, name, size, **headers):
    metadata = f"filename {base64.b64encode(name.encode()).decode()}"
    return live.http.post(
        "/api/uploads", headers={**TUS, "Upload-Length": str(size), "Upload-Metadata": metadata, **headers}
    )


def patch(live, where, offset, chunk):
    headers = {**TUS, "Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream"}
    return live.http.patch(where, headers=headers, content=chunk)


def path_of(live, location):
    return location.replace(live.origin, "")


def test_an_upload_goes_on_after_the_server_was_restarted(tmp_path):
    """Oracle: the bytes sent. Mutation: keeping the state of uploads in memory answers 404 after the restart."""
    content = bytes(range(256)) * 4000
    with serving(tmp_path) as live:
        made = create(live, "room one.bag", len(content))
        assert made.status_code == 201, made.text
        where = path_of(live, made.headers["location"])
        recording_id = made.headers["x-recording-id"]
        assert where == f"/api/uploads/{recording_id}"
        assert patch(live, where, 0, content[:300_000]).status_code == 204
        recording = live.http.get(f"/api/recordings/{recording_id}").json()
        assert (recording["state"], recording["received_bytes"]) == ("receiving", 300_000)
        assert live.http.post(f"/api/recordings/{recording_id}/jobs", json={"kind": "solve"}).status_code == 409
    with serving(tmp_path) as live:
        head = live.http.head(where, headers=TUS)
        assert (head.status_code, head.headers["upload-offset"]) == (200, "300000")
        last = patch(live, where, 300_000, content[300_000:])
        assert (last.status_code, last.headers["x-recording-id"]) == (204, recording_id)
        target = live.http.get(f"{where}/recording").json()
        assert target["recording_id"] == recording_id
        assert target["state"] in {"inspecting", "ready"}
        stored = live.settings.data_dir / "recordings" / recording_id / "source.bag"
        assert stored.read_bytes() == content
        # A client that lost the last answer asks again and is told that all is there.
        assert live.http.head(where, headers=TUS).headers["upload-offset"] == str(len(content))
        assert live.http.get(f"/api/recordings/{recording_id}").json()["name"] == "room one.bag"


def test_an_upload_whose_last_byte_came_just_before_a_crash_is_finished_at_the_next_start(tmp_path):
    """Mutation: resume() without finish_upload leaves it "receiving" for ever."""
    with serving(tmp_path) as live:
        recording_id = create(live, "room.bag", 4).headers["x-recording-id"]
    (tmp_path / "uploads" / recording_id).write_bytes(b"data")
    with serving(tmp_path) as live:
        live.wait(lambda: live.job_states(recording_id).get("inspect") == "done")


def test_uploads_that_cannot_be_taken_are_refused_before_a_byte_is_sent(tmp_path):
    """Mutation: skipping the hook makes the first of them 201."""
    with serving(tmp_path, max_upload_bytes=1000) as live:
        cases = [
            (create(live, "room.exe", 10), 422, "upload.suffix"),
            (create(live, "room.bag", 1001), 413, "upload.too_large"),
            (create(live, "room.bag", 0), 422, "upload.empty"),
            (create(live, "room.bag", 10, **{"Upload-Concat": "partial"}), 422, "upload.extension"),
            (live.http.post("/api/uploads", headers={**TUS, "Upload-Length": "5"}), 422, "upload.no_name"),
            (live.http.put("/api/recordings/upload?name=a.bag", content=b"x" * 1001), 413, "upload.too_large"),
            (live.http.put("/api/recordings/upload?name=a.bag", content=b""), 422, "upload.empty"),
        ]
        for answer, status, code in cases:
            assert (answer.status_code, answer.json()["error"]["code"]) == (status, code)
        chunked = live.http.put("/api/recordings/upload?name=a.bag", content=(b"x" * 600 for _ in range(3)))
        assert (chunked.status_code, chunked.json()["error"]["code"]) == (413, "upload.too_large")
        assert live.http.get("/api/recordings").json() == []
        assert not [path for path in (tmp_path / "uploads").iterdir() if path.is_file()]


def test_a_full_disk_is_told_before_the_upload(tmp_path):
    """Oracle: a reserve larger than any disk. Mutation: not counting the reserve."""
    with serving(tmp_path, min_free_bytes=2**60) as live:
        answer = create(live, "room.bag", 10)
        assert (answer.status_code, answer.json()["error"]["code"]) == (507, "upload.disk_full")


@pytest.mark.parametrize("name", ["../../evil.bag", "..\\evil.bag", "/etc/passwd.bag", "a\x00b\n.bag"])
def test_a_users_file_name_is_shown_and_never_a_path(shared_live, name):
    """Oracle: the files that are there. Mutation: storing under the name escapes the folder."""
    recording_id = shared_live.upload(name)
    shown = shared_live.http.get(f"/api/recordings/{recording_id}").json()["name"]
    assert "/" not in shown
    assert "\\" not in shown
    assert shown.isprintable()
    folder = shared_live.settings.data_dir
    assert (folder / "recordings" / recording_id / "source.bag").is_file()
    assert not list(folder.parent.rglob("*evil*"))


def test_suffixes_are_kept_from_an_allowed_list_only():
    """Mutation: Path(name).suffix makes .gz of .tar.gz, which the reader cannot open."""
    assert suffix_of("A.TAR.GZ") == ".tar.gz"
    assert suffix_of("x.y.mcap") == ".mcap"
    with pytest.raises(BadRequest, match="ends in one of"):
        suffix_of("bag")
    assert len(display_name("x" * 500 + ".bag")) == 200
    assert display_name("///") == "recording"
