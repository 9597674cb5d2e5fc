"""Many recordings: found, named, run in processes and on a cluster, kept, taken up again, and none lost."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest

from app.cli import main as cli
from app.cli import many
from app.fleet.campaign import ASIDE, run_fleet, take_up
from app.fleet.executors import LocalProcesses
from app.fleet.find import document_names, find_recordings
from app.fleet.made_of import CHANGED, asked_beside, stored
from app.fleet.orders import TRIES, FleetOrder, FleetOutcome
from app.fleet.summary import NAME, add_row, read_rows, row_of
from calib_core import api
from calib_core.errors import InputError
from calib_core.result import CalibrationResult, Message
from calib_core.settings import CalibrateSettings, Prior, ReadSettings
from calib_core.simulate import simulate
from tests.app.support.cluster import dask_processes
from tests.app.support.processes import is_alive
from tests.core.exporters.results import make_result
from tests.core.full.conftest import SHORT

FAKE = "tests.app.support.fake_fleet:run"
PATIENCE_S = 60.0
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def hall(tmp_path):
    """A folder with the documents that the fake calibration gives."""
    for status in ("calibrated", "weak", "refused"):
        result = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), 4_000_000, status=status)
        if status == "refused":
            wrong = Message(code="motion.none", level="error", text="It stands still; record motion.")
            result = result.model_copy(update={"messages": [wrong]})
        result.provenance.settings.update(CalibrateSettings().model_dump(mode="json"))
        (tmp_path / f"{status}.document").write_text(result.to_json())
    return tmp_path


def orders(folder, *names, **more):
    return [FleetOrder(name=name, recording=folder / f"{name}.bag", **more) for name in names]


def run_here(asked, folder, workers=2):
    return {row.name: row for row in run_fleet(asked, folder, LocalProcesses(workers, FAKE), lambda _: None)}


def wait_for(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_folder_and_a_list_are_looked_through(tmp_path):
    """Mutations: do not descend; take a ROS 2 folder's own files for recordings; count a path of the list twice; the mark with
    which some editors begin a file taken for a part of the first path."""
    for name in ("b.bag", "deep/a.mcap", "run/metadata.yaml", "run/run_0.db3", "notes.txt", ".hidden.bag"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert find_recordings(tmp_path) == [tmp_path / "b.bag", tmp_path / "deep" / "a.mcap", tmp_path / "run"]
    listed = tmp_path / "deep" / "list.txt"
    listed.write_text(f"\ufeff../run\n# two of them\n\n{tmp_path / 'gone.bag'}\n../run\n")
    assert find_recordings(listed) == [tmp_path / "deep" / ".." / "run", tmp_path / "gone.bag"]
    for wrong, words in ((tmp_path / "b.bag", "one recording"), (tmp_path / "none", "found nothing")):
        with pytest.raises(InputError, match=words):
            find_recordings(wrong)


def test_links_are_followed_and_each_recording_is_found_once(tmp_path):
    """Mutations: links not entered; a circle entered for ever; one that leads nowhere left out; a file counted again under a
    link's name, or named by the link though its own name is there, or is reached by a link itself.
    """
    folder, other = tmp_path / "folder", tmp_path / "other"
    for path in (folder / "deep" / "z.bag", other / "far.mcap"):
        path.parent.mkdir(parents=True)
        path.touch()
    (folder / "aside").symlink_to(other)
    (folder / "deep" / "up").symlink_to(folder)
    (other / "back").symlink_to(folder)
    (folder / "a.bag").symlink_to(folder / "deep" / "z.bag")
    (folder / "gone.bag").symlink_to(tmp_path / "nowhere.bag")
    (folder / "round.bag").symlink_to(folder / "round.bag")
    (folder / "gone.txt").symlink_to(tmp_path / "nowhere.txt")
    found = [folder / "deep" / "z.bag", folder / "gone.bag", folder / "round.bag", folder / "aside" / "far.mcap"]
    assert find_recordings(folder) == found
    assert find_recordings(folder / "aside") == [
        folder / "aside" / "far.mcap",
        *(folder / "aside" / "back" / path for path in ("deep/z.bag", "gone.bag", "round.bag")),
    ]


def test_a_recording_that_a_list_spells_twice_is_run_once(tmp_path):
    """Mutation: paths compared as they are written."""
    (tmp_path / "deep").mkdir()
    (tmp_path / "room.bag").touch()
    listed = tmp_path / "list.txt"
    listed.write_text("deep/../room.bag\nroom.bag\n./deep/../deep/gone.bag\ndeep/gone.bag\n")
    assert find_recordings(listed) == [tmp_path / "room.bag", tmp_path / "deep" / "gone.bag"]
    listed.write_text("deep/../room.bag\n")
    assert find_recordings(listed) == [tmp_path / "deep" / ".." / "room.bag"]


def test_a_list_may_come_through_a_pipe(tmp_path, monkeypatch):
    """It was told to be one recording. Mutations: a pipe is no list; its paths are taken from /dev/fd."""
    monkeypatch.chdir(tmp_path)
    reads, writes = os.pipe()
    os.write(writes, b"room.bag\n/else/where.bag\n")
    os.close(writes)
    assert find_recordings(Path(f"/dev/fd/{reads}")) == [tmp_path / "room.bag", Path("/else/where.bag")]
    os.close(reads)


def test_no_two_documents_have_one_name_and_names_stay():
    """Mutations: forget what is taken; compare letters by case; give a recording a new name in the second run."""
    paths = [Path(text) for text in ("/a/room.bag", "/b/room.mcap", "/b/ROOM.bag", "/c/b/room.db3", "/a/summary.bag")]
    first = document_names(paths, {})
    assert first == dict(zip(paths, ["room", "b-room", "ROOM-2", "room-3", "a-summary"], strict=True)) | {
        paths[2]: first[paths[2]]
    }
    assert len({name.casefold() for name in first.values()}) == len(paths)
    assert document_names([Path("/0/room.bag"), *paths], first) == first | {Path("/0/room.bag"): "0-room"}


def test_every_recording_has_its_row_and_its_document(hall):
    """Mutations: no document for a refused one; one for what could not be read; a limit that nobody keeps."""
    names = ("room", "refused", "weak", "broken", "defect")
    rows = run_here(orders(hall, *names), hall)
    assert {name: row.verdict for name, row in rows.items()} == {
        "room": "calibrated",
        "refused": "refused",
        "weak": "weak",
        "broken": "failed",
        "defect": "failed",
    }
    assert sorted(path.stem for path in hall.glob("*.json")) == ["refused", "room", "weak"]
    written = CalibrationResult.model_validate_json((hall / "room.json").read_text())
    assert rows["room"].rotation_std_z_deg == written.uncertainty.rotation_std_deg[2]
    assert rows["room"].translation_std_y_m == written.uncertainty.translation_std_m[1]
    assert (rows["refused"].code, rows["refused"].sentence) == ("motion.none", "It stands still; record motion.")
    assert rows["broken"].code == "recording.unreadable"
    assert "RuntimeError: no such luck" in rows["defect"].sentence
    with (hall / NAME).open(newline="") as file:
        table = {line["name"]: line for line in csv.DictReader(file)}
    assert set(table) == set(names)
    assert float(table["room"]["time_offset_std_s"]) == written.uncertainty.time_offset_std_s
    assert float(table["room"]["yaw_deg"]) == written.T_imu_lidar.euler_xyz_deg[2]
    assert float(table["room"]["translation_y_m"]) == written.T_imu_lidar.translation_m[1]
    assert float(table["room"]["time_offset_s"]) == written.time_offset_s
    assert table["refused"]["translation_y_m"] == ""


def test_limits_of_time_and_memory_are_kept_and_said(hall):
    """Mutations: no time limit; no memory limit (the machine gives 8 GB); the slow one's process lives on."""
    asked = [*orders(hall, "slow", time_limit_s=3.0), *orders(hall, "greedy", memory_bytes=2 * 10**9)]
    rows = run_here(asked, hall)
    assert (rows["slow"].code, rows["greedy"].code) == ("job.time", "job.memory")
    assert "--time-limit-s" in rows["slow"].sentence
    assert "2000 MB" in rows["greedy"].sentence
    if (hall / "slow.started").exists():
        assert not is_alive(int((hall / "slow.started").read_text()))


def test_what_is_filled_counts_not_what_is_allocated_and_nothing_hangs(hall):
    """A numerical library that is refused a buffer asks again for ever; a thread without a stack is a RuntimeError.

    Mutations: nobody looks at what a process takes (hungry is calibrated); RLIMIT_DATA at the limit (roomy fails); its being
    near not looked at (stubborn runs into the time); any RuntimeError a defect; causes not looked at; or without a bound too.
    """
    most = {"memory_bytes": 500 * 10**6, "time_limit_s": PATIENCE_S}
    bounded = orders(hall, "hungry", "roomy", "stubborn", "threads", "caused", **most)
    rows = run_here([*bounded, *orders(hall, "caused-free")], hall)
    assert {name: row.code for name, row in rows.items()} == {
        "hungry": "job.memory",
        "roomy": "",
        "stubborn": "job.memory",
        "threads": "job.memory",
        "caused": "job.memory",
        "caused-free": "defect",
    }
    assert rows["hungry"].sentence.startswith(f"{hall / 'hungry.bag'} needed more than the 500 MB allowed: allow more")


def test_a_bound_with_which_nothing_can_be_read_is_refused_at_once(hall, capsys):
    """Mutation: any whole number."""
    command = ["calibrate-many", str(hall), "--output", str(hall / "out"), "--memory-limit-mb"]
    assert cli.run([*command, "20"]) == 2
    assert "expected 200 MB or more" in capsys.readouterr().err
    assert not (hall / "out").exists()


def test_loops_are_compiled_before_the_first_recording_with_a_word(hall, monkeypatch):
    """Mutations: nothing said or compiled here; said where all is compiled; a worker that compiles in a recording's time."""
    from app.fleet import cluster, executors

    done, told = [], []
    monkeypatch.setattr(executors, "compile_once", lambda: done.append("compiled"))
    for is_compiled in (True, False):
        monkeypatch.setattr(executors, "is_compiled", lambda known=is_compiled: known)
        LocalProcesses(1).prepare(lambda code, text: told.append((code, text)))
    assert done == ["compiled"]
    assert told == [("fleet.compiling", "Compiling the program's loops for this machine (once, about a minute)")]

    distributed = pytest.importorskip("distributed")
    worker = SimpleNamespace(name="w", get_current_task=lambda: "key")
    monkeypatch.setattr(distributed, "get_worker", lambda: worker)
    monkeypatch.setattr(cluster, "compile_once", lambda: done.append("compiled there"))
    monkeypatch.setattr(cluster, "counted", lambda *_: done.append("run") or "{}")
    order = orders(hall, "room")[0].model_dump_json()
    cluster.run_on_worker(order, cluster.CALIBRATE, version=cluster.__version__, counter="")
    assert done == ["compiled", "compiled there", "run"]


def test_a_killed_process_loses_no_recording(hall):
    """Mutations: do not run what was lost again; run it for ever."""
    asked = orders(hall, "sleepy", "room", "doomed")
    killed = []

    def kill():
        wait_for((hall / "sleepy.started").exists)
        killed.append(int((hall / "sleepy.started").read_text()))
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    rows = run_here(asked, hall)
    killer.join()
    assert killed
    assert (rows["sleepy"].verdict, rows["sleepy"].tries) == ("calibrated", 2)
    assert (rows["doomed"].verdict, rows["doomed"].tries) == ("failed", TRIES)
    assert "signal 9" in rows["doomed"].sentence


def test_a_fleet_goes_on_where_it_stopped(hall):
    """Mutations: believe a row without its document; run again what has one; keep a failed row twice; stop at a torn one."""
    asked = orders(hall, "room", "hall", "broken")
    run_here(asked, hall)
    (hall / "hall.json").unlink()
    with (hall / NAME).open("a") as file:
        file.write("yard,/yard.bag,calib")
    done, ahead, others, _ = take_up(asked, hall)
    assert others == []
    assert [row.name for row in done] == ["room"]
    assert [order.name for order in ahead] == ["hall", "broken"]
    run_here(ahead, hall)
    assert sorted(row.name for row in read_rows(hall)) == ["broken", "hall", "room"]
    (hall / NAME).unlink()
    assert [row.name for row in take_up(asked, hall)[0]] == ["room", "hall"], "documents speak without the table"


def documented_by(order, folder, content=b"bytes"):
    """A document of the order's options and of its recording as it is now, as a calibration leaves it."""
    order.recording.parent.mkdir(exist_ok=True, parents=True)
    order.recording.write_bytes(content)
    result = make_result(np.eye(3), np.array([0.1, 0.2, 0.3]), 4_000_000, status="calibrated")
    result.provenance.settings.update(order.solving.model_dump(mode="json"))
    result.provenance.recording.sha256 = hashlib.sha256(content).hexdigest()
    outcome = FleetOutcome(document=result.to_json())
    (folder / f"{order.name}.json").write_text(outcome.document)
    add_row(folder, row_of(order, outcome, 1, stored(order.recording)))


PRIOR = Prior(axis="tz", value=0.3, std=0.01)


@pytest.mark.parametrize(
    ("solving", "reading", "differs"),
    [
        ({}, {}, ()),
        ({"priors": (PRIOR,)}, {}, ("priors",)),
        ({"method": "paper"}, {}, ("method", "points_per_plane_per_scan", "field_of_view_deg")),
        ({"excluded_spans_s": ((1.0, 2.0),)}, {}, ("excluded_spans_s",)),
        ({"imu_noise": "mti-3"}, {"start_s": 5.0}, ("imu_noise", "start_s")),
        ({}, {"lidar_topic": "/other"}, ("lidar_topic",)),
    ],
)
def test_a_document_of_other_options_is_no_answer_to_these(tmp_path, solving, reading, differs):
    """Either way round, and once it is made with these. Mutations: no `differing_options`; the solve's settings alone, or the
    reading's alone; the document left where it is, with which a run that is stopped has it for its own."""
    plain = orders(tmp_path, "room")[0]
    read = ReadSettings(**reading)
    other = plain.model_copy(
        update={"solving": CalibrateSettings(**solving), "reading": read, "asked": asked_beside(read, None, None)}
    )
    for made, now in ((plain, other), (other, plain), (other, other)):
        folder = tmp_path / f"out-{made is plain}-{now is plain}"
        folder.mkdir()
        documented_by(made, folder)
        left = take_up([now], folder)
        expected = () if made is now else differs
        assert left.others == ([expected] if expected else [])
        assert [order.name for order in left.ahead] == ["room"] * bool(expected)
        assert (folder / "room.json").exists() is not bool(expected)
        assert (folder / ASIDE / "room.json").exists() is bool(expected)
        assert take_up([now], folder).ahead == left.ahead, "stopped before it was run, and called again"


def test_other_planes_or_another_guess_are_other_options(tmp_path):
    """By what is in the files, wherever they lie. Mutations: by their names; the guess left out."""
    planes, again, guess = (tmp_path / name for name in ("planes.json", "copy.json", "guess.json"))
    planes.write_text("a wall")
    again.write_text("a wall")
    guess.write_text("there")
    asked = [asked_beside(ReadSettings(), *files) for files in ((planes, None), (again, None), (planes, guess))]
    assert asked[0] == asked[1] != asked[2]
    again.write_text("a floor")
    assert asked_beside(ReadSettings(), again, None) != asked[0]
    order = orders(tmp_path, "room", asked=asked[0])[0]
    documented_by(order, tmp_path)
    assert take_up([order], tmp_path).ahead == []
    assert take_up([order.model_copy(update={"asked": asked[2]})], tmp_path).others == [("initial_guess",)]


def test_a_table_without_answers_is_given_them(tmp_path):
    """What an earlier version began is gone on with. Mutation: a row kept as it was found."""
    order = orders(tmp_path, "room")[0]
    documented_by(order, tmp_path)
    with (tmp_path / NAME).open(newline="") as file:
        lines = [line[:17] for line in csv.reader(file)]
    assert lines[0][-1] == "recording_written_ns"
    with (tmp_path / NAME).open("w", newline="") as file:
        csv.writer(file).writerows(lines)
    assert take_up([order], tmp_path).ahead == []
    written = CalibrationResult.from_json((tmp_path / "room.json").read_text())
    assert read_rows(tmp_path)[0].yaw_deg == written.T_imu_lidar.euler_xyz_deg[2]


def test_without_the_table_only_what_documents_say_is_believed(tmp_path):
    """Mutation: a document without a row taken for one of any way of reading."""
    order = orders(tmp_path, "room")[0]
    documented_by(order, tmp_path)
    (tmp_path / NAME).unlink()
    assert take_up([order], tmp_path).ahead == []
    (tmp_path / NAME).unlink()
    asked = asked_beside(ReadSettings(start_s=5.0), None, None)
    assert take_up([order.model_copy(update={"asked": asked})], tmp_path).others == [("how it was read",)]


def test_a_recording_that_changed_is_run_again_and_one_that_was_only_touched_is_not(tmp_path, monkeypatch):
    """Mutations: sizes and times are not looked at; another time taken for other bytes; unchanged ones hashed each time."""
    order = orders(tmp_path, "room")[0]
    documented_by(order, tmp_path)
    hashed = []
    fingerprint = api.fingerprint
    monkeypatch.setattr(api, "fingerprint", lambda path: hashed.append(path) or fingerprint(path))
    assert take_up([order], tmp_path).ahead == []
    assert hashed == []
    os.utime(order.recording, ns=(1, 1))
    assert take_up([order], tmp_path).ahead == []
    assert take_up([order], tmp_path).ahead == []
    assert len(hashed) == 1, "the table knows by now"
    order.recording.write_bytes(b"bites")  # as many
    assert take_up([order], tmp_path).others == [(CHANGED,)]
    documented_by(order, tmp_path, b"more bytes")
    order.recording.unlink()
    assert take_up([order], tmp_path).ahead == [], "in an archive by now, and done"


def test_recordings_that_lie_elsewhere_are_not_run_again(tmp_path, monkeypatch):
    """The same bytes under another path: moved with their times, copied without, both folders moved. One of the same name and
    size but of other bytes is another recording, and takes nobody's name. Mutations: names by paths alone; by size alone.
    """
    before, after, out = tmp_path / "before", tmp_path / "after", tmp_path / "out"
    out.mkdir()
    ran = []

    def runs(asked, folder, executor, on_row):
        ran.extend(order.name for order in asked)
        return []

    monkeypatch.setattr(many, "run_fleet", runs)
    for name in ("room", "hall"):
        documented_by(FleetOrder(name=name, recording=before / f"{name}.bag"), out, name.encode())
    command = ["calibrate-many", str(after), "--output", str(tmp_path / "moved"), "--quiet"]
    out.rename(tmp_path / "moved")
    before.rename(after)
    assert cli.run(command) == 0
    assert ran == []
    assert {row.recording for row in read_rows(tmp_path / "moved")} == {
        str(after / "room.bag"),
        str(after / "hall.bag"),
    }
    shutil.copytree(after, before, copy_function=shutil.copyfile)
    command[1] = str(before)
    assert cli.run(command) == 0
    assert ran == []
    (after / "room.bag").write_bytes(b"mood")
    command[1] = str(after)
    assert cli.run(command) == 0
    assert ran == ["after-room"]
    assert (tmp_path / "moved" / "room.json").exists()


def test_it_is_said_how_many_are_run_again_and_why(hall, monkeypatch, capsys):
    """Mutations: said nothing; said where nothing is; the old document taken for the new one's."""
    monkeypatch.setattr(many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
    (hall / "list.txt").write_text("room.bag\nrefused.bag\n")
    command = ["calibrate-many", str(hall / "list.txt"), "--output", str(hall / "out")]
    assert cli.run(command) == cli.run(command) == 0
    assert "run again" not in capsys.readouterr().err
    assert cli.run([*command, "--prior", "tz=0.3+-0.01", "--exclude", "1:2", "--start-s", "2"]) == 0
    said = capsys.readouterr().err.splitlines()
    aside = hall / "out" / ASIDE
    assert said[0] == (
        "2 recordings are run again: other options (excluded_spans_s, priors, start_s); earlier documents are in "
        f"{aside}"
    )
    assert sorted(path.name for path in aside.iterdir()) == ["refused.json", "room.json"]
    assert cli.run([*command, "--log-json"]) == 0
    (told,) = [json.loads(line) for line in capsys.readouterr().err.splitlines() if "fleet.again" in line]
    assert told["text"].startswith("2 recordings are run again: other options (start_s); ")


def test_the_command_runs_what_is_asked_and_says_what_has_no_document(hall, monkeypatch, capsys):
    """Mutations: exit 0 with a missing one; exit 3 with a refused one; run again in the second call; Ctrl-C keeps nothing; a
    page that is left as it was in the middle.
    """
    monkeypatch.setattr(many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
    listed, out = hall / "list.txt", hall / "out"
    listed.write_text("room.bag\nrefused.bag\n")
    command = ["calibrate-many", str(listed), "--output", str(out), "--workers", "2", "--log-json"]
    assert cli.run(command) == 0
    told = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert {(event["event"], event["name"]) for event in told} == {("recording", "room"), ("recording", "refused")}
    assert json.loads((out / "summary.json").read_text())["is_running"] is False
    assert (out / "summary.html").read_text().count('scope="row"') == 2
    stamp = (out / "room.json").stat().st_mtime_ns
    listed.write_text("room.bag\nbroken.bag\n")
    assert cli.run([*command[:-1]]) == 3
    said = capsys.readouterr().err.splitlines()
    assert said[-1] == (
        "unsweep: 1 of 2 recordings has no document; the first is broken: Expected a bag, found porridge in broken.bag; "
        "choose another file."
    )
    assert (out / "room.json").stat().st_mtime_ns == stamp
    assert cli.run([*command, "--scheduler", "tcp://127.0.0.1:1", "--workers", "1"]) == 2


def test_the_table_is_the_same_in_all_three_files_when_less_is_asked(hall, monkeypatch):
    """The folder has the documents still. Oracle: the files, read back. Mutations: those not asked left out of JSON and page, or
    of the CSV; the JSON of the run before left where nothing can be run.
    """
    monkeypatch.setattr(many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
    listed, out = hall / "list.txt", hall / "out"
    for asked, more, code in (
        ("room weak refused", [], 0),
        ("weak", [], 0),
        ("weak broken", [], 3),
        ("weak", [], 0),
        ("weak hall", ["--scheduler", "tcp://127.0.0.1:1", "--workers", "1"], 2),
    ):
        listed.write_text("".join(f"{name}.bag\n" for name in asked.split()))
        assert cli.run(["calibrate-many", str(listed), "--output", str(out), "--quiet", *more]) == code
        names = {row.name for row in read_rows(out)}
        assert names == {"room", "weak", "refused"} | ({"broken"} if "broken" in asked else set())
        told = json.loads((out / "summary.json").read_text())
        assert {facts["name"] for facts in told["recordings"]} == names
        assert (told["done"], told["total"]) == (len(names), len(names) + ("hall" in asked))
        assert (out / "summary.html").read_text().count('scope="row"') == len(names)


def test_a_second_command_for_a_folder_is_refused_while_the_first_is_at_work(hall, monkeypatch, capsys):
    """It dropped the first one's rows and wrote that nothing runs. Mutations: no lock; one that outlives its process."""
    script = (
        "from app.cli import main, many; from app.fleet.executors import LocalProcesses as Local; "
        f"many.LocalProcesses = lambda workers: Local(workers, {FAKE!r}); main.main()"
    )
    monkeypatch.setattr(many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
    (hall / "list.txt").write_text("room.bag\nslow.bag\n")
    words = ["calibrate-many", str(hall / "list.txt"), "--output", str(hall / "out"), "--workers", "2", "--quiet"]
    with subprocess.Popen([sys.executable, "-c", script, *words], cwd=ROOT) as process:
        try:
            wait_for(lambda: (hall / "slow.started").exists() and (hall / "out" / "room.json").exists())
            wait_for(lambda: [row.name for row in read_rows(hall / "out")] == ["room"])
            (hall / "one.txt").write_text("weak.bag\n")
            words[1] = str(hall / "one.txt")
            assert cli.run(words) == 2
            assert f"is at work in {hall / 'out'}: wait until it has ended" in capsys.readouterr().err
            assert [row.name for row in read_rows(hall / "out")] == ["room"]
            assert json.loads((hall / "out" / "summary.json").read_text())["is_running"] is True
        finally:
            process.kill()
    assert cli.run(words) == 0
    assert {row.name for row in read_rows(hall / "out")} == {"room", "weak"}


def test_ctrl_c_ends_the_processes_and_keeps_the_documents(hall):
    """Mutations: leave the children running; write the unfinished one's row; say that nothing was written."""
    # What a shell runs in the background inherits that Ctrl-C is ignored: tests may be.
    script = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from app.cli import main, many; from app.fleet.executors import LocalProcesses as Local; "
        f"many.LocalProcesses = lambda workers: Local(workers, {FAKE!r}); main.main()"
    )
    (hall / "list.txt").write_text("room.bag\nslow.bag\n")
    words = ["calibrate-many", str(hall / "list.txt"), "--output", str(hall / "out"), "--workers", "2"]
    with subprocess.Popen(
        [sys.executable, "-c", script, *words], cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as process:
        wait_for(lambda: (hall / "slow.started").exists() and (hall / "out" / "room.json").exists())
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=PATIENCE_S)[1].splitlines()
    assert process.returncode == 130
    assert "the same command goes on" in said[-1]
    wait_for(lambda: not is_alive(int((hall / "slow.started").read_text())))
    assert [row.name for row in read_rows(hall / "out")] in ([], ["room"])


def begun_by(pid):
    """Processes that a process has started, and those that these have forked."""
    return {child.pid for child in psutil.Process(pid).children(recursive=True)}


def test_a_cluster_gives_the_same_and_a_killed_worker_loses_none(hall):
    """Real scheduler and workers; the one that has the recording is killed in the middle of it.

    Mutations: an executor that does not kill what is taken back; a child that outlives its worker.
    """
    cluster = pytest.importorskip("app.fleet.cluster")
    with dask_processes(hall, 2) as (address, started):
        executor = cluster.DaskCluster(address, FAKE)
        killed = []

        def kill():
            wait_for((hall / "sleepy.started").exists)
            child = int((hall / "sleepy.started").read_text())
            killed.append(child)
            next(process for process in started if child in begun_by(process.pid)).kill()

        killer = threading.Thread(target=kill)
        killer.start()
        rows = {row.name: row for row in run_fleet(orders(hall, "sleepy", "room", "refused"), hall, executor, print)}
        killer.join()
        assert {name: row.verdict for name, row in rows.items()} == {
            "sleepy": "calibrated",
            "room": "calibrated",
            "refused": "refused",
        }
        wait_for(lambda: not is_alive(killed[0]))
        stopping = cluster.DaskCluster(address, FAKE)
        stopping.start(orders(hall, "slow")[0].model_dump_json())
        wait_for((hall / "slow.started").exists)
        stopping.stop()
        wait_for(lambda: not is_alive(int((hall / "slow.started").read_text())))


@pytest.mark.parametrize("allowed", [1, 3])
def test_an_order_that_kills_its_workers_kills_three_and_no_more(hall, monkeypatch, allowed):
    """Real workers, which their nannies start again. dask gives it to the next one by itself, by its own count.

    Mutations: begun not counted, which kills twelve; the count not taken for tries; counted anew where dask gives it up.
    """
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", str(allowed))
    cluster = pytest.importorskip("app.fleet.cluster")
    with dask_processes(hall, 2, nannies=True) as (address, _):
        rows = {
            row.name: row for row in run_fleet(orders(hall, "murder"), hall, cluster.DaskCluster(address, FAKE), print)
        }
    assert (hall / "murder.begun").read_text() == "x" * TRIES
    assert (rows["murder"].verdict, rows["murder"].code, rows["murder"].tries) == ("failed", "job.lost", TRIES)
    assert "--memory-limit-mb" in rows["murder"].sentence


def test_a_worker_of_another_version_ends_the_fleet_before_it_has_an_answer(hall, monkeypatch):
    """Its answers would be in the same table. Mutations: no look at the version; a row of it, and the next one's."""
    cluster = pytest.importorskip("app.fleet.cluster")
    with dask_processes(hall, 1) as (address, _):
        monkeypatch.setattr(cluster, "__version__", "0.0.1")
        with pytest.raises(InputError, match=r"has unsweep .* and the command 0\.0\.1: install the same on both"):
            run_fleet(orders(hall, "room", "weak"), hall, cluster.DaskCluster(address, FAKE), print)
    assert read_rows(hall) == []


def test_a_scheduler_that_is_lost_ends_the_fleet_with_a_sentence_and_it_goes_on(hall):
    """What was finished stays, what ran is ended, the rest is run by the same call with another scheduler.

    Mutations: wait for ever; tell each recording's row that its worker was lost.
    """
    cluster = pytest.importorskip("app.fleet.cluster")
    asked = orders(hall, "room", "slow", "weak")
    with dask_processes(hall, 1) as (address, started):
        done = []

        def lose():
            wait_for(lambda: done and (hall / "slow.started").exists())
            started[0].kill()

        loser = threading.Thread(target=lose)
        loser.start()
        with pytest.raises(InputError, match="scheduler no longer answers"):
            run_fleet(asked, hall, cluster.DaskCluster(address, FAKE), done.append)
        loser.join()
    assert [row.name for row in read_rows(hall)] == ["room"]
    wait_for(lambda: not is_alive(int((hall / "slow.started").read_text())))
    kept, ahead, _, _ = take_up(asked, hall)
    assert ([row.name for row in kept], [order.name for order in ahead]) == (["room"], ["slow", "weak"])


def test_a_scheduler_without_a_worker_says_what_to_start(tmp_path):
    """Nothing would happen, without end. Mutations: said nothing; said with a worker there; "1 workers"."""
    cluster = pytest.importorskip("app.fleet.cluster")
    told = []
    for workers, where in ((0, "0 workers of"), (1, "1 worker of")):
        folder = tmp_path / str(workers)
        folder.mkdir()
        with dask_processes(folder, workers) as (address, _):
            client = cluster.connect(address)
            wait_for(lambda client=client, workers=workers: len(client.nthreads()) == workers)
            client.close()
            executor = cluster.DaskCluster(address, FAKE)
            assert executor.where == f"{where} {address}"
            executor.prepare(lambda code, text: told.append((code, text)))
            executor.stop()
            if not workers:
                assert told[0][0] == "fleet.no_worker"
                assert f"start `dask worker {address} --nworkers 1 --nthreads 1`" in told[0][1]
    assert len(told) == 1


def test_a_scheduler_that_is_not_there_and_dask_that_is_not_installed_are_a_sentence(monkeypatch):
    """Mutations: let dask's own error out; name no way to install it."""
    from app.fleet import cluster

    monkeypatch.setattr(cluster, "_CONNECT_S", 0.3)
    with pytest.raises(InputError, match=r"No dask scheduler answers at tcp://127\.0\.0\.1:9"):
        cluster.DaskCluster("tcp://127.0.0.1:9")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install unsweep\[fleet\]"):
        cluster.DaskCluster("tcp://127.0.0.1:9")


@pytest.mark.slow
def test_simulated_recordings_are_calibrated_on_two_workers(tmp_path, capsys):
    """The whole way: two bags and a path that leads nowhere; settings arrive, and the tables are of all.

    Mutation: an order that forgets its settings.
    """
    simulate(SHORT, tmp_path / "room-1.bag", seed=1)
    shutil.copy(tmp_path / "room-1.bag", tmp_path / "room-2.bag")
    listed, out = tmp_path / "list.txt", tmp_path / "out"
    listed.write_text("room-1.bag\ngone.bag\nroom-2.bag\n")
    command = ["calibrate-many", str(listed), "--output", str(out), "--workers", "2", "--max-rounds", "3"]
    command += ["--points-per-plane-per-scan", "100"]
    assert cli.run(command) == 3
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("unsweep: 1 of 3 recordings has no document; the first is gone: ")
    assert str(tmp_path / "gone.bag") in said[-1]
    table = json.loads((out / "summary.json").read_text())
    assert (table["counts"]["calibrated"], table["counts"]["failed"], table["is_running"]) == (2, 1, False)
    assert (out / "summary.html").read_text().count('<tr class="calibrated">') == 2
    documents = sorted(set(out.glob("*.json")) - {out / "summary.json"})
    results = [CalibrationResult.model_validate_json(path.read_text()) for path in documents]
    assert [result.provenance.recording.name for result in results] == ["room-1.bag", "room-2.bag"]
    for result in results:
        assert result.status == "calibrated"
        assert result.time_offset_s == pytest.approx(SHORT.time_offset_s, abs=1e-3)
        assert result.provenance.settings["max_rounds"] == 3
