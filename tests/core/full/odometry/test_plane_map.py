"""The planes a track follows: where they are, how far they reach, and which new ones are taken in. Points by hand."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.register import ScanMotion, register
from calib_core.full.odometry.settings import MAP, TrackSettings
from calib_core.types import BoolArray, FloatArray, Plane

_FLOOR = Plane("floor", np.array([0.0, 0.0, 1.0]), 1.0)
_TABLE = Plane("table", np.array([0.0, 0.0, 1.0]), 0.6)
_WALLS = (
    Plane("x", np.array([-1.0, 0.0, 0.0]), 4.0),
    Plane("y", np.array([0.0, -1.0, 0.0]), 3.0),
)


def _patch(rng: np.random.Generator, low: FloatArray, high: FloatArray, n: int, noise: float = 0.01) -> FloatArray:
    return rng.uniform(low, high, (n, 3)) + noise * rng.normal(size=(n, 3))


def _room(rng: np.random.Generator, floor: int) -> FloatArray:
    """Points of two walls and a few of the floor, 1 m below the sensor."""
    x = _patch(rng, np.array([4.0, -3.0, -0.8]), np.array([4.0, 3.0, 0.8]), 800)
    y = _patch(rng, np.array([-4.0, 3.0, -0.8]), np.array([4.0, 3.0, 0.8]), 800)
    z = _patch(rng, np.array([1.5, -2.5, -1.0]), np.array([3.5, 2.5, -1.0]), floor)
    return np.vstack([x, y, z])


def _register(points: FloatArray, planes: PlaneMap, start: ScanMotion) -> ScanMotion:
    tie = np.repeat(1.0 / np.array([0.06, 0.05, 0.01, 0.01]) ** 2, 3)
    tau = np.linspace(0.0, 0.1, len(points))
    return register(points, tau, planes, start, tie=tie, settings=TrackSettings(), position=0).motion


def _at(p: FloatArray) -> ScanMotion:
    return ScanMotion(0, np.eye(3), p, np.zeros(3), np.zeros(3))


def test_forty_floor_points_among_thousands_tell_the_height_and_none_do_not() -> None:
    """Fails when certainty is a share of the points, or when a handful of points counts as knowledge.

    Forty of 1640 points with 1 cm of noise tell the height to 2 mm; walls alone tell nothing of it.
    """
    rng = np.random.default_rng(0)
    planes = PlaneMap.endless([_FLOOR, *_WALLS])
    s = TrackSettings()
    found = _register(_room(rng, 40), planes, _at(np.array([0.03, -0.02, 0.04])))
    assert np.linalg.norm(found.p) < 0.01
    assert found.std_m < s.trusted_m
    assert found.std_rad < s.trusted_rad
    for few in (0, 5):
        assert _register(_room(rng, few), planes, _at(np.zeros(3))).std_m > s.trusted_m


def test_the_floor_beside_a_table_does_not_pull_to_its_top() -> None:
    """Fails when planes go on for ever: the floor's points would lie on the table's plane from 0.25 m too low."""
    rng = np.random.default_rng(1)
    top = _patch(rng, np.array([1.0, -2.5, -0.6]), np.array([1.8, -1.7, -0.6]), 200)
    seen = np.vstack([_room(rng, 400), top])
    start = _at(np.array([0.0, 0.0, 0.25]))
    reaching = PlaneMap.of([_FLOOR, _TABLE, *_WALLS])
    reaching.seed(seen)
    only_floor = _room(rng, 400)
    only_floor = only_floor[(only_floor[:, 2] > -0.7) | (only_floor[:, 1] > -1.0)]
    # The tie to the start keeps a seventh of the way.
    assert abs(_register(only_floor, reaching, start).p[2]) < 0.05
    endless = PlaneMap.endless([_FLOOR, _TABLE, *_WALLS])
    assert abs(_register(only_floor, endless, start).p[2]) > 0.2


def test_a_plane_reaches_to_the_cells_of_its_points_and_those_around_them() -> None:
    """Oracle: SciPy's dilation; beside what it reached before, at the edges of all there is too. Mutations: corners left out;
    what lies beyond an edge comes in on the other side; one direction forgotten.
    """
    rng = np.random.default_rng(11)
    planes = PlaneMap.of([_FLOOR])
    before = rng.random(planes.reach.shape[1:]) < 0.01
    planes.reach[0] = before
    half_m = 0.5 * MAP.cells * MAP.cell_m
    on_floor = rng.uniform(-half_m, half_m, (300, 3))
    on_floor[:40, 0], on_floor[40:80, 1] = half_m - 1e-3, -half_m
    on_floor[:, 2] = -1.0
    planes.seed(on_floor)
    cells = np.floor(on_floor @ planes.axes[0].T / MAP.cell_m).astype(int) + MAP.cells // 2
    seen = np.zeros_like(before)
    seen[tuple(np.clip(cells, 0, MAP.cells - 1).T)] = True
    np.testing.assert_array_equal(planes.reach[0], before | scipy.ndimage.binary_dilation(seen, np.ones((3, 3))))


def test_a_plane_reaches_on_over_what_is_next_to_it_and_not_across_a_gap() -> None:
    """Fails when points anywhere on the equation are let in, or when the reach never grows."""
    rng = np.random.default_rng(2)
    planes = PlaneMap.of([_FLOOR])
    planes.seed(_patch(rng, np.array([1.0, -1.0, -1.0]), np.array([2.0, 1.0, -1.0]), 400))
    next_to = _patch(rng, np.array([2.0, -1.0, -1.0]), np.array([4.0, 1.0, -1.0]), 800)
    across = _patch(rng, np.array([6.5, -1.0, -1.0]), np.array([7.5, 1.0, -1.0]), 400)
    assert planes.strays(next_to, np.zeros(3)).mean() > 0.5
    planes.spread(np.vstack([next_to, across]), np.zeros(3))
    assert planes.strays(next_to, np.zeros(3)).sum() == 0
    assert planes.strays(across, np.zeros(3)).all()
    beside = np.array([[2.0, 1.0 + 3.5 * MAP.cell_m, -1.0]])
    assert planes.strays(beside, np.zeros(3)).all()


def test_a_new_wall_joins_and_a_copy_of_a_known_one_does_not() -> None:
    """Fails when a drifted copy (2 deg, 5 cm) becomes a plane of its own, or when a doubtful one (5 deg) does."""
    rng = np.random.default_rng(3)
    planes = PlaneMap.of([_FLOOR, *_WALLS])
    wall = _patch(rng, np.array([-5.0, -3.0, -0.8]), np.array([-5.0, 3.0, 0.8]), 1500)
    assert planes.grow(wall, np.zeros(3)) == 1
    assert len(planes.normals) == 4
    assert planes.normals[3] @ [1.0, 0.0, 0.0] > np.cos(np.radians(0.5))
    assert abs(planes.offsets_m[3] - 5.0) < 0.01
    assert planes.strays(wall, np.zeros(3)).mean() < 0.01
    for degrees, reached in ((1.0, True), (5.0, False)):
        a = np.radians(degrees)
        copy = _patch(rng, np.array([4.05, -1.0, -0.8]), np.array([4.05, 1.0, 0.8]), 1500)
        copy[:, 0] += np.tan(a) * copy[:, 1]
        planes.grow(copy, np.zeros(3))
        assert len(planes.normals) == 4
        assert bool(planes.reach[1].any()) is reached
        planes.reach[1], planes.filled[1] = False, 0


def test_a_hedge_close_to_a_wall_does_not_become_a_plane_beside_it() -> None:
    """Fails when only copies within 20 cm are kept out: points between wall and hedge would be of both, and of neither."""
    rng = np.random.default_rng(4)
    planes = PlaneMap.of([_FLOOR, *_WALLS])
    near, clear = (_patch(rng, np.array([x, -1.0, -0.8]), np.array([x, 1.0, 0.8]), 1500) for x in (3.7, 3.5))
    planes.grow(near, np.zeros(3))
    assert len(planes.normals) == 3
    planes.grow(clear, np.zeros(3))
    assert len(planes.normals) == 4


def test_only_planes_that_were_seen_often_are_handed_on() -> None:
    """Fails when a plane found once, in a cloud bent by a wrong pose, reaches the joint solve."""
    rng = np.random.default_rng(4)
    planes = PlaneMap.of([_FLOOR, *_WALLS])
    planes.grow(_patch(rng, np.array([-5.0, -3.0, -0.8]), np.array([-5.0, 3.0, 0.8]), 1500), np.zeros(3))
    given = [_FLOOR, *_WALLS]
    assert planes.planes(given) == given
    for _ in range(5):
        planes.count(np.repeat([0, 3], 40))
    handed = planes.planes(given)
    assert [p.name for p in handed] == ["floor", "x", "y", "plane 4"]


def _spread_one_by_one(planes: PlaneMap, x_map: FloatArray, eye: FloatArray) -> BoolArray:
    """The twin: rounds over all points in their order, by NumPy."""
    reach = planes.reach.copy()
    width = reach.shape[1]
    value, eye_at = x_map @ planes.normals.T + planes.offsets_m, planes.normals @ eye + planes.offsets_m
    away = np.linalg.norm(x_map - eye, axis=1)
    near = np.where(value < eye_at, np.abs(value), np.inf)
    owner = np.where(near.min(axis=1) < MAP.near_m + MAP.near_per_m * away, np.argmin(near, axis=1), -1)
    for _ in range(MAP.spread_passes):
        before = reach.copy()
        for i in np.flatnonzero(owner >= 0):
            row, column = np.floor(planes.axes[owner[i]] @ x_map[i] / MAP.cell_m).astype(int) + width // 2
            if reach[owner[i], row, column]:
                k = 1 + int(away[i] / (MAP.widen_cells * MAP.cell_m))
                reach[owner[i], row - k : row + k + 1, column - k : column + k + 1] = True
                owner[i] = -1
        if np.array_equal(reach, before):
            break
    return reach


@pytest.mark.parametrize("reverse", [False, True])
def test_planes_reach_on_in_rounds_as_point_by_point(reverse: bool) -> None:
    """From a seed on, over floor and walls, in the points' order. Mutations: points seen from behind speak; those that
    wait are forgotten after a round; one round more or less; a far point opens no more cells than a near one; a cell that was
    filled from near by is not from afar; or is taken to be filled before it was reached.
    """
    rng = np.random.default_rng(5)
    planes = PlaneMap.of([_FLOOR, *_WALLS])
    planes.seed(_patch(rng, np.array([3.0, 2.0, -1.0]), np.array([3.4, 2.4, -1.0]), 20))
    planes.seed(_patch(rng, np.array([4.0, 2.0, -0.8]), np.array([4.0, 2.4, 0.0]), 20))
    points = np.vstack(
        [
            _patch(rng, np.array([-20.0, -3.0, -1.0]), np.array([4.0, 3.0, -1.0]), 1200, 0.03),
            _patch(rng, np.array([4.0, -9.0, -0.9]), np.array([4.0, 3.0, 0.8]), 900, 0.03),
        ]
    )
    points = points[np.argsort(points[:, 0] + points[:, 1])]
    points = points[::-1].copy() if reverse else points
    eye = np.array([0.5, 0.2, 0.1])
    expected, before = _spread_one_by_one(planes, points, eye), planes.reach.copy()
    planes.spread(points, eye)
    np.testing.assert_array_equal(planes.reach, expected)
    assert planes.reach.sum() > 2 * before.sum()
    afar = np.array([20.5, 0.2, 8.1])
    expected, nearby = _spread_one_by_one(planes, points, afar), planes.reach.copy()
    planes.spread(points, afar)
    np.testing.assert_array_equal(planes.reach, expected)
    assert planes.reach.sum() > 1.1 * nearby.sum()
    planes.reach[:], planes.filled[:] = before, 0
    planes.spread(points, np.array([0.5, 0.2, -3.0]))  # from under the floor
    np.testing.assert_array_equal(planes.reach[0], before[0])
