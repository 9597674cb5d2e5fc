"""Planes that nobody touched: what is doubtful among them is left out of the answer and named, and blamed on no person."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.jobs.orders import Order, OrderedPlane, StoredRequest
from app.results.command import command_of
from app.work import functions
from calib_core import api
from calib_core.errors import Cancelled
from calib_core.full.assess import doubtful_choice
from calib_core.full.joint import doubtful_planes
from calib_core.full.joint.estimation import MapPlane
from calib_core.settings import ReadSettings
from calib_core.types import Plane
from tests.app.support import world


@pytest.mark.parametrize("then", ["bent", ""])
def test_what_was_doubtful_while_gates_were_wide_is_named_but_refuses_nothing(monkeypatch, then: str) -> None:
    """A box before a wall, of which narrow gates see what looks like the wall. Mutations: the end alone; a wall's own fault
    lost; said of a plane that nobody chose; refused for what is no fault at the end.
    """
    heard: list[str] = []
    monkeypatch.setattr(doubtful_planes, "plane_doubts", lambda *_: np.zeros((3, 3)))
    monkeypatch.setattr(doubtful_choice, "standings", lambda *_: [None] * 3)
    monkeypatch.setattr(doubtful_choice, "doubts", lambda _: np.zeros((3, 3)))
    monkeypatch.setattr(doubtful_choice, "is_mostly_bent", lambda _: False)
    monkeypatch.setattr(doubtful_choice, "plane_residuals", lambda *_: [(0.01, 100)] * 3)
    for module in (doubtful_planes, doubtful_choice):
        monkeypatch.setattr(module, "fault_of", lambda _: "")
    run = SimpleNamespace(say=lambda level, code, text: heard.append(code))
    planes = [MapPlane("floor", fault=then), MapPlane("wall 1"), MapPlane("wall 2", fault=then, chosen=True)]
    estimate = SimpleNamespace(p_imu_lidar=np.zeros(3), normals=np.eye(3))
    solved = SimpleNamespace(problem=None, estimate=estimate, planes=planes)
    doubtful_planes.require_sound_choice(solved)  # type: ignore[arg-type]
    doubtful_choice.say_doubtful_choice(run, solved)  # type: ignore[arg-type]
    assert heard == (["planes.doubted"] if then else [])


def test_the_command_says_of_each_plane_whether_anybody_chose_it(tmp_path: Path) -> None:
    """So that the same are left out again. Mutations: said of all where one is; not said; planes missing."""
    ordered = tuple(
        OrderedPlane(name=name, normal=(0, 0, 1), offset_m=1.0, suggested=name == "person")
        for name in ("floor", "person")
    )
    command = command_of(world.make_result(), ReadSettings(), StoredRequest(planes=ordered))
    path = tmp_path / "planes.json"
    path.write_text(command.files[0].text, encoding="utf-8")
    assert [(plane.name, plane.suggested) for plane in api.read_planes(path)] == [("floor", False), ("person", True)]


def test_a_solve_is_told_of_each_plane_whether_anybody_chose_it(monkeypatch, tmp_path: Path) -> None:
    """Mutations: always; never."""
    asked: list[bool] = []

    def calibrate(*_: object, planes: Sequence[Plane], **__: object) -> None:
        asked.extend(plane.suggested for plane in planes)
        raise Cancelled("asked")

    monkeypatch.setattr(functions, "decoded", lambda *_: None)
    monkeypatch.setattr(functions.api, "calibrate", calibrate)
    planes = tuple(
        OrderedPlane(name=name, normal=(0, 0, 1), offset_m=1.0, suggested=name == "wall") for name in ("floor", "wall")
    )
    order = Order(
        job_id="one",
        kind="solve",
        recording_name="room.bag",
        source=tmp_path / "room.bag",
        cache=tmp_path,
        folder=tmp_path,
        request=StoredRequest(planes=planes),
    )
    with pytest.raises(Cancelled):
        functions.run_solve(order, lambda _: None, lambda: False)
    assert asked == [False, True]


@pytest.mark.parametrize("suggested", [True, False])
def test_jobs_of_before_said_it_of_all_planes_at_once(suggested: bool) -> None:
    """A record that lies in the store. Mutations: the key is refused; it is forgotten; no planes become some."""
    plane = {"name": "floor", "normal": [0.0, 0.0, 1.0], "offset_m": 1.0}
    kept = StoredRequest.model_validate({"planes": [plane, plane], "suggested": suggested})
    assert [one.suggested for one in kept.planes or ()] == [suggested] * 2
    assert StoredRequest.model_validate({"suggested": suggested}) == StoredRequest()


def test_who_drops_a_plane_has_chosen_none_of_the_others(shared_live) -> None:
    """Names are no choice, and dropped and taken again is none; who insists on a plane has chosen that one.

    Mutations: one plane dropped chooses all others; by name; insisting is a tick as any other; outlasts the plane's drop.
    """
    recording_id = shared_live.ready()
    service = shared_live.services.planes
    url = f"/api/recordings/{recording_id}/planes/operations"

    def edit(**operation) -> list[int]:
        """The planes that are chosen by hand after it, by their place in the palette."""
        assert shared_live.http.post(url, json=operation).status_code == 200
        return [plane.color for plane in service.confirmed(recording_id) if not plane.suggested]

    count = len(service.confirmed(recording_id))
    assert edit(op="rename", index=0, name="my wall") == []
    assert edit(op="drop", index=0) == []
    assert len(service.confirmed(recording_id)) == count - 1
    assert edit(op="confirm", index=0) == []
    assert edit(op="insist", index=1) == [1]
    assert shared_live.http.get(f"/api/recordings/{recording_id}/planes").json()["patches"][1]["insisted"]
    assert edit(op="confirm", index=1) == [1]
    assert edit(op="drop", index=1) == []
    assert edit(op="confirm", index=1) == []
    assert edit(op="use-suggestion") == []
