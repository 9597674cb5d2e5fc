"""Names and paths in the recordings folder that no browser can say, or no file system can hold."""

from __future__ import annotations

import os

import pytest


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
