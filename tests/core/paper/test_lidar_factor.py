"""Lidar factors against the equations written point by point, and their Jacobians against finite differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.paper.lidar_factor import ScanStates, lidar_distances, lidar_factors
from tests.core.paper import build


@pytest.fixture
def problem():
    rng = np.random.default_rng(40)
    return build.lidar(rng, 6), build.calibration(rng), build.states(rng, 6), build.rotations(rng, 1)[0]


def test_equations_one_by_one(problem):
    """(7), (8), (9), (10) with homogeneous matrices, point by point.

    Mutation: 1/2 left out of (4), or R_c' for R_c in (9).
    """
    m, c, s, R0 = problem
    distances = lidar_distances(m, c, s, R0, build.GRAVITY)
    for i in range(6):
        pre = m.preintegrated
        rotvec = pre.DR_D_bg[i] @ c.gyro_bias_delta + pre.DR_D_t[i] * c.time_delta_s
        DR = pre.DR[i] @ Rotation.from_rotvec(rotvec).as_matrix()
        Dp = pre.Dp[i] + pre.Dp_D_bg[i] @ c.gyro_bias_delta + pre.Dp_D_ba[i] @ c.accel_bias_delta
        Dp = Dp + pre.Dp_D_t[i] * c.time_delta_s
        z = m.elapsed_s[i]
        T_imu_lidar, T_world_imu, T_world_first = np.eye(4), np.eye(4), np.eye(4)
        T_imu_lidar[:3, :3], T_imu_lidar[:3, 3] = c.R_imu_lidar, c.p_imu_lidar
        T_world_imu[:3, :3] = s.R[i] @ DR
        T_world_imu[:3, 3] = s.p[i] + z * s.v[i] + z**2 / 2 * build.GRAVITY + s.R[i] @ Dp
        T_world_first[:3, :3] = R0
        chain = np.linalg.inv(T_imu_lidar) @ np.linalg.inv(T_world_first) @ T_world_imu @ T_imu_lidar
        in_map = (chain @ np.append(m.points_lidar[i], 1.0))[:3]
        assert distances[i] == pytest.approx(m.normals_map[i] @ in_map + m.offsets_m[i], abs=1e-12)


def test_jacobians(problem):
    """Every block by central differences, at distances of metres. Mutation: drop `cross(n, q)` from dist_D_phic."""
    m, c, s, R0 = problem
    f = lidar_factors(m, c, s, R0, build.GRAVITY)
    g = build.GRAVITY
    np.testing.assert_allclose(f.dist_m, lidar_distances(m, c, s, R0, g), atol=1e-13)
    for k in range(3):
        unit = np.eye(3)[k]

        def shared(name, unit=unit):
            value = getattr(c, name)
            return lambda h: lidar_distances(m, replace(c, **{name: value + h * unit}), s, R0, g)

        build.check(
            f.dist_D_phi[:, k],
            lambda h, k=k: lidar_distances(m, c, replace(s, R=build.turned(s.R, k, h)), R0, g),
        )
        build.check(f.dist_D_p[:, k], lambda h, u=unit: lidar_distances(m, c, replace(s, p=s.p + h * u), R0, g))
        build.check(f.dist_D_v[:, k], lambda h, u=unit: lidar_distances(m, c, replace(s, v=s.v + h * u), R0, g))
        build.check(f.dist_D_phi0[:, k], lambda h, k=k: lidar_distances(m, c, s, build.turned(R0, k, h), g))
        build.check(
            f.dist_D_phic[:, k],
            lambda h, k=k: lidar_distances(m, replace(c, R_imu_lidar=build.turned(c.R_imu_lidar, k, h)), s, R0, g),
        )
        build.check(f.dist_D_pc[:, k], shared("p_imu_lidar"))
        build.check(f.dist_D_bg[:, k], shared("gyro_bias_delta"))
        build.check(f.dist_D_ba[:, k], shared("accel_bias_delta"))
        build.check(
            f.dist_D_point[:, k],
            lambda h, u=unit: lidar_distances(replace(m, points_lidar=m.points_lidar + h * u), c, s, R0, g),
        )
    build.check(f.dist_D_t, lambda h: lidar_distances(m, replace(c, time_delta_s=c.time_delta_s + h), s, R0, g))


def test_jacobians_of_the_measurements(problem):
    """Noise enters DR after the correction and Dp directly (III-A). Mutation: dist_D_DR without the rotation DR."""
    m, c, s, R0 = problem
    still = replace(c, gyro_bias_delta=np.zeros(3), accel_bias_delta=np.zeros(3), time_delta_s=0.0)
    f = lidar_factors(m, still, s, R0, build.GRAVITY)
    for k in range(3):

        def moved(h, k=k, of="DR"):
            pre = m.preintegrated
            DR, Dp = (build.turned(pre.DR, k, h), pre.Dp) if of == "DR" else (pre.DR, pre.Dp + h * np.eye(3)[k])
            return lidar_distances(replace(m, preintegrated=replace(pre, DR=DR, Dp=Dp)), still, s, R0, build.GRAVITY)

        build.check(f.dist_D_DR[:, k], moved)
        build.check(f.dist_D_Dp[:, k], lambda h, k=k: moved(h, k, "Dp"))


def test_the_checker_sees_a_flipped_sign(problem):
    """The checker itself: a wrong sign does not pass. Mutation: an absolute value in `check`."""
    m, c, s, R0 = problem
    f = lidar_factors(m, c, s, R0, build.GRAVITY)
    with pytest.raises(AssertionError):
        build.check(
            -f.dist_D_p[:, 0], lambda h: lidar_distances(m, c, replace(s, p=s.p + h * np.eye(3)[0]), R0, build.GRAVITY)
        )


def test_turning_the_world_about_the_vertical_changes_nothing(problem):
    """The one direction held in the solve is a gauge. Mutation: R0 forgotten in (9)."""
    m, c, s, R0 = problem
    yaw = Rotation.from_rotvec([0.0, 0.0, 1.1]).as_matrix()
    same = ScanStates(yaw @ s.R, s.p @ yaw.T, s.v @ yaw.T)
    np.testing.assert_allclose(
        lidar_distances(m, c, same, yaw @ R0, build.GRAVITY), lidar_distances(m, c, s, R0, build.GRAVITY), atol=1e-11
    )


def test_positive_on_the_side_of_the_normal(problem):
    """Moving a point along the map's normal raises its distance by as much. Mutation: w subtracted."""
    m, c, s, R0 = problem
    before = lidar_distances(m, c, s, R0, build.GRAVITY)
    after = lidar_distances(replace(m, offsets_m=m.offsets_m + 0.25), c, s, R0, build.GRAVITY)
    np.testing.assert_allclose(after - before, 0.25, atol=1e-12)
