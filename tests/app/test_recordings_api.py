"""Recordings over HTTP: the server's folder, changes, the timeline."""

from __future__ import annotations

import hashlib
import os
import shutil

import numpy as np
import pytest

from app.fleet.find import find_recordings
from app.recordings.timeline import make_timeline, still_windows
from tests.app.support import world


@pytest.fixture(scope="module")
def folder(shared_live):
    """The server's recordings folder with something in it."""
    root = shared_live.settings.recordings_dir
    (root / "day" / "ros2").mkdir(parents=True)
    (root / "day" / "ros2" / "metadata.yaml").write_text("x")
    (root / "day" / "ros2" / "any.db3").write_text("y")
    (root / "day" / "room.bag").write_bytes(b"12345")
    (root / "notes.txt").write_text("n")
    (root / ".hidden.bag").write_text("h")
    outside = root.parent / "secret.bag"
    outside.write_bytes(b"secret")
    (root / "link.bag").symlink_to(outside)
    return root


@pytest.mark.usefixtures("folder")
def test_the_folder_is_listed_without_hidden_things_and_links_that_lead_out(shared_live):
    """Who has a folder of links is not told that it is empty. Mutations: iterdir without the check shows link.bag; not counted;
    what is hidden counted too.
    """
    top = shared_live.http.get("/api/folder").json()
    assert [(e["name"], e["kind"], e["size_bytes"]) for e in top["entries"]] == [
        ("day", "folder", 0),
        ("notes.txt", "file", 1),
    ]
    day = shared_live.http.get("/api/folder", params={"path": "day"}).json()
    assert [(e["path"], e["kind"]) for e in day["entries"]] == [
        ("day/room.bag", "recording"),
        ("day/ros2", "recording"),
    ]
    assert (top["parent"], day["parent"]) == (None, "")
    assert (top["links_out"], day["links_out"]) == (1, 0)


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("path", "code"),
    [
        ("..", "folder.outside"),
        ("day/../../secret.bag", "folder.outside"),
        ("/etc", "folder.outside"),
        ("link.bag", "folder.outside"),
        ("nowhere", "folder.not_found"),
        ("a\x00b", "folder.not_found"),
    ],
)
def test_no_path_leads_out_of_the_folder(shared_live, path, code):
    """Mutation: comparing text instead of resolved paths lets day/../../ out."""
    answer = shared_live.http.get("/api/folder", params={"path": path})
    assert answer.json()["error"]["code"] == code
    opened = shared_live.http.post("/api/recordings", json={"folder_path": path})
    assert opened.status_code in {403, 404}


def test_what_a_recording_is_is_one_question_at_every_door(shared_live, folder):
    """The same names are listed, opened, uploaded and found by calibrate-many. Oracle: what the command line reads.

    Seen: `room.bag.active`, compressed files and folders without a list taken by the command line alone. Mutations: a list of
    suffixes of the door's own; folders asked for a metadata.yaml alone.
    """
    root = folder / "doors"
    names = [
        "a.bag.active",
        "B.BAG",
        "c.mcap.zstd",
        "d.db3.zst",
        "e.tar.xz",
        "f.tar.bz2",
        "run/run_0.db3",
        "run/run_1.db3",
    ]
    for name in (*names, "notes.txt", "day/monday.bag"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(b"-")
    listed = shared_live.http.get("/api/folder", params={"path": "doors"}).json()["entries"]
    kinds = {entry["name"]: entry["kind"] for entry in listed}
    one_each = {name.partition("/")[0] for name in names}
    assert kinds == dict.fromkeys(one_each, "recording") | {"notes.txt": "file", "day": "folder"}
    assert {path.relative_to(root).as_posix() for path in find_recordings(root)} == one_each | {"day/monday.bag"}
    for name in [*sorted(one_each), "day"]:  # a folder with one bag is that bag, as on the command line
        opened = shared_live.http.post("/api/recordings", json={"folder_path": f"doors/{name}"})
        assert opened.status_code == 201, opened.text
        shared_live.http.delete(f"/api/recordings/{opened.json()['id']}")
    for name in one_each - {"run"}:
        shared_live.http.delete(f"/api/recordings/{shared_live.upload(name)}")
    refused = shared_live.http.post("/api/recordings", json={"folder_path": "doors"})
    assert (refused.status_code, refused.json()["error"]["code"]) == (404, "folder.no_recording")
    assert "holds 4 recordings" in refused.json()["error"]["text"]
    shutil.rmtree(root)


def test_a_bag_folder_whose_files_lead_out_is_not_opened(shared_live, folder):
    """Seen: listed as a recording, and read. Oracle: what the documents say of links. Mutation: files in it not asked."""
    trick = folder / "trick"
    trick.mkdir()
    (trick / "metadata.yaml").write_text("relative_file_paths:\n  - trick_0.db3\n")
    (trick / "trick_0.db3").symlink_to(folder.parent / "secret.bag")
    entries = shared_live.http.get("/api/folder").json()["entries"]
    assert next(entry["kind"] for entry in entries if entry["name"] == "trick") == "folder"
    assert shared_live.http.get("/api/folder", params={"path": "trick"}).json()["links_out"] == 1
    refused = shared_live.http.post("/api/recordings", json={"folder_path": "trick"})
    assert (refused.status_code, refused.json()["error"]["code"]) == (403, "folder.outside")
    (trick / "trick_0.db3").unlink()
    (trick / "trick_0.db3").symlink_to(folder / "day" / "room.bag")  # within the folder it may
    opened = shared_live.http.post("/api/recordings", json={"folder_path": "trick"})
    assert opened.status_code == 201
    home = f"/api/recordings/{opened.json()['id']}"
    shared_live.wait(lambda: shared_live.http.get(home).json()["state"] == "ready")
    (trick / "trick_0.db3").unlink()
    (trick / "trick_0.db3").symlink_to(folder.parent / "secret.bag")  # nor is what is put in its place
    for again in (
        shared_live.http.post(f"{home}/jobs", json={"kind": "inspect"}),
        shared_live.http.patch(home, json={"range_max_m": 50}),
    ):
        assert (again.status_code, again.json()["error"]["code"]) == (403, "folder.outside")
    shared_live.http.delete(home)
    shutil.rmtree(trick)


@pytest.mark.usefixtures("folder")
def test_a_recording_of_the_folder_is_opened_in_place_and_survives_its_entry(shared_live, folder):
    """Mutation: deleting the source of a folder recording."""
    made = shared_live.http.post("/api/recordings", json={"folder_path": "day/room.bag"}).json()
    assert (made["name"], made["origin"], made["size_bytes"]) == ("room.bag", "folder", 5)
    shared_live.wait(lambda: shared_live.job_states(made["id"]).get("planes") == "done")
    assert shared_live.http.delete(f"/api/recordings/{made['id']}").status_code == 204
    assert (folder / "day" / "room.bag").read_bytes() == b"12345"


@pytest.mark.parametrize(("path", "inside"), [("room.bag", ""), ("room_ros2", "any.mcap")])
def test_planes_of_a_source_that_changed_underneath_are_not_shown(shared_live, folder, path, inside):
    """Also of a folder, whose own time stays when one of its files is written. Oracle: the answer before.

    Mutations: the file's time left out of the key; a folder's own time believed; files that nobody touched looked at, so
    that an upgrade forgets what was edited.
    """
    path = f"changing/{path}"
    (folder / path / inside).parent.mkdir(parents=True, exist_ok=True)
    (folder / path / inside).write_bytes(b"12345")
    made = shared_live.http.post("/api/recordings", json={"folder_path": path}).json()
    shared_live.wait(lambda: shared_live.job_states(made["id"]).get("planes") == "done")
    url = f"/api/recordings/{made['id']}/planes"
    assert shared_live.http.get(url).status_code == 200
    record = shared_live.services.recordings.get(made["id"])
    stat = (folder / path).stat()
    key = f"1|{folder / path}|{stat.st_size}|{stat.st_mtime_ns}|{record.read_settings_json}"
    assert shared_live.services.files.cache_key(record) == hashlib.sha256(key.encode()).hexdigest()[:32]
    with (folder / path / inside).open("ab") as file:
        file.write(b"z")
    assert shared_live.http.get(url).json()["error"]["code"] == "recording.source_changed"
    shared_live.http.delete(f"/api/recordings/{made['id']}")
    shutil.rmtree(folder / "changing")


@pytest.fixture
def replaced(shared_live, folder):
    """A recording of the folder with a plane that somebody renamed, and a solve of it; then its file is replaced."""
    path = folder / "room_replaced.bag"
    path.write_bytes(b"the old one")
    made = shared_live.http.post("/api/recordings", json={"folder_path": path.name}).json()
    home = f"/api/recordings/{made['id']}"
    both = {"inspect": "done", "planes": "done"}
    shared_live.wait(lambda: shared_live.job_states(made["id"]) == both)
    rename = {"op": "rename", "index": 0, "name": "MINE"}
    assert shared_live.http.post(f"{home}/planes/operations", json=rename).status_code == 200
    solved = shared_live.start(made["id"])
    assert shared_live.finish(solved)["state"] == "done"
    written_ns = path.stat().st_mtime_ns
    path.write_bytes(b"a new one, longer")
    yield made["id"], home, path, written_ns, solved
    shared_live.http.delete(home)
    path.unlink()


def test_a_source_that_was_replaced_is_told_at_every_door_and_nothing_chosen_is_lost(shared_live, replaced):
    """Oracle: the old file put back, with its time, has its planes as they were left.

    Mutations: the source not looked at: a solve answers for the new file, without the planes; its state left as it was;
    the stamp of the new file taken when it is noticed.
    """
    recording_id, home, path, written_ns, _ = replaced
    http, said = shared_live.http, "recording.source_changed"
    shown = http.get(home).json()
    assert (shown["state"], shown["error"]["code"], shown["verdict"]) == ("failed", said, "good")
    listed = next(one for one in http.get("/api/recordings").json() if one["id"] == recording_id)
    assert listed["error"]["code"] == said
    audit = {"extrinsic": "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1"}
    answers = [
        http.get(f"{home}/planes"),
        http.post(f"{home}/planes/operations", json={"op": "undo"}),
        http.get(f"{home}/timeline"),
        http.post(f"{home}/jobs", json={"kind": "solve"}),
        http.post(f"{home}/jobs", json={"kind": "planes"}),
        http.post(f"{home}/audits", json=audit),
    ]
    assert [(answer.status_code, answer.json()["error"]["code"]) for answer in answers] == [(409, said)] * 6
    assert "inspected again" in answers[0].json()["error"]["text"]
    path.write_bytes(b"the old one")
    os.utime(path, ns=(written_ns, written_ns))
    assert http.get(home).json()["state"] == "ready"
    assert http.get(f"{home}/planes").json()["patches"][0]["name"] == "MINE"


def test_what_was_put_in_a_sources_place_is_inspected_anew_and_old_solves_are_not_run_on_it(shared_live, replaced):
    """Oracle: the new file's size; the name that a person gave a plane is of the old file.

    Mutations: planes not looked for; the size left; a solve of the old file's planes run again on the new file.
    """
    recording_id, home, path, _, solved = replaced
    queued = shared_live.start(recording_id, kind="inspect")
    assert shared_live.finish(queued)["state"] == "done"
    shared_live.wait(lambda: shared_live.job_states(recording_id)["planes"] == "done")
    shown = shared_live.http.get(home).json()
    assert (shown["state"], shown["error"], shown["size_bytes"]) == ("ready", None, path.stat().st_size)
    names = [plane["name"] for plane in shared_live.http.get(f"{home}/planes").json()["patches"]]
    assert names and "MINE" not in names
    again = shared_live.http.post(f"/api/jobs/{solved}/retry")
    assert (again.status_code, again.json()["error"]["code"]) == (409, "job.read_otherwise")
    assert shared_live.finish(shared_live.start(recording_id))["state"] == "done"


def test_a_failed_inspection_is_tried_again_on_what_was_put_in_its_place(shared_live, folder):
    """As the page's button does. Mutation: retrying asks for the same source."""
    path = folder / "broken_then_mended.bag"
    path.write_bytes(b"porridge")
    made = shared_live.http.post("/api/recordings", json={"folder_path": path.name}).json()
    shared_live.wait(lambda: shared_live.job_states(made["id"]).get("inspect") == "failed")
    path.write_bytes(b"porridge again")
    inspection = next(job for job in shared_live.services.jobs.records_of(made["id"]) if job.kind == "inspect")
    assert shared_live.http.post(f"/api/jobs/{inspection.id}/retry").status_code == 201
    shared_live.wait(lambda: shared_live.http.get(f"/api/recordings/{made['id']}").json()["state"] == "failed")
    assert shared_live.http.get(f"/api/recordings/{made['id']}").json()["error"]["code"] == "recording.unreadable"
    shared_live.http.delete(f"/api/recordings/{made['id']}")
    path.unlink()


def test_a_changed_read_setting_inspects_again_and_a_name_does_not(shared_live):
    """Mutation: comparing after saving never inspects again."""
    recording_id = shared_live.ready()
    url = f"/api/recordings/{recording_id}"
    hold = shared_live.services.files.recording(recording_id) / "hold"
    hold.touch()
    assert shared_live.http.patch(url, json={"name": " lab 3/4\t"}).json()["name"] == "lab 3/4"
    blank = shared_live.http.patch(url, json={"name": " \u200b"})
    assert (blank.status_code, blank.json()["error"]["code"]) == (422, "recording.name")
    assert shared_live.http.get(url).json()["name"] == "lab 3/4"
    assert shared_live.job_states(recording_id) == {"inspect": "done", "planes": "done"}
    changed = shared_live.http.patch(url, json={"imu_topic": "/imu2", "start_s": 1.5}).json()
    assert (changed["read_settings"]["imu_topic"], changed["state"]) == ("/imu2", "inspecting")
    assert shared_live.http.patch(url, json={"imu_topic": None}).json()["read_settings"]["imu_topic"] is None
    assert shared_live.http.patch(url, json={"end_s": 1.0}).json()["error"]["code"] == "recording.span"
    assert shared_live.http.patch(url, json={"lidar": "x"}).status_code == 422
    assert shared_live.http.get(f"{url}/planes").json()["error"]["code"] == "planes.not_proposed"
    hold.unlink()


def test_the_timeline_shows_rates_in_degrees_and_where_it_is_still(shared_live):
    """Oracle: the world's constant turn and its half second of rest. Mutation: radians."""
    recording_id = shared_live.ready()
    timeline = shared_live.http.get(f"/api/recordings/{recording_id}/timeline").json()
    turning = [v for t, v in zip(timeline["t_s"], timeline["gyro_norm_deg_s"], strict=True) if t > 0.6]
    np.testing.assert_allclose(turning, np.degrees(world.TURN_RAD_S), rtol=1e-3)
    np.testing.assert_allclose(timeline["scan_t_s"], 0.5 + 0.1 * np.arange(world.N_SCANS), atol=1e-3)
    assert timeline["scan_points"] == [1500] * world.N_SCANS


def test_the_list_is_newest_first_and_leaves_the_reports_out(shared_live):
    """Oracle: the single readings. Mutation: listing with reports: megabytes for a page of names."""
    older, newer = shared_live.ready(), shared_live.ready()
    listed = shared_live.http.get("/api/recordings").json()
    assert [recording["id"] for recording in listed[:2]] == [newer, older]
    single = shared_live.http.get(f"/api/recordings/{newer}").json()
    assert single["report"]["verdict"] == "good"
    assert listed[0] == {**single, "report": None}


def test_times_count_from_the_whole_recordings_start():
    """Mutation: forgetting start_s moves the strip under the span that was chosen on it."""
    recording = world.make_recording()
    plain, moved = make_timeline(recording, start_s=0.0), make_timeline(recording, start_s=7.0)
    np.testing.assert_allclose(np.array(moved.t_s) - plain.t_s, 7.0, atol=1e-3)
    np.testing.assert_allclose(np.array(moved.scan_t_s) - plain.scan_t_s, 7.0, atol=1e-3)


def test_still_spans_are_where_neither_sensor_varies():
    """Oracle: noise switched on between 3 s and 5 s. Mutation: looking at the gyroscope only finds 10 s of rest."""
    rng = np.random.default_rng(0)
    t_s = np.arange(0, 10, 0.01)
    gyro, accel = rng.normal(0, 0.002, (1000, 3)), rng.normal(0, 0.02, (1000, 3)) + np.array([0, 0, 9.8])
    accel[300:500] += rng.normal(0, 2.0, (200, 3))
    spans = still_windows(t_s, gyro, accel)
    np.testing.assert_allclose([(s.start_s, s.end_s) for s in spans], [(0, 3), (5, 9.99)], atol=0.011)


@pytest.mark.usefixtures("folder")
def test_names_that_are_no_names_are_answered(shared_live, folder):
    """Mutation: asking the file system for a name of 5000 letters, or putting bytes that are no text into JSON: a 500."""
    (folder / "day" / os.fsdecode(b"r\xff\xfe.bag")).write_bytes(b"x")
    for path in ("x" * 5000, "day/" + "y" * 5000, "a/" * 3000):
        assert shared_live.http.get("/api/folder", params={"path": path}).status_code == 404
        assert shared_live.http.post("/api/recordings", json={"folder_path": path}).status_code == 404
    entries = shared_live.http.get("/api/folder", params={"path": "day"}).json()["entries"]
    assert ("r\N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER}.bag", "file") in [
        (e["name"], e["kind"]) for e in entries
    ]


def test_a_number_too_long_to_be_one_starts_an_event_stream_anew(shared_live):
    """Mutation: int() of 5000 digits is a ValueError and a 500."""
    recording_id = shared_live.ready()
    jobs = shared_live.http.get(f"/api/recordings/{recording_id}/jobs").json()
    path = f"/api/jobs/{jobs[0]['id']}/events"
    found = shared_live.events(path, until=lambda _: True, headers={"Last-Event-ID": "9" * 5000})
    assert found[0][0] == "0"


def test_who_has_to_look_again_and_leaves_at_once_misses_nothing_afterwards(live):
    """The first change was lost: a resync before any message had its number. Oracle: two changes made. Mutations: messages
    counted from 0, whose resync has no number before it; a resync numbered as the message to come.
    """
    recording_id = live.ready()
    path, ends = f"/api/recordings/{recording_id}/events", {"planes-changed", "resync"}
    for lost in ("deadbeef-7", "deadbeef-7"):  # before any message, and after some
        ((last, told),) = live.events(path, until=lambda _: True, headers={"Last-Event-ID": lost})
        assert told == {"event": "resync"}
        live.http.patch(f"/api/recordings/{recording_id}", json={"name": "hall"})
        live.http.post(f"/api/recordings/{recording_id}/planes/operations", json={"op": "toggle", "index": 0})
        missed = live.events(path, until=lambda told: told["event"] in ends, headers={"Last-Event-ID": last})
        assert [told["event"] for _, told in missed] == ["recording-changed", "planes-changed"]
