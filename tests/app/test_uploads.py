"""Uploads: resumable (tus) and in one request; refused before they cost disk; never a path of the user's making."""

from __future__ import annotations

import base64
import errno
import hashlib
import os
import random
import socket
import time
from datetime import UTC, datetime
from types import SimpleNamespace

import pytest

from app.errors import BadRequest
from app.storage.files import display_name, suffix_of
from app.uploads.protocol import BODY_TYPE
from tests.app.support.live import serving

TUS = {"Tus-Resumable": "1.0.0"}
IDENTITY = "1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1"


def create(live, name, size, **headers):
    told = {**TUS, "Upload-Length": str(size), "Upload-Metadata": metadata(name), **headers}
    return live.http.post("/api/uploads", headers=told)


def metadata(name, **more):
    pairs = {"filename": name, **more}
    return ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in pairs.items())


def patch(live, where, offset, chunk, **more):
    headers = {**TUS, "Upload-Offset": str(offset), "Content-Type": "application/offset+octet-stream", **more}
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


def test_what_needs_the_bytes_of_an_upload_says_that_they_are_still_arriving(live):
    """It was told to be lost, "put it back, or delete the entry", of a file that was on its way. Oracle: every address of the
    document that is about one recording, asked with what its examples ask. Mutation: cache_key() without a look at the state.
    """
    recording_id = create(live, "room.bag", 1000).headers["x-recording-id"]
    document = live.http.get("/api/openapi.json").json()
    told = {}
    for path, verbs in document["paths"].items():
        if "{recording_id}" not in path or path.endswith(("/events", "/share")):
            continue
        for verb in sorted(verbs.keys() & {"get", "post"}):
            asked = {
                "planes/operations": {"op": "undo"},
                "jobs": {"kind": "inspect"},
                "audits": {"extrinsic": IDENTITY},
            }
            body = next((words for end, words in asked.items() if path.endswith(f"/{end}")), {})
            url = path.replace("{recording_id}", recording_id)
            answer = live.http.request(verb, url, params={"u": 0.5, "v": 0.5}, json=body if verb == "post" else None)
            if answer.status_code >= 400:
                told[f"{verb} {path.rpartition('{recording_id}/')[2]}"] = answer
    assert told.keys() == {"get planes", "get timeline", "post planes/operations", "post jobs", "post audits"}
    for answer in told.values():
        assert (answer.status_code, answer.json()["error"]["code"]) == (409, "recording.receiving")
        assert "still arriving" in answer.json()["error"]["text"]
    assert live.http.get(f"/api/recordings/{recording_id}").json()["has_planes"] is False
    live.services.keeping.sweep(datetime.now(UTC))


@pytest.mark.parametrize("moved", [False, True])
def test_an_upload_whose_last_byte_came_just_before_a_crash_is_finished_at_the_next_start(tmp_path, moved):
    """Mutation: resume() without finish_upload, or without looking for a file moved already, leaves it "receiving"."""
    with serving(tmp_path) as live:
        recording_id = create(live, "room.bag", 4).headers["x-recording-id"]
        partial = live.services.files.partial(recording_id)
        partial.path.write_bytes(b"data")
        partial.note(4)
        source = tmp_path / "recordings" / recording_id / "source.bag"
        if moved:
            source.parent.mkdir()
            partial.path.rename(source)
    with serving(tmp_path) as live:
        live.wait(lambda: live.job_states(recording_id).get("inspect") == "done")
        assert source.read_bytes() == b"data"
        assert list((tmp_path / "uploads").iterdir()) == []


def test_bytes_that_no_sync_vouches_for_are_sent_again(tmp_path):
    """A power cut leaves a file longer than what was written. Mutation: believing the file's length stores the zeros."""
    content = bytes(range(256)) * 10
    with serving(tmp_path) as live:
        where = create(live, "room.bag", len(content)).headers["location"]
        assert patch(live, where, 0, content[:100]).status_code == 204
        recording_id = where.rsplit("/", 1)[-1]
    with (tmp_path / "uploads" / recording_id).open("ab") as file:
        file.write(bytes(500))
    with serving(tmp_path) as live:
        assert live.http.head(where, headers=TUS).headers["upload-offset"] == "100"
        assert patch(live, where, 600, content[600:]).status_code == 409
        assert patch(live, where, 100, content[100:]).status_code == 204
        assert (tmp_path / "recordings" / recording_id / "source.bag").read_bytes() == content


def test_bytes_come_with_the_announcement_within_what_was_announced(tmp_path):
    """Mutation: a creation whose body nobody bounds stores 629 MB under a declared length of 10."""
    kind = {"Content-Type": "application/offset+octet-stream"}
    with serving(tmp_path, max_body_bytes=1000) as live:
        headers = {**TUS, "Upload-Metadata": metadata("room.bag"), **kind}
        part = live.http.post("/api/uploads", headers={**headers, "Upload-Length": "5000"}, content=b"a" * 3000)
        assert (part.status_code, part.headers["upload-offset"]) == (201, "3000")
        whole = live.http.post("/api/uploads", headers={**headers, "Upload-Length": "5"}, content=b"whole")
        source = tmp_path / "recordings" / whole.headers["x-recording-id"] / "source.bag"
        assert source.read_bytes() == b"whole"
        long = live.http.post("/api/uploads", headers={**headers, "Upload-Length": "10"}, content=b"a" * 3000)
        assert (long.status_code, long.json()["error"]["code"]) == (413, "upload.too_large")
        other = live.http.post(
            "/api/uploads", headers={**headers, "Upload-Length": "9", "Content-Type": "a/b"}, content=b"a"
        )
        assert other.status_code == 415
        assert len(live.http.get("/api/recordings").json()) == 2


def test_a_body_is_bounded_wherever_no_recording_is_expected(tmp_path):
    """Mutation: exempting every path below /api/uploads/ takes 2 GB of memory."""
    with serving(tmp_path, max_body_bytes=1000) as live:
        for method, path in [
            ("POST", "/api/uploads/" + "0" * 32),
            ("PUT", "/api/uploads/" + "0" * 32),
            ("POST", "/api/recordings/upload"),
            ("POST", "/api/recordings/upload/more"),
            ("PATCH", "/api/uploads/x"),
        ]:
            answer = live.http.request(method, path, headers=TUS, content=b"x" * 1001)
            assert (answer.status_code, answer.json()["error"]["code"]) == (413, "request.too_large"), (method, path)


def test_a_body_without_a_length_is_bounded_with_the_same_answer(tmp_path):
    """Sent in chunks. Oracle: the answer to one of known length. Seen: 400, "There was an error parsing the body". Mutation: the
    framework's answer to a body that breaks off is passed on.
    """
    with serving(tmp_path, max_body_bytes=1000) as live:
        for path in ("/api/extrinsic", "/api/recordings"):
            parts = (b"x" * 400 for _ in range(6))
            answer = live.http.post(path, headers={"Content-Type": "application/json"}, content=parts)
            assert (answer.status_code, answer.json()["error"]["code"]) == (413, "request.too_large"), path
        small = live.http.post(
            "/api/extrinsic", headers={"Content-Type": "application/json"}, content=iter([b"{", b"}"])
        )
        assert small.status_code == 422


def test_a_name_is_as_long_as_it_may_be_by_either_way(shared_live):
    """Oracle: the other way. Seen: a name of 201 letters refused in one request and accepted by tus. Mutations: a bound of
    one way's own; none for tus.
    """
    long, too_long = "r" * 250 + ".bag", "r" * 1000 + ".bag"
    by_put = shared_live.http.put("/api/recordings/upload", params={"name": long}, content=b"some bytes")
    by_tus = create(shared_live, long, 10)
    assert (by_put.status_code, by_tus.status_code) == (201, 201)
    of_tus = shared_live.http.get(f"/api/recordings/{by_tus.headers['x-recording-id']}").json()
    assert by_put.json()["name"] == of_tus["name"] == "r" * 200
    by_put = shared_live.http.put("/api/recordings/upload", params={"name": too_long}, content=b"some bytes")
    assert (by_put.status_code, create(shared_live, too_long, 10).status_code) == (422, 422)


def test_what_is_cut_in_its_only_request_is_not_told_to_go_on(live, monkeypatch):
    """Nothing comes any more. Oracle: no such upload is there afterwards. Seen: "go on from the upload's offset". Mutation: one
    sentence for both.
    """
    monkeypatch.setattr("app.uploads.inbox.SILENCE_S", 0.3)
    with socket.create_connection(("127.0.0.1", live.port), timeout=15) as line:
        head = b"PUT /api/recordings/upload?name=a.bag HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
        line.sendall(head + b"Content-Length: 20\r\n\r\n0123")
        said = b"".join(iter(lambda: line.recv(4096), b"")).decode()
    assert said.startswith("HTTP/1.1 422")
    assert "send it again, as nothing of it was kept" in said
    assert live.http.get("/api/recordings").json() == []
    url = create(live, "a.bag", 20).headers["location"]
    with socket.create_connection(("127.0.0.1", live.port), timeout=15) as line:
        head = f"PATCH {url} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
        line.sendall(f"{head}Content-Type: {BODY_TYPE}\r\nContent-Length: 20\r\n\r\n0123".encode())
        said = b"".join(iter(lambda: line.recv(4096), b"")).decode()
    assert "go on from the upload's offset" in said
    assert live.http.head(url, headers=TUS).headers["upload-offset"] == "4"


def test_what_is_announced_is_reserved(tmp_path, monkeypatch):
    """Oracle: a disk of 1000 bytes. Mutation: asking only for what is free now promises the same bytes twice."""
    monkeypatch.setattr("app.storage.files.shutil.disk_usage", lambda _: SimpleNamespace(free=1000))
    with serving(tmp_path) as live:
        first = create(live, "a.bag", 600)
        assert first.status_code == 201
        refused = create(live, "b.bag", 600)
        assert (refused.status_code, refused.json()["error"]["code"]) == (507, "upload.disk_full")
        assert live.http.delete(first.headers["location"], headers=TUS).status_code == 204
        assert live.http.get("/api/recordings").json() == []
        assert create(live, "b.bag", 600).status_code == 201


@pytest.mark.parametrize("length", ["-5", "1e3", "", "9" * 400, "٣", "0x10"])
def test_lengths_that_are_none_are_refused(shared_live, length):
    """Mutation: int() takes "-5" and "٣"."""
    answer = shared_live.http.post(
        "/api/uploads",
        headers={**TUS, "Upload-Metadata": metadata("a.bag"), "Upload-Length": length.encode()},
    )
    assert (answer.status_code, answer.json()["error"]["code"]) == (422, "upload.no_length")


def test_addresses_that_are_no_uploads_and_versions_that_are_none(shared_live):
    """Mutation: joining the path to the folder of uploads makes "." the folder itself."""
    for upload_id in ("%2e", "..%2f..%2fetc", "0" * 32, "x" * 5000):
        for method in ("HEAD", "PATCH", "DELETE"):
            kind = {"Content-Type": "application/offset+octet-stream", "Upload-Offset": "0"}
            answer = shared_live.http.request(method, f"/api/uploads/{upload_id}", headers={**TUS, **kind})
            assert answer.status_code in {404, 405}, (method, upload_id)
    old = shared_live.http.post("/api/uploads", headers={"Tus-Resumable": "0.2.2"})
    assert (old.status_code, old.headers["tus-version"]) == (412, "1.0.0")
    told = shared_live.http.options("/api/uploads")
    assert {"creation", "termination", "checksum", "expiration"} <= set(told.headers["tus-extension"].split(","))


def test_a_part_with_a_wrong_checksum_is_not_kept(tmp_path):
    """Oracle: hashlib. Mutation: appending before the hash is compared keeps the damaged bytes."""
    content = b"abc" * 1000
    right = "sha256 " + base64.b64encode(hashlib.sha256(content).digest()).decode()
    with serving(tmp_path) as live:
        where = create(live, "room.bag", len(content)).headers["location"]
        damaged = patch(live, where, 0, b"x" + content[1:], **{"Upload-Checksum": right})
        assert (damaged.status_code, damaged.json()["error"]["code"]) == (460, "upload.checksum")
        assert live.http.head(where, headers=TUS).headers["upload-offset"] == "0"
        assert patch(live, where, 0, content, **{"Upload-Checksum": "md5 AAAA"}).status_code == 400
        assert patch(live, where, 0, content, **{"Upload-Checksum": right}).status_code == 204


def test_a_whole_that_hashes_to_something_else_becomes_no_recording(tmp_path):
    """Oracle: hashlib. Mutation: finishing without comparing shows the recording as ready."""
    sha256 = hashlib.sha256(b"what was sent").hexdigest()
    with serving(tmp_path) as live:
        headers = {**TUS, "Upload-Length": "13", "Upload-Metadata": metadata("room.bag", sha256=sha256)}
        for content, status in ((b"what was SENT", 460), (b"what was sent", 204)):
            where = live.http.post("/api/uploads", headers=headers).headers["location"]
            assert patch(live, where, 0, content).status_code == status
        assert [recording["size_bytes"] for recording in live.http.get("/api/recordings").json()] == [13]


def test_a_disk_that_fills_stops_the_upload_with_a_sentence_and_it_goes_on_afterwards(tmp_path, monkeypatch):
    """Oracle: the bytes sent. Mutation: an OSError that nobody catches is a 500; one that keeps no offset starts anew."""
    content = random.Random(1).randbytes(9 * 2**20)
    room = 5 * 2**20 + 17

    def full(descriptor, block):
        """As much as there is room for, then none."""
        nonlocal room
        if room == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = os.write(descriptor, block[:room])
        room -= written
        return written

    with serving(tmp_path) as live:
        where = create(live, "room.bag", len(content)).headers["location"]
        with monkeypatch.context() as disk:
            # Only this module's: other processes are spoken to by os.write too.
            disk.setattr("app.storage.partial.os", SimpleNamespace(**(vars(os) | {"write": full})))
            answer = patch(live, where, 0, content)
        assert (answer.status_code, answer.json()["error"]["code"]) == (507, "upload.disk_full")
        offset = int(live.http.head(where, headers=TUS).headers["upload-offset"])
        assert offset == 5 * 2**20 + 17
        assert patch(live, where, offset, content[offset:]).status_code == 204
        stored = tmp_path / "recordings" / where.rsplit("/", 1)[-1] / "source.bag"
        assert stored.read_bytes() == content


def test_an_upload_given_up_long_ago_goes_when_the_next_is_announced(tmp_path):
    """Oracle: a clock set back. Mutation: looking only when the server starts."""
    with serving(tmp_path, upload_expiry_days=5) as live:
        where = create(live, "old.bag", 10).headers["location"]
        state = live.services.files.partial(where.rsplit("/", 1)[-1]).state_path
        long_ago = time.time() - 6 * 86400
        os.utime(state, (long_ago, long_ago))
        create(live, "new.bag", 10)
        assert [recording["name"] for recording in live.http.get("/api/recordings").json()] == ["new.bag"]


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
    with pytest.raises(BadRequest, match=r"ends in \.bag, \.mcap"):
        suffix_of("bag")
    assert len(display_name("x" * 500 + ".bag")) == 200
    assert display_name("///") == "recording"
