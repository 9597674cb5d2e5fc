"""The command that repeats a run names the recording as who runs it finds it, whatever people call it on the screen."""

from __future__ import annotations

import shlex

import httpx2
import pytest

from app.cli.parser import build_parser
from app.storage.database import open_database
from app.storage.store import RecordingStore
from tests.app.support.live import serving

TOKEN = "correct-horse-battery"


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """A server with a token and a folder of recordings, and that folder."""
    root = tmp_path_factory.mktemp("secret-place") / "recordings"
    (root / "day one").mkdir(parents=True)
    (root / "day one" / "room.bag").write_bytes(b"12345")
    with serving(tmp_path_factory.mktemp("house"), recordings_dir=root, token=TOKEN) as live:
        yield live, root


def solved(live, recording_id):
    """A solve of the recording, once it has ended."""
    live.wait(lambda: live.job_states(recording_id).get("planes") == "done")
    live.wait(lambda: live.job_states(recording_id).get("inspect") == "done")
    job_id = live.start(recording_id)
    assert live.finish(job_id)["state"] == "done"
    return job_id


def command(asking, job_id):
    """Its words, and the notes."""
    told = asking.get(f"/api/results/{job_id}/command").json()
    return shlex.split(told["text"]), told["notes"]


@pytest.mark.parametrize("name", ["room of 'mine'; rm -rf $HOME.bag", "room.mcap", "-rooms.bag"])
def test_an_upload_is_named_as_it_came(house, name):
    """Renamed before its solve and after it. Oracle: the command line's own parser. Mutations: the name on the screen; the name
    that the document has; a dash at the beginning left, which is an option then.
    """
    live, _ = house
    recording_id = live.upload(name)
    live.http.patch(f"/api/recordings/{recording_id}", json={"name": "the hall"})
    job_id = solved(live, recording_id)
    live.http.patch(f"/api/recordings/{recording_id}", json={"name": "the other hall"})
    words, notes = command(live.http, job_id)
    assert str(build_parser().parse_args(words[1:]).recording) == name
    assert notes == []


def test_one_of_the_servers_folder_is_named_by_its_path_in_it(house):
    """Oracle: the path that it was opened by. Mutations: the base name; the server's own path; a path of a folder that is not
    offered any more.
    """
    live, root = house
    made = live.http.post("/api/recordings", json={"folder_path": "day one/room.bag"}).json()
    live.http.patch(f"/api/recordings/{made['id']}", json={"name": "the hall"})
    job_id = solved(live, made["id"])
    words, (note,) = command(live.http, job_id)
    assert words[2] == "day one/room.bag"
    assert "folder of recordings" in note
    everything = (
        live.http.get(f"/api/results/{job_id}/command").text + live.http.get(f"/api/results/{job_id}/report").text
    )
    assert "secret-place" not in everything
    assert "day one/room.bag" in everything
    elsewhere = live.services.folder._root
    live.services.folder._root = root / "day one" / "none"
    words, (note,) = command(live.http, job_id)
    live.services.folder._root = elsewhere
    assert words[2] == "room.bag"
    assert "put its path before" in note


def test_a_guest_is_told_the_name_and_no_folder(house):
    """Mutations: the path told to whoever has a link, by the command or by the report."""
    live, root = house
    (root / "of a customer").mkdir()
    (root / "of a customer" / "room.bag").write_bytes(b"12345")
    made = live.http.post("/api/recordings", json={"folder_path": "of a customer/room.bag"}).json()
    live.http.patch(f"/api/recordings/{made['id']}", json={"name": "the hall"})
    job_id = solved(live, made["id"])
    link = live.http.post(f"/api/recordings/{made['id']}/share", json={"hours": 1}).json()["path"]
    with httpx2.Client(base_url=live.origin, trust_env=False, timeout=20) as guest:
        guest.get(link)
        words, notes = command(guest, job_id)
        report = guest.get(f"/api/results/{job_id}/report")
    assert (words[2], notes) == ("the hall", [])
    assert report.status_code == 200
    assert "of a customer" not in report.text


def test_a_sample_is_told_with_how_it_is_made(house):
    """Oracle: the command line's own parser. Mutations: no word of it; another seed than the sample's."""
    live, _ = house
    made = live.http.post("/api/recordings", json={"sample": "paper-normal"}).json()
    words, (note,) = command(live.http, solved(live, made["id"]))
    make = build_parser().parse_args(shlex.split(note.partition(": ")[2])[1:])
    assert words[2] == str(make.out) == "paper-normal.bag"
    assert (make.scenario, make.seed) == ("paper-normal", 1)


def test_where_the_name_was_not_kept_the_command_says_so(house):
    """As a recording of an earlier version is. Mutation: the name on the screen told for the file's."""
    live, _ = house
    recording_id = live.upload("room.bag")
    job_id = solved(live, recording_id)
    with live.services._engine.begin() as connection:
        connection.exec_driver_sql("UPDATE recordings SET file_name = '' WHERE id = ?", (recording_id,))
    words, (note,) = command(live.http, job_id)
    assert words[2] == "room.bag"
    assert "put its own name there" in note


def test_a_store_of_before_has_no_names_of_files(tmp_path):
    """Oracle: the row. Mutation: today's name taken for it."""
    url = f"sqlite:///{tmp_path / 'a.sqlite'}"
    engine = open_database(url)
    with engine.begin() as connection:
        for column in ("file_name", "source_stamp"):
            connection.exec_driver_sql(f"ALTER TABLE recordings DROP COLUMN {column}")
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '0003'")
        connection.exec_driver_sql(
            "INSERT INTO recordings (id, name, origin, source, scenario, size_bytes, state, read_settings_json, created_at) "
            "VALUES ('1', 'the hall', 'upload', 's', '', 1, 'ready', '{}', '2026-01-01T00:00:00.000000+00:00')"
        )
    engine.dispose()
    engine = open_database(url)
    (kept,) = RecordingStore(engine).all_newest_first()
    engine.dispose()
    assert (kept.name, kept.file_name) == ("the hall", "")
