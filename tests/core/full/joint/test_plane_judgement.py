"""Planes that are left out on the way of a solve, or marked where somebody chose them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.full import attempts
from calib_core.full.joint import plane_judgement, plane_set, solve
from calib_core.full.joint.doubtful_planes import require_three_ways
from calib_core.full.joint.estimation import Estimation, JointData, MapPlane
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.schedule import CHOSEN, FULL
from calib_core.full.joint.state import Estimate
from calib_core.full.joint.tone_choice import Explaining
from calib_core.full.odometry.reference import Followed
from calib_core.full.prepare.nuisance import Nuisance
from calib_core.types import FloatArray
from tests.core.full.joint.conftest import Half


@pytest.mark.parametrize("shaken", [True, False])
def test_planes_are_not_judged_while_something_shakes_the_imu_unseen(
    monkeypatch: pytest.MonkeyPatch, half: Half, shaken: bool
) -> None:
    """It would be held against them. Mutations: judged in any case; never; by another tone than one in company."""

    def found(*_: object, least: float) -> list[Explaining]:
        assert least == FULL.tones.explains_in_company
        return [Explaining(1.4, 2.0 * least)] if shaken else []

    monkeypatch.setattr(plane_judgement, "found_tones", found)
    left = replace(half.state, rounds=77)
    monkeypatch.setattr(plane_judgement, "drop_planes", lambda *_, settled: left if settled else None)
    after = plane_judgement.without_doubtful(half.data, half.state, FULL)
    assert after is (half.state if shaken else left)


@pytest.mark.parametrize("is_none", [True, False])
def test_what_planes_that_are_none_have_told_of_the_readings_goes_with_them(
    monkeypatch: pytest.MonkeyPatch, half: Half, is_none: bool
) -> None:
    """Seen: of 22 planes 19 were clutter, and 1.2 m/s2 at 0.34 Hz stayed among the unknowns without them: a time offset known to
    0.1 ms was undetermined. Where all stay, nothing is heard anew. Mutations: heard anew in any case; never; before the clutter
    goes; with the sensors let go while they are held.
    """
    left, anew = replace(half.state, rounds=77), replace(half.state, rounds=78)
    rounds: list[object] = []

    def heard(_data: object, state: Estimation, _tones: object, round_: object, _sampling: object) -> Estimation:
        assert state is left
        rounds.append(round_)
        return anew

    monkeypatch.setattr(plane_judgement, "heard_anew", heard)
    monkeypatch.setattr(plane_judgement, "drop_planes", lambda _data, state, *_, **__: left if is_none else state)
    data = replace(half.data, sensors=Nuisance().with_tone(1.4, 0.01, 0.0))
    expected = anew if is_none else half.state
    assert plane_judgement.without_clutter(data, half.state, FULL) is expected
    assert plane_judgement.without_faulty(data, half.state, FULL, settled=True) is expected
    assert rounds == ([FULL.coarse[-1], FULL.sensors] if is_none else [])


@pytest.mark.parametrize("chosen", [True, False])
def test_a_chosen_box_is_marked_while_gates_are_wide(half: Half, monkeypatch: pytest.MonkeyPatch, chosen: bool) -> None:
    """It stays, and what was wrong with it is known at the end. Where nobody chose, nobody is judged.

    Mutations: judged as at rest; left out; the fault of its neighbour; marked where nobody chose.
    """
    count = len(half.state.planes)
    doubts = np.zeros((count, 3))
    doubts[1, 1] = 1.2
    asked: list[tuple[object, ...]] = []
    points = np.full(count, 10.0)
    points[0] = 1000.0
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.ones(count), points))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *rest: asked.append(rest[2:]) or doubts)
    after = plane_judgement.without_clutter(half.data, half.state, replace(CHOSEN, chosen=chosen))
    assert asked == ([(PlaneSet().rough_m,)] if chosen else [])
    assert [plane.fault for plane in after.planes] == ["", "bent" if chosen else "", *[""] * (count - 2)]


@pytest.mark.parametrize(
    ("chosen", "culprits", "bends", "marked"),
    [
        (True, "one way", True, None),  # without them the others face two ways
        (True, "first", True, True),  # the others seem bent as long as it is there
        (True, "first", False, False),  # what is sound holds the motion as it is
        (False, "one way", True, False),
    ],
)
def test_a_choice_that_does_not_hold_the_motion_is_told_before_all_points_are_tried(
    half: Half, monkeypatch: pytest.MonkeyPatch, chosen: bool, culprits: str, bends: bool, marked: bool | None
) -> None:
    """What moves or bends never comes to rest, least of all with all points, and a motion that it has bent makes walls seem bent.

    Seen: a true floor named. Mutations: judged at the end alone; where nobody chose; refused though the rest faces three ways;
    all that seem bent named; looked for though what is sound holds the motion.
    """
    normals = half.state.estimate.normals
    guilty = np.abs(normals @ normals[0]) > 0.5 if culprits == "one way" else np.arange(len(normals)) == 0
    names = [plane.name for plane, is_guilty in zip(half.state.planes, guilty, strict=True) if is_guilty]

    def doubts(_: object, estimate: Estimate) -> FloatArray:
        present = np.array([guilty[np.argmax(normals @ n)] for n in estimate.normals])
        others = 1.5 if bends and present.any() else 0.0
        return np.where(present, 2.0, others)[:, None] * np.array([0.0, 1.0, 0.0])

    monkeypatch.setattr(plane_judgement, "plane_doubts", doubts)
    monkeypatch.setattr(plane_judgement, "gathered", lambda *_: None)
    for module in (solve, plane_judgement):
        monkeypatch.setattr(module, "settle", lambda _, state, *__: state)
    monkeypatch.setattr(solve, "settle_with_tones", lambda _, state, __: state)
    monkeypatch.setattr(solve, "admit_surface", lambda _, state, *__: state)
    schedule = replace(CHOSEN, chosen=chosen)
    if marked is None:
        with pytest.raises(Refused, match="do not determine the motion") as refused:
            solve.settled(half.data, half.state, schedule)
        assert refused.value.code == "planes.doubtful"
        assert f"motion: {', '.join(f'{name} is not flat' for name in names)}, and the others" in str(refused.value)
        assert str(refused.value).endswith(
            "choose walls, floor and ceiling, or use the suggested planes"
        )  # as the button is called
        return
    after = solve.settled(half.data, half.state, schedule)
    assert [plane.name for plane in after.planes if plane.fault] == (names if marked else [])
    assert len(after.planes) == len(half.state.planes)


def test_what_came_into_view_is_not_blamed_on_a_choice() -> None:
    """Seen: four boxes chosen, "wall 3 is not flat" of a fifth. Mutations: late planes named; not counted among the faulty."""
    planes = [MapPlane("box", chosen=True), MapPlane("floor"), MapPlane("wall"), MapPlane("wall 2", late=True)]
    normals = np.array([[0.0, 0.6, 0.8], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    require_three_ways(planes, ["bent", "", "", ""], normals)
    with pytest.raises(
        Refused, match="motion: box is not flat, and the others do not face three different directions;"
    ):
        require_three_ways(planes, ["bent", "", "", "bent"], normals)
    with pytest.raises(Refused, match="motion: they do not face three different directions;"):
        require_three_ways(planes[1:], ["", "", "bent"], normals[1:])


def test_two_planes_are_not_called_bent_by_a_motion_that_they_do_not_hold() -> None:
    """Seen: a floor and a wall, "plane 1 is not flat", where the lidar slid along both. Mutation: blame them all the same."""
    planes, normals = [MapPlane("floor", chosen=True), MapPlane("wall", chosen=True)], np.eye(3)[1:]
    with pytest.raises(Refused, match="motion: those that count face two directions at most; choose walls, floor and"):
        require_three_ways(planes, ["bent", ""], normals)


@pytest.mark.parametrize("held", [True, False])
def test_of_ideal_sensors_clutter_is_judged_once(monkeypatch: pytest.MonkeyPatch, half: Half, held: bool) -> None:
    """What was left out has no points until it is laid anew, which the sensors' round does: a second judgement found none and
    ended as a defect.

    Mutations: judged before the sensors in any case; never before them.
    """
    told: list[str] = []

    def drop(_data: JointData, state: Estimation, *_: object, **how: float) -> Estimation:
        assert state.observations is not None
        told.append("clutter" if "most_share" in how else "all")
        return replace(state, observations=None)

    def sensors(_data: JointData, state: Estimation, *_: object) -> tuple[Estimation, float]:
        return replace(state, observations=half.state.observations), 0.0

    data = replace(half.data, sensors=Nuisance()) if held else half.data
    monkeypatch.setattr(plane_judgement, "drop_planes", drop)
    monkeypatch.setattr(solve, "moving_round", sensors)
    monkeypatch.setattr(solve, "admit_tones", lambda _, state, *__, **___: state)
    monkeypatch.setattr(solve, "until_steady", lambda _, state, *__: state)
    assert half.data.sensors.blocks
    solve.with_sensors(data, half.state, FULL)
    assert told == (["all"] if held else ["clutter", "all"])


@pytest.mark.parametrize("clutter", [True, False])
def test_clutter_goes_before_the_sensors_are_let_go(monkeypatch: pytest.MonkeyPatch, half: Half, clutter: bool) -> None:
    """What is no plane by far goes first, and again what the sensors' parameters have brought out.

    Mutations: the sensors first; judged as at rest; walls judged with the clutter; what was left out comes back.
    """
    told: list[str] = []
    bare = replace(half.state, rounds=half.state.rounds + 100)

    def drop(
        _data: JointData, state: Estimation, _rules: object, *, settled: bool = False, most_share: float = 1.0
    ) -> Estimation:
        told.append("judged as at rest" if settled else "judged" if most_share == 1.0 else "clutter")
        return bare if clutter and state is half.state else state

    def sensors(_data: JointData, state: Estimation, _schedule: object) -> tuple[Estimation, float]:
        told.append("sensors")
        return state, 0.0

    monkeypatch.setattr(plane_judgement, "drop_planes", drop)
    monkeypatch.setattr(solve, "first_with_sensors", sensors)
    monkeypatch.setattr(solve, "admit_tones", lambda _, state, *__, **___: state)
    after = solve.with_sensors(half.data, half.state, FULL)
    assert told == ["clutter", "sensors", "judged"]
    assert after is (bare if clutter else half.state)


def test_what_does_not_stand_still_in_a_motion_by_all_is_marked(monkeypatch: pytest.MonkeyPatch, half: Half) -> None:
    """By its first doubt alone, and by the bounds of a motion that is rough yet. Mutations: whatever is wrong with a plane; the
    bounds of a motion at rest; the points of before.
    """
    state = replace(half.state, observations=None)
    doubt = np.zeros((len(state.planes), 3))
    doubt[1], doubt[2, 0] = [0.9, 3.0, 3.0], 1.1

    def doubts(problem: JointProblem, estimate: Estimate, rough_m: float | None = None) -> FloatArray:
        assert len(problem.bins.knot) > len(estimate.states.p) / 2
        assert (estimate, rough_m) == (state.estimate, PlaneSet().rough_m)
        return doubt

    monkeypatch.setattr(plane_judgement, "plane_doubts", doubts)
    marked = plane_judgement.with_strayed_marked(half.data, state, FULL)
    assert [plane.strayed for plane in marked.planes] == [k == 2 for k in range(len(doubt))]
    assert replace(marked, planes=state.planes) == state


def test_the_motion_that_a_choice_begins_from_comes_with_what_strayed_in_it(
    monkeypatch: pytest.MonkeyPatch, half: Half
) -> None:
    """Kept from before, too. Mutation: not asked."""
    doubt = np.zeros((len(half.state.planes), 3))
    doubt[1, 0] = 2.0
    monkeypatch.setattr(plane_judgement, "plane_doubts", lambda *_: doubt)
    monkeypatch.setattr(attempts, "begin", lambda *_: (half.data, half.state, None))
    track = Followed(0, list(half.truth.planes), [])
    task: Any = SimpleNamespace(followed=track, lidar=None, start=None, guess=None)
    kept: Any = SimpleNamespace(recall=lambda _: half.state)
    found = attempts.motion_by_everything(half.data.run, task, kept)
    assert found is not None
    assert [plane.strayed for plane in found.state.planes] == [k == 1 for k in range(len(doubt))]
