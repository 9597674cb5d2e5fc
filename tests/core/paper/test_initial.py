"""Start values from motion written down here: rough poses, time shift, rotation, vertical, knots."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.paper import initial
from calib_core.paper.lidar_factor import CalibrationState
from calib_core.paper.scan_pose import rough_pose
from calib_core.paper.timeline import build_timeline

MOUNTING = Rotation.from_rotvec([0.4, -1.0, 0.7])
LEVER = np.array([0.1, -0.05, 0.2])


def attitude(t):
    """World <- imu."""
    return Rotation.from_euler(
        "ZYX", np.stack([0.5 * np.sin(2.0 * t), 0.3 * np.sin(3.1 * t), 0.4 * np.cos(2.3 * t)], axis=1)
    )


def rate(t, h=1e-5):
    """Body rate by differences of the attitude: no formula shared with the code."""
    return (attitude(t - h).inv() * attitude(t + h)).as_rotvec() / (2.0 * h)


def position(t):
    return np.stack([0.1 * np.sin(2.2 * t), 0.08 * np.cos(1.7 * t), 0.05 * np.sin(3.0 * t)], axis=1)


def rough(t):
    """Exact lidar poses in the map, the lidar frame at t[0]."""
    lidar = attitude(t) * MOUNTING
    p = position(t) + attitude(t).apply(LEVER)
    return initial.RoughPoses(t, (lidar[0].inv() * lidar).as_matrix(), lidar[0].inv().apply(p - p[0]))


@pytest.mark.parametrize("shift", [-0.31, 0.0, 0.0127])
def test_time_shift(shift: float):
    """Found to half a millisecond from magnitudes alone. Mutation: `lidar_s + shift`."""
    t = np.arange(0.0, 12.0, 0.1)
    stamps = np.arange(-1.0, 13.0, 0.01)
    gyro = initial.GyroAttitude.integrate(stamps, rate(stamps + shift))
    assert initial.time_shift(rough(t), gyro) == pytest.approx(shift, abs=5e-4)


def test_time_shift_passes_over_gaps():
    """A pair of scans seconds apart says nothing of the rate. Mutation: no limit on the span."""
    t = np.concatenate([np.arange(0.0, 5.0, 0.1), np.arange(8.0, 13.0, 0.1)])
    stamps = np.arange(-1.0, 14.0, 0.01)
    poses = rough(t)
    poses.R[50:] = poses.R[50:] @ Rotation.from_rotvec([2.0, 0.0, 0.0]).as_matrix()
    # After the gap the map is turned by two radians: only the pair across it can see that.
    gyro = initial.GyroAttitude.integrate(stamps, rate(stamps - 0.05))
    turned = initial.RoughPoses(t, poses.R, poses.p)
    assert initial.time_shift(turned, gyro) == pytest.approx(-0.05, abs=5e-4)


def test_extrinsic_rotation():
    """To 0.01 deg, with a gyroscope in its own frame. Mutation: of_lidar.T @ of_imu."""
    t = np.arange(0.0, 8.0, 0.1)
    stamps = np.arange(-0.5, 9.0, 0.005)
    gyro = initial.GyroAttitude.integrate(stamps, rate(stamps))
    found = Rotation.from_matrix(initial.extrinsic_rotation(rough(t), gyro, 0.0))
    assert np.degrees((found * MOUNTING.inv()).magnitude()) < 0.02


@pytest.mark.parametrize("force", [[0.0, 0.0, 9.8], [0.0, 0.0, -9.8], [3.0, -4.0, 8.0]])
def test_upright(force):
    """A rotation that puts the specific force on +z. Mutation: the cross product's factors swapped."""
    R = initial.upright(np.array(force))
    np.testing.assert_allclose(R @ np.array(force), [0.0, 0.0, np.linalg.norm(force)], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_states_at_knots():
    """Exact poses and lever arm give the IMU's own motion. Mutation: p_imu_lidar left out of the positions."""
    t = np.arange(0.0, 6.0, 0.1)
    stamps = np.arange(-0.5, 7.0, 0.002)
    gyro = initial.GyroAttitude.integrate(stamps, rate(stamps + 0.03))
    shared = CalibrationState(MOUNTING.as_matrix(), LEVER, np.zeros(3), np.zeros(3), 0.0)
    knots = np.concatenate([[0.0], np.arange(0.03, 5.5, 0.1)])
    found = initial.initial_states(rough(t), gyro, knots, shared, attitude(t[:1]).as_matrix()[0], 0.03)
    np.testing.assert_allclose(found.R, attitude(knots).as_matrix(), atol=2e-4)
    np.testing.assert_allclose(found.p, position(knots) - position(knots[:1]), atol=2e-3)
    speed = (position(knots + 1e-5) - position(knots - 1e-5)) / 2e-5
    np.testing.assert_allclose(found.v[1:], speed[1:], atol=2e-2)


def test_rough_pose():
    """Eq. (13) from a start 10 deg and 20 cm off, to rounding. Mutation: the turn's column as cross(n @ R, x)."""
    rng = np.random.default_rng(80)
    normals = np.eye(3)[rng.integers(3, size=90)] + 0.1 * rng.normal(size=(90, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    R, p = Rotation.from_rotvec([0.1, -0.12, 0.08]).as_matrix(), np.array([0.1, -0.15, 0.05])
    points = 3.0 * rng.normal(size=(90, 3))
    offsets = -np.einsum("ni,ni->n", normals, points @ R.T + p)
    found = rough_pose(points, normals, offsets, np.eye(3), np.zeros(3))
    np.testing.assert_allclose(found[0], R, atol=1e-8)
    np.testing.assert_allclose(found[1], p, atol=1e-8)


def test_knots_fill_gaps():
    """A gap of three periods gets its two knots; a late scan does not.

    Mutation: `span / period_s` without rounding up to 1.
    """
    start = np.array([0.0, 0.1, 0.22, 0.52, 0.62])
    timeline = build_timeline(range(7, 12), start, 0.1)
    np.testing.assert_allclose(timeline.start_s, [0.0, 0.1, 0.22, 0.32, 0.42, 0.52, 0.62])
    np.testing.assert_array_equal(timeline.position, [7, 8, 9, -1, -1, 10, 11])
    np.testing.assert_allclose(timeline.duration_s, [0.1, 0.12, 0.1, 0.1, 0.1, 0.1, 0.1])
