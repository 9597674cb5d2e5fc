"""A box drawn in the browser, all the way: proposals, selection, job, result; and the shown command on the same bag."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest

from app.arrays.proposals import proposal_arrays, read_proposals
from app.cli import main as cli
from app.jobs.orders import Order, StoredRequest
from app.planes.operations import apply
from app.planes.service import ordered
from app.planes.state import suggested
from app.results.command import command_of
from app.schemas.planes import Restrict, Side
from app.work.functions import run_job
from calib_core import api
from calib_core.result import CalibrationResult
from calib_core.settings import ReadSettings


def ignore(_):
    """An event nobody listens to."""


def never():
    """Nobody asks to stop."""
    return False


@pytest.mark.slow
def test_the_shown_command_repeats_a_solve_within_a_box_to_the_last_digit(tmp_path, monkeypatch):
    """Oracle: the same bag solved by the command line from the planes file offered for download.

    Mutations: no outline in that file; the outline not handed to the solve; normals divided by their length once only.
    """
    monkeypatch.chdir(tmp_path)
    bag = api.simulate("paper-normal", tmp_path / "room.bag", seed=2, duration_s=7.0).with_name("room.bag")
    request = StoredRequest()
    order = Order(
        job_id="0" * 32,
        kind="planes",
        recording_name="room.bag",
        source=bag,
        cache=tmp_path / "cache",
        folder=tmp_path / "job",
        request=request,
    )
    run_job(order, ignore, never)
    proposals = read_proposals(proposal_arrays(order.cache))
    start = suggested(proposals)
    largest = max(range(len(start.patches)), key=lambda place: start.patches[place].area_m2)
    patch = start.patches[largest]
    corners = np.array(patch.outline_m)
    along = corners[1] - corners[0]
    keep = Side(normal=along.tolist(), offset_m=-float(along @ corners.mean(axis=0)))
    cut = apply(start, Restrict(op="restrict", index=largest, sides=[keep]), proposals=proposals, grow=api.grow_plane)
    planes = tuple(ordered(each, cut) for each in cut.patches if each.confirmed)
    results = []
    for asked in (planes, tuple(plane.model_copy(update={"outline_m": None}) for plane in planes)):
        chosen = order.model_copy(update={"kind": "solve", "request": StoredRequest(planes=asked)})
        run_job(chosen, ignore, never)
        results.append(CalibrationResult.model_validate_json((chosen.folder / "result.json").read_text()))
    boxed, free = results
    used, all_of_it = (next(p for p in result.quality.planes if p.name == patch.name) for result in (boxed, free))
    assert 0 < used.points < 0.8 * all_of_it.points
    assert [p.outline_m is None for p in boxed.quality.planes] == [p.name != patch.name for p in boxed.quality.planes]
    command = command_of(boxed, ReadSettings(), StoredRequest(planes=planes))
    for file in command.files:
        (tmp_path / file.name).write_text(file.text)
    assert cli.run([*shlex.split(command.text)[1:], "--quiet"]) == 0
    again = json.loads((tmp_path / "result.json").read_text())
    expected = json.loads(boxed.to_json())
    for document in (again, expected):
        document["quality"].pop("duration_s")
    assert again == expected
