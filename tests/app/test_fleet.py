"""Many recordings: run in processes, kept within their limits, tabled, and none lost."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.cli import calibrate_many
from app.cli import main as cli
from app.fleet.executors import LocalProcesses
from app.fleet.orders import TRIES
from app.fleet.summary import NAME, read_rows
from calib_core.result import CalibrationResult
from calib_core.simulate import simulate
from tests.app.support.fleet import FAKE, PATIENCE_S, orders, run_here, wait_for
from tests.app.support.processes import is_alive
from tests.core.full.conftest import SHORT

ROOT = Path(__file__).resolve().parents[2]


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
    cluster.calibrate_on_worker(order, cluster.CALIBRATE, version=cluster.__version__, counter="")
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


def test_the_command_runs_what_is_asked_and_says_what_has_no_document(hall, monkeypatch, capsys):
    """Mutations: exit 0 with a missing one; exit 3 with a refused one; run again in the second call; Ctrl-C keeps nothing; a
    page that is left as it was in the middle.
    """
    monkeypatch.setattr(calibrate_many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
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
    monkeypatch.setattr(calibrate_many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
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
        "from app.cli import calibrate_many, main; from app.fleet.executors import LocalProcesses as Local; "
        f"calibrate_many.LocalProcesses = lambda workers: Local(workers, {FAKE!r}); main.main()"
    )
    monkeypatch.setattr(calibrate_many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
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
        "from app.cli import calibrate_many, main; from app.fleet.executors import LocalProcesses as Local; "
        f"calibrate_many.LocalProcesses = lambda workers: Local(workers, {FAKE!r}); main.main()"
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
