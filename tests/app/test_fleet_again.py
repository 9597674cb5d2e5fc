"""A fleet taken up again: what has its answer already, what is run once more, and why."""

from __future__ import annotations

import csv
import hashlib
import json
import os
import shutil

import numpy as np
import pytest

from app.cli import calibrate_many
from app.cli import main as cli
from app.fleet.campaign import ASIDE, take_up
from app.fleet.executors import LocalProcesses
from app.fleet.orders import FleetOrder, FleetOutcome
from app.fleet.provenance import CHANGED, asked_beside, stored
from app.fleet.summary import NAME, add_row, read_rows, row_of
from calib_core import api
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings, Prior, ReadSettings
from tests.app.support.fleet import FAKE, orders, run_here
from tests.core.exporters.results import make_result

PRIOR = Prior(axis="tz", value=0.3, std=0.01)


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

    monkeypatch.setattr(calibrate_many, "run_fleet", runs)
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
    monkeypatch.setattr(calibrate_many, "LocalProcesses", lambda workers: LocalProcesses(workers, FAKE))
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
