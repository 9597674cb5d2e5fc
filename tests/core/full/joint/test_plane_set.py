"""Which planes are none, from numbers made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from calib_core.factors.imu import KnotStates
from calib_core.factors.lidar_plane import LidarNoise
from calib_core.full.joint import plane_set
from calib_core.full.joint.estimation import Estimation, MapPlane
from calib_core.full.joint.plane_set import (
    add_planes,
    drop_planes,
    kept_planes,
    mark_planes,
    new_ones,
    only_planes,
    over_usual,
    with_planes,
)
from calib_core.full.joint.policies import PlaneSet
from calib_core.full.joint.priors import Priors
from calib_core.full.joint.residuals import misfit, plane_misfit, wandering_m
from calib_core.full.joint.state import Estimate
from calib_core.full.planes.plane_tests import Standing, doubts
from calib_core.geometry import exp
from calib_core.planes.segment import PlaneFit
from calib_core.types import Plane
from tests.core.full.joint.conftest import Half


def test_the_usual_is_what_half_of_the_points_are() -> None:
    """Fails when the middle plane counts instead of the middle point: three bushes would outvote two walls."""
    badness = np.array([0.5, 0.6, 5.0, 6.0, 7.0])
    points = np.array([900.0, 800.0, 50.0, 40.0, 30.0])
    assert over_usual(badness, points) == pytest.approx(badness / 0.6)


def test_three_planes_are_left_and_none_of_them_without_points() -> None:
    """Fails when everything is kept because two walls alone are beyond doubt, or a plane without points fills up."""
    points = np.array([900.0, 800.0, 0.0, 50.0, 40.0, 30.0])
    few = np.array([0.2, 0.3, 0.0, 4.0, 1.2, 9.0])
    assert kept_planes(few, points, 3).tolist() == [True, True, False, False, True, False]
    enough = np.array([0.2, 0.3, 0.0, 0.9, 0.5, 9.0])
    assert kept_planes(enough, points, 3).tolist() == [True, True, False, True, True, False]
    assert kept_planes(few[:3], points[:3], 3).tolist() == [True, True, False]


def test_a_plane_wanders_by_its_bins_averages() -> None:
    """Fails when distances are summed before they are squared (a wandering plane has mean zero), or bins go by points.

    Two planes of two bins each. A bin of n points of weight 1 at distance d has scatter[3, 3] = n and the sum n d.
    """
    away = np.array([0.01, -0.01, 0.3, -0.3])
    count = np.array([400.0, 100.0, 100.0, 100.0])
    scatter = np.zeros((4, 5, 5))
    scatter[:, 3, 3] = count
    bins = SimpleNamespace(scatter=scatter, plane=np.array([0, 0, 1, 1]))
    problem: Any = SimpleNamespace(bins=bins, lidar=SimpleNamespace(sums=lambda _: count * away))
    estimate: Any = SimpleNamespace(normals=np.eye(3)[:2])
    found = plane_misfit(problem, estimate)
    assert found == pytest.approx([(0.04 + 0.01) / 2, 9.0])
    assert misfit(problem, estimate) == pytest.approx(found.mean())


def test_averages_wander_by_what_noise_has_not_made() -> None:
    """Two planes of four bins each, 500 points of 10 mm a bin: noise makes 0.447 mm of a bin. Beside it the first one's are 3 mm
    off, this way and that, the second one's by what noise makes. Mutations: noise not taken off; bins not by their points.
    """
    std_m, points = 0.01, np.array([500.0, 500.0, 500.0, 500.0, 500.0, 500.0, 100.0, 900.0])
    noise_m = std_m / np.sqrt(points)
    away_m = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]) * noise_m
    away_m[:4] = np.array([1.0, -1.0, -1.0, 1.0]) * np.sqrt(0.003**2 + noise_m[:4] ** 2)
    weight = points / std_m**2
    scatter = np.zeros((8, 5, 5))
    scatter[:, 3, 3] = weight
    bins = SimpleNamespace(scatter=scatter, plane=np.repeat([0, 1], 4), count=points)
    problem: Any = SimpleNamespace(bins=bins, lidar=SimpleNamespace(sums=lambda _: weight * away_m))
    estimate: Any = SimpleNamespace(normals=np.eye(3)[:2])
    assert wandering_m(problem, estimate) == pytest.approx([0.003, 0.0], abs=1e-9)
    away_m[6] = 0.02  # a tenth of a usual bin's points says a twentieth of the plane
    assert wandering_m(problem, estimate)[1] == pytest.approx(np.sqrt(0.05 * (0.02**2 - noise_m[6] ** 2)), rel=1e-9)


def test_a_floor_that_is_as_flat_as_floors_are_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen at a grazing angle it has a millimetre of noise, beside which 0.8 mm of unevenness is four times what is usual:
    without it a car's height rested on 3,000 points of a ceiling (4.3 sigmas off). A hedge that wanders by 7 mm goes.

    Mutations: whatever wanders goes; nothing that wanders does.
    """
    planes = [MapPlane(name) for name in ("floor", "wall", "ceiling", "other", "hedge")]
    state = state_of(np.tile([0.0, 1.0, 0.0], (5, 1)), np.arange(5.0), *planes)
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.ones(5), np.array([300.0, 300.0, 100.0, 300.0, 50.0])))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *_: np.zeros((5, 3)))
    monkeypatch.setattr(plane_set, "plane_misfit", lambda *_: np.array([4.3, 1.0, 1.0, 1.0, 11.0]))
    monkeypatch.setattr(plane_set, "wandering_m", lambda *_: np.array([0.0008, 0.0, 0.0, 0.0, 0.007]))
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *_: None))
    left = drop_planes(data, state, PlaneSet(), settled=True)
    assert [plane.name for plane in left.planes] == ["floor", "wall", "ceiling", "other"]


def state_of(normals: np.ndarray, offsets_m: np.ndarray, *planes: MapPlane) -> Estimation:
    """A state of a single knot with these planes."""
    estimate = Estimate(
        states=KnotStates(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3))),
        R_imu_lidar=np.eye(3),
        p_imu_lidar=np.zeros(3),
        time_offset_s=0.0,
        gravity=np.array([0.0, 0.0, -9.8]),
        gyro_bias=np.zeros((1, 3)),
        accel_bias=np.zeros((1, 3)),
        normals=normals,
        offsets_m=offsets_m,
    )
    priors = Priors(np.eye(3), (), 9.8, 0.02)
    return Estimation(estimate, priors, planes, (0,), LidarNoise(0.02, 0.005), observations=cast("Any", object()))


def test_planes_that_are_dropped_take_their_outlines_with_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fails when planes are thinned out but not their names and outlines, or points of the old numbers are kept."""
    outline_m = np.zeros((3, 3))
    planes = [MapPlane(name, outline_m if name == "c" else None) for name in "abcd"]
    turned = 0.3 * np.arange(4.0)
    normals = np.stack([np.cos(turned), np.sin(turned), np.zeros(4)], axis=1)
    state = state_of(normals, np.arange(4.0), *planes)

    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.array([1.0, 90.0, 1.1, 0.9]), np.full(4, 100.0)))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *_: np.zeros((4, 3)))
    said: list[str] = []
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *what: said.append(what[-1])))
    left = drop_planes(data, state, PlaneSet())
    assert [plane.name for plane in left.planes] == ["a", "c", "d"]
    assert [plane.outline_m is outline_m for plane in left.planes] == [False, True, False]
    np.testing.assert_array_equal(left.estimate.normals, state.estimate.normals[[0, 2, 3]])
    np.testing.assert_array_equal(left.estimate.offsets_m, [0.0, 2.0, 3.0])
    assert left.observations is None
    assert len(state.planes) == 4  # what was known before is as it was
    assert said == ["b does not fit the motion of the other planes: left out"]
    assert drop_planes(data, state, PlaneSet(worst_scatter=100.0)) is state


def test_what_holds_many_points_is_judged_once_the_sensors_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall with a door ajar, of which wide gates see the leaf, and a box, both 16 mm off flat: five seeds in twenty had lost
    the wall. Mutations: the wall left out with the box; the box kept; the share of a mean plane; kept at the end, too.
    """
    planes = [MapPlane(name) for name in ("floor", "wall", "ceiling", "other", "box")]
    state = state_of(np.tile([0.0, 1.0, 0.0], (5, 1)), np.arange(5.0), *planes)
    doubt = np.zeros((5, 3))
    doubt[[1, 4], 1] = 2.0
    points = np.array([300.0, 300.0, 170.0, 180.0, 50.0])
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.ones(5), points))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *_: doubt)
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *_: None))
    rules = PlaneSet()
    early = drop_planes(data, state, rules, most_share=rules.clutter_share)
    assert [plane.name for plane in early.planes] == ["floor", "wall", "ceiling", "other"]
    assert [plane.name for plane in drop_planes(data, state, rules).planes] == ["floor", "ceiling", "other"]
    wanted = replace(state, planes=(*state.planes[:4], replace(state.planes[4], chosen=True)))
    assert [plane.fault for plane in mark_planes(data, wanted, rules).planes] == ["", "", "", "", "bent"]
    assert [plane.fault for plane in mark_planes(data, state, rules).planes] == [""] * 5


def test_what_a_person_chose_stays_among_what_was_proposed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two boxes, of which one is wanted. Mutations: the wanted one goes, too; both stay."""
    planes = [MapPlane(name, chosen=name == "my box") for name in ("floor", "wall", "ceiling", "my box", "box")]
    state = state_of(np.tile([0.0, 1.0, 0.0], (5, 1)), np.arange(5.0), *planes)
    doubt = np.zeros((5, 3))
    doubt[[3, 4], 1] = 2.0
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.ones(5), np.full(5, 100.0)))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *_: doubt)
    said: list[str] = []
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *what: said.append(what[-1])))
    left = drop_planes(data, state, PlaneSet())
    assert [plane.name for plane in left.planes] == ["floor", "wall", "ceiling", "my box"]
    assert said == ["box is not flat: left out"]


def test_a_plane_that_has_come_to_lie_along_another_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen in a yard: a patch of 400 points settled on the ground, and neither had a point any more. All that was left was a
    house front, and nothing determined.

    One 1 deg and 20 mm off the floor goes; one a step of 80 mm above it stays, and so does a part that is cut out of it, and one
    that a person wants: then the floor goes, which nobody chose. It is no edge of anything.
    Mutations: the first of two goes; both do; the chosen one; cut parts; put aside where it lay; however far or askew.
    """
    tilted = exp(np.radians([1.0, 0.0, 0.0])) @ np.array([0.0, 0.0, 1.0])
    askew = exp(np.radians([5.0, 0.0, 0.0])) @ np.array([0.0, 0.0, 1.0])
    normals = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], tilted, [0.0, 0.0, 1.0], askew])
    names = ("floor", "wall", "late", "step", "slope")
    state = state_of(normals, np.array([1.2, 3.0, 1.22, 1.28, 1.2]), *(MapPlane(name) for name in names))
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.ones(5), np.zeros(5)))
    said: list[tuple[str, ...]] = []
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *what: said.append(what)))

    def left(**changes: MapPlane) -> list[str]:
        planes = tuple(changes.get(plane.name, plane) for plane in state.planes)
        after = drop_planes(data, replace(state, planes=planes), PlaneSet())
        assert len(after.estimate.aside_normals) == 0
        assert len(after.estimate.normals) == len(after.planes)
        return [plane.name for plane in after.planes]

    assert left() == ["floor", "wall", "step", "slope"]
    assert said == [("info", "planes.merged", "late is the same plane as floor: left out")]
    assert left(late=MapPlane("late", outline_m=np.zeros((3, 3)))) == list(names)
    assert left(late=MapPlane("late", chosen=True)) == ["wall", "late", "step", "slope"]
    assert left(late=MapPlane("late", chosen=True), floor=MapPlane("floor", chosen=True)) == list(names)


def test_a_wall_that_is_left_out_still_stands_in_its_edges() -> None:
    """Put aside, in whatever frame comes next; but not the same surface seen twice, which would claim the other's points.

    Mutations: nothing put aside, all put aside, clutter put aside, the frame's change left out.
    """
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.9998, 0.02, 0.0], [0.0, 0.0, 1.0]])
    state = state_of(normals, np.array([1.0, 2.0, 1.1, 0.5]), *(MapPlane(name) for name in "abcd"))
    keep, every = np.array([True, True, False, False]), np.ones(4, bool)
    assert only_planes(state, keep, ~every, PlaneSet()).estimate.aside_offsets_m.size == 0
    left = only_planes(state, keep, every, PlaneSet())
    np.testing.assert_array_equal(left.estimate.aside_normals, normals[3:])
    np.testing.assert_array_equal(left.estimate.aside_offsets_m, [0.5])
    moved = left.estimate.seen_from(np.eye(3), np.array([0.0, 0.0, 0.25]))
    np.testing.assert_array_equal(moved.aside_offsets_m, [0.75])


def test_a_find_that_is_a_known_plane_is_not_taken_in_again() -> None:
    """A door 10 cm before its wall is the wall; one 40 cm before it, or facing another way, is a plane of its own.

    One that was dropped is known farther away, and more askew. Mutations: leave out the distance, or the angle; measure from the
    origin instead of the find's middle; those dropped left out; known no farther than others; others known as far.
    """
    state = state_of(np.array([[-1.0, 0.0, 0.0]]), np.array([5.0]), MapPlane("wall"))
    turned = np.radians(10.0)
    cloud = np.array([[4.9, 1.0, 0.5], [4.6, 1.0, 0.5], [5.0, 3.0, 0.5]])
    each = np.eye(3, dtype=bool)
    door = PlaneFit(np.array([-1.0, 0.0, 0.0]), 4.9, each[0], 0.01)
    wardrobe = PlaneFit(np.array([-1.0, 0.0, 0.0]), 4.6, each[1], 0.01)
    leaf = PlaneFit(np.array([-np.cos(turned), np.sin(turned), 0.0]), 4.4, each[2], 0.01)
    found = new_ones(state.estimate, [door, wardrobe, leaf], cloud, PlaneSet())
    assert [fit.offset_m for fit in found] == [4.6, 4.4]
    # Tilted by 7 deg about its own middle on the wall: near there, though 0.4 m off at the origin's foot.
    tilted = np.radians(7.0)
    # One that was dropped at 4.55 m does not come back either; what is more than 0.75 m or 24 deg off is another.
    wall = (np.array([[-1.0, 0.0, 0.0]]), np.array([4.55]))
    assert new_ones(state.estimate, [wardrobe, leaf], cloud, PlaneSet(), dropped=wall) == []
    open_leaf = replace(leaf, normal=np.array([-np.cos(3.0 * turned), np.sin(3.0 * turned), 0.0]))
    assert new_ones(state.estimate, [open_leaf], cloud, PlaneSet(), dropped=wall) == [open_leaf]
    behind = (wall[0], np.array([4.2]))
    assert new_ones(state.estimate, [wardrobe, leaf], cloud, PlaneSet(), dropped=behind) == [leaf]
    normal = np.array([-np.cos(tilted), np.sin(tilted), 0.0])
    there = np.array([[5.0, 4.0, 0.0]])
    assert not new_ones(
        state.estimate, [PlaneFit(normal, float(-normal @ there[0]), np.ones(1, bool), 0.0)], there, PlaneSet()
    )


def test_planes_that_come_in_are_called_what_they_are() -> None:
    """Mutations: number from the first again; leave the offset out; up the other way; the name of one that was dropped; none
    late.
    """
    state = state_of(np.eye(3)[:2], np.array([1.0, 2.0]), MapPlane("wall 1"), MapPlane("floor"))
    found = [PlaneFit(np.eye(3)[2], 3.0, np.ones(1, bool), 0.0)]
    more = with_planes(state, found)
    assert [plane.name for plane in more.planes] == ["wall 1", "floor", "floor 2"]
    assert [plane.late for plane in more.planes] == [False, False, True]
    assert with_planes(state, found, taken=["floor 2"]).planes[-1].name == "floor 3"
    np.testing.assert_array_equal(more.estimate.offsets_m, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(more.estimate.normals, np.eye(3))


def test_walls_that_scatter_as_noise_makes_them_stay_beside_a_floor_that_scatters_less(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A vehicle's floor, seen at a grazing angle, holds most points and a tenth of the walls' scatter: two true walls
    of three were said to be more than one surface. Mutations: against the usual plane alone, in either of the two places; a
    warning of what nobody was shown.
    """
    planes = [MapPlane(name) for name in ("floor", "wall 1", "wall 2", "wall 3", "bin")]
    state = state_of(np.tile([0.0, 1.0, 0.0], (5, 1)), np.arange(5.0), *planes)
    chi2, points = np.array([0.06, 0.54, 0.52, 0.56, 2.7]), np.array([358829.0, 92685.0, 118237.0, 51431.0, 3611.0])
    stand = [Standing(0.0, 0.0, float(c), float(n)) for c, n in zip(chi2, points, strict=True)]
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (chi2, points))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *_: doubts(stand))
    said: list[tuple[str, ...]] = []
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *what: said.append(what)))
    left = drop_planes(data, state, PlaneSet())
    assert [plane.name for plane in left.planes] == ["floor", "wall 1", "wall 2", "wall 3"]
    assert said == [("warning", "planes.mixed", "bin is more than one surface: left out")]
    # Nobody was shown what came into view on the way.
    drop_planes(data, replace(state, planes=(*planes[:4], MapPlane("bin", late=True))), PlaneSet())
    assert said[1:] == [("info", "planes.mixed", "bin is more than one surface: left out")]


@pytest.mark.parametrize(
    ("normal", "found_m", "told"),
    [
        ((0.02, 0.0, 0.9998), 0.598, " (0.6 m below the lidar)"),
        ((0.0, -0.1, -0.995), 1.284, " (1.3 m above the lidar)"),
        ((0.999, 0.0, 0.03), 2.1, ""),
        ((0.0, 0.7071, 0.7071), 2.1, ""),
        ((0.0, 0.0, 1.0), None, ""),
    ],
)
def test_of_a_floor_that_is_left_out_its_height_is_told(
    monkeypatch: pytest.MonkeyPatch, normal: tuple[float, float, float], found_m: float | None, told: str
) -> None:
    """Seen: the tops of some tables, 0.72 and 0.71 m high, "floor is more than one surface", beside a floor that was flat.

    It is that at which somebody was shown it: one that is none had slid up to the lidar in the solve. Mutations: said of walls,
    or of slopes; above for below; never said; where the solve has it.
    """
    planes = [*(MapPlane(name) for name in "abc"), MapPlane("floor", found_m=found_m)]
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], normal])
    state = state_of(normals, np.array([1.0, 2.0, 3.0, 0.3]), *planes)
    doubt = np.zeros((4, 3))
    doubt[3, 2] = 2.0
    monkeypatch.setattr(plane_set, "gathered", lambda *_: None)
    monkeypatch.setattr(plane_set, "plane_chi2", lambda *_: (np.ones(4), np.full(4, 100.0)))
    monkeypatch.setattr(plane_set, "plane_doubts", lambda *_: doubt)
    said: list[str] = []
    data: Any = SimpleNamespace(run=SimpleNamespace(say=lambda *what: said.append(what[-1])))
    drop_planes(data, state, PlaneSet())
    assert said == [f"floor is more than one surface{told}: left out"]


def test_what_a_person_dropped_does_not_come_into_view_again(half: Half) -> None:
    """A wall that is not among the planes is found among the points, unless it was dropped, or is put aside: a proposal is as it
    was seen in a bent sweep, and what lies beyond it was found for a plane. The frame of the solve is not that of the map: it
    was turned and moved. Mutations: those dropped not looked at, or those aside; told in the map's frame.
    """
    truth = half.truth.planes
    wall = [plane.name for plane in truth].index("wall south")
    R, p = exp(np.array([0.1, -0.2, 1.0])), np.array([1.0, 2.0, -0.5])
    keep = np.arange(len(truth)) != wall
    aside = only_planes(half.state, keep, ~keep, PlaneSet())
    aside = replace(aside, estimate=aside.estimate.seen_from(R, p))
    positions = aside.positions
    assert add_planes(half.data, aside, positions, PlaneSet()) is aside
    other = replace(half.data, dropped=[Plane("other", np.array([0.0, 0.0, 1.0]), 50.0)])
    assert add_planes(other, aside, positions, PlaneSet()) is aside
    none = replace(aside.estimate, aside_normals=np.empty((0, 3)), aside_offsets_m=np.empty(0))
    state = replace(aside, estimate=none)
    again = add_planes(half.data, state, positions, PlaneSet())
    assert len(again.planes) == len(truth)
    np.testing.assert_allclose(np.abs(again.estimate.normals[-1] @ R.T @ truth[wall].normal), 1.0, atol=1e-3)
    dropped = replace(half.data, dropped=[truth[wall]])
    assert add_planes(dropped, state, positions, PlaneSet()) is state
