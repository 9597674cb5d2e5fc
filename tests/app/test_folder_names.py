"""Names and paths in the recordings folder that no browser can say, or no file system can hold."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from app.errors import NotFound
from app.recordings.folder import RecordingsFolder


@pytest.mark.parametrize("path", ["x" * 5000, "x/" * 3000, "a\x00b", "\udcff", "..%2f..", "~", "/" * 2000])
def test_a_senseless_path_is_refused_with_a_sentence(shared_live, path):
    """Oracle: the status. Mutation: looking whether it is a folder outside the try: File name too long, a 500."""
    raw = path.encode("utf-8", "surrogateescape")
    answer = shared_live.http.get("/api/folder", params={"path": raw})
    assert answer.status_code in {403, 404, 422}, answer.text
    assert answer.json()["error"]["text"].endswith(".")
    opened = shared_live.http.post("/api/recordings", json={"folder_path": raw.decode("utf-8", "replace")})
    assert opened.status_code in {403, 404, 422}, opened.text


def test_a_file_whose_name_is_no_text_is_shown_and_not_opened(shared_live):
    """Bytes that are no UTF-8, as old cameras and archives leave them. Mutation: the name as it is: no JSON, a 500."""
    folder = shared_live.settings.recordings_dir
    (folder / "good.bag").write_bytes(b"x")
    (folder / os.fsdecode(b"r\xe9cord.bag")).write_bytes(b"x")
    (folder / os.fsdecode(b"dossi\xe9r")).mkdir()
    entries = {e["name"]: e for e in shared_live.http.get("/api/folder").json()["entries"]}
    assert entries["good.bag"]["kind"] == "recording"
    assert entries["r\ufffdcord.bag"]["kind"] == "file"
    assert entries["dossi\ufffdr"]["kind"] == "file"
    answer = shared_live.http.post("/api/recordings", json={"folder_path": "r\ufffdcord.bag"})
    assert answer.json()["error"]["code"] == "folder.no_recording"


def test_a_link_that_leads_round_in_a_circle_hides_nothing_else(tmp_path):
    """Oracle: what lies beside it. Mutation: the error of a circle let through, which empties the whole listing."""
    (tmp_path / "good.bag").write_bytes(b"x")
    (tmp_path / "round").symlink_to("about")
    (tmp_path / "about").symlink_to("round")
    (tmp_path / "nowhere").symlink_to("gone")
    (tmp_path / "out").symlink_to("/")
    listing = RecordingsFolder(tmp_path).listing("")
    assert [(entry.name, entry.kind) for entry in listing.entries] == [("good.bag", "recording")]
    assert listing.links_out == 1


def test_what_the_server_may_not_look_into_is_shown_and_not_opened(tmp_path, monkeypatch):
    """A disk's lost+found. Oracle: rights of another user, as root has them all. Mutations: either error let through."""
    (tmp_path / "good.bag").write_bytes(b"x")
    (tmp_path / "lost+found").mkdir(mode=0)
    looked, listed = Path.stat, Path.iterdir

    def barred(path: Path) -> bool:
        return any(not stat.S_IMODE(looked(above).st_mode) for above in (path, *path.parents))

    def look(path: Path, **how):
        if barred(path.parent):
            raise PermissionError(13, "Permission denied")
        return looked(path, **how)

    def each(path: Path):
        if barred(path):
            raise PermissionError(13, "Permission denied")
        return listed(path)

    monkeypatch.setattr(Path, "stat", look)
    monkeypatch.setattr(Path, "iterdir", each)
    folder = RecordingsFolder(tmp_path)
    entries = {entry.name: entry.kind for entry in folder.listing("").entries}
    assert entries == {"good.bag": "recording", "lost+found": "file"}
    with pytest.raises(NotFound, match="may not look into"):
        folder.listing("lost+found")
