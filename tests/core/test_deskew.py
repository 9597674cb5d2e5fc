"""Motion taken out of a simulated sweep with its true trajectory: what is left is the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.deskew import deskew_points, lidar_poses, map_points
from calib_core.geometry import exp
from calib_core.maps.accumulate import covers
from calib_core.simulate import Simulation, prepare
from calib_core.simulate.layouts import scan_of
from calib_core.types import FloatArray, Scan, Trajectory


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return prepare("paper-fast", duration_s=5.0, noise=False)


@pytest.fixture(scope="module")
def scan(simulation: Simulation) -> Scan:
    """Swept at 1.5 rad/s and half a metre a second."""
    return scan_of(simulation.cloud(41))


@pytest.fixture(scope="module")
def trajectory(simulation: Simulation) -> Trajectory:
    """The true motion every 5 ms, on an epoch of its own."""
    truth = simulation.truth
    times = 0.005 * np.arange(1001)
    R, p = truth.map_lidar(times)
    epoch = truth.epoch_ns - 2_000_000_000
    return Trajectory(epoch, times + 2.0, R, p, np.ones(len(times), bool))


def _to_faces_m(points: FloatArray, simulation: Simulation) -> FloatArray:
    """Distance of each point to the nearest of the room's six planes."""
    planes = simulation.truth.planes
    normals = np.array([p.normal for p in planes])
    return np.abs(points @ normals.T + np.array([p.offset_m for p in planes])).min(axis=1)


def as_if_still(scan: Scan, trajectory: Trajectory) -> FloatArray:
    """The scan's points in the map frame as if the sweep had been motionless."""
    R, p = lidar_poses(trajectory, np.array([(scan.stamp_ns - trajectory.epoch_ns) * 1e-9]))
    return scan.points["xyz"].astype(np.float64) @ R[0].T + p[0]


def test_map_points_lie_on_the_true_room(simulation: Simulation, scan: Scan, trajectory: Trajectory) -> None:
    """Fails when every point gets its scan's pose (no offset_ns), or the epoch is not taken off the stamps.

    Coordinates are rounded to float32 at metres (0.5 um), ranges by the driver's packets to 2 mm.
    """
    left = _to_faces_m(map_points(scan, trajectory).astype(np.float64), simulation)
    assert np.percentile(left, 99.9) < 0.003
    assert np.percentile(_to_faces_m(as_if_still(scan, trajectory), simulation), 50) > 0.01


def test_a_scan_that_was_stamped_late_is_laid_where_it_was_taken(
    simulation: Simulation, scan: Scan, trajectory: Trajectory
) -> None:
    """By 20 ms at half a metre a second and 1.5 rad/s: walls are 10 mm and more off if its stamp is believed.

    Mutation: `late_ns` added instead of taken off.
    """
    late = replace(scan, stamp_ns=scan.stamp_ns + 20_000_000)
    assert np.median(_to_faces_m(map_points(late, trajectory).astype(np.float64), simulation)) > 0.01
    told = replace(trajectory, late_ns={late.stamp_ns: 20_000_000, 7: 3})
    np.testing.assert_array_equal(map_points(late, told), map_points(scan, trajectory))
    np.testing.assert_array_equal(deskew_points(late, told), deskew_points(scan, trajectory))
    # A motion that ends 90 ms into the sweep, which a map still lays, and 110 ms before the sweep's end as it is stamped.
    ending = replace(told, times_s=told.times_s + trajectory.begin_s(scan) + 0.09 - told.times_s[-1])
    assert covers(ending, late)
    assert not covers(replace(ending, late_ns={}), late)


def test_deskewed_points_are_seen_from_the_sweeps_start(
    simulation: Simulation, scan: Scan, trajectory: Trajectory
) -> None:
    """Fails when the map's points are turned by R instead of R' on the way back.

    Twin: the true pose of every single point and of the first, from the simulator. Instants are rounded to 20 us,
    0.2 mm at arm's length times ten and 3 rad/s.
    """
    truth = simulation.truth
    start = (scan.stamp_ns - truth.epoch_ns) * 1e-9
    R, p = truth.map_lidar(start + scan.points["offset_ns"][::50] * 1e-9)
    R0, p0 = truth.map_lidar(np.array([start]))
    in_map = np.einsum("nij,nj->ni", R, scan.points["xyz"][::50].astype(np.float64)) + p
    np.testing.assert_allclose(deskew_points(scan, trajectory)[::50], (in_map - p0[0]) @ R0[0], atol=4e-4)
    first = np.argmin(scan.points["offset_ns"])
    np.testing.assert_allclose(deskew_points(scan, trajectory)[first], scan.points["xyz"][first], atol=2e-4)


def test_poses_between_knots_and_beyond_them(simulation: Simulation, trajectory: Trajectory) -> None:
    """Fails when the ends are extrapolated, or the turn between knots is applied on the left."""
    t = np.linspace(3.0, 4.0, 97)
    R, p = lidar_poses(trajectory, t + 2.0)
    R_true, p_true = simulation.truth.map_lidar(t)
    np.testing.assert_allclose(R, R_true, atol=1e-4)
    np.testing.assert_allclose(p, p_true, atol=1e-4)
    R, p = lidar_poses(trajectory, np.array([0.0, 99.0]))
    np.testing.assert_allclose(R, trajectory.R_map_lidar[[0, -1]], atol=1e-14)
    np.testing.assert_array_equal(p, trajectory.p_map_lidar[[0, -1]])


def test_without_motion_nothing_changes(scan: Scan) -> None:
    """Fails when a standing lidar's points are moved to the map's origin and not back."""
    R = np.repeat(np.array([[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]), 2, axis=0)
    still = Trajectory(
        scan.stamp_ns - 10**9, np.array([0.0, 2.0]), R, np.tile([1.0, 2.0, 3.0], (2, 1)), np.ones(2, bool)
    )
    np.testing.assert_allclose(deskew_points(scan, still), scan.points["xyz"], atol=2e-6)
    np.testing.assert_array_equal(map_points(scan, still), as_if_still(scan, still).astype(np.float32))


def test_points_in_any_order_beyond_the_ends_and_after_long_turns(scan: Scan) -> None:
    """Held against each point's own pose (`lidar_poses`): knots 0.1 s apart with turns of up to 3 rad between them and one of
    none, points in no order of time, the first and last of them half a second outside of the motion.

    Mutations: a knot is only ever sought forwards, or only backwards; f is not held to 0 and 1; the series taken at any angle;
    the turn taken from the right.
    """
    rng = np.random.default_rng(3)
    turns = rng.uniform(-1.7, 1.7, (9, 3))
    turns[4] = 0.0
    R = [np.eye(3)]
    for turn in turns:
        R.append(R[-1] @ exp(turn))
    times_s, p = 0.1 * np.arange(10), rng.normal(size=(10, 3))
    motion = Trajectory(scan.stamp_ns - 10**9, times_s + 1.0, np.array(R), p, np.ones(10, bool))
    points = scan.points[:4000].copy()
    points["offset_ns"] = rng.integers(0, 2 * 10**9, len(points))
    some = replace(scan, stamp_ns=scan.stamp_ns - 500_000_000, points=points)
    R_at, p_at = lidar_poses(motion, 0.5 + points["offset_ns"] * 1e-9)
    twin = np.einsum("nij,nj->ni", R_at, points["xyz"].astype(np.float64)) + p_at
    np.testing.assert_allclose(map_points(some, motion), twin, rtol=2e-7, atol=2e-7)


def test_no_points_are_no_points(scan: Scan, trajectory: Trajectory) -> None:
    """Mutation: the earliest of no instants is asked for."""
    assert map_points(replace(scan, points=scan.points[:0]), trajectory).shape == (0, 3)
