"""IMU factors: zero on true motion, Jacobians by finite differences, and what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.paper.imu_factor import imu_factors, imu_residuals
from calib_core.paper.lidar_factor import CalibrationState, ScanStates
from tests.core.paper import build

STILL = CalibrationState(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), 0.0)


@pytest.fixture
def problem():
    rng = np.random.default_rng(50)
    return build.preintegrated(rng, 4), rng.uniform(0.05, 0.3, 4), build.states(rng, 4), build.states(rng, 4)


def test_zero_on_free_fall_and_on_a_turn():
    """A thrown, spinning body has Dv = Dp = 0 and DR its turn. Mutation: T instead of T^2 / 2 on gravity in r_p."""
    rng = np.random.default_rng(51)
    T = np.array([0.1, 0.4])
    first = build.states(rng, 2)
    turn = Rotation.from_rotvec(rng.normal(size=(2, 3))).as_matrix()
    second = ScanStates(
        first.R @ turn,
        first.p + T[:, None] * first.v + 0.5 * T[:, None] ** 2 * build.GRAVITY,
        first.v + T[:, None] * build.GRAVITY,
    )
    measured = replace(build.preintegrated(rng, 2), DR=turn, Dv=np.zeros((2, 3)), Dp=np.zeros((2, 3)))
    residual = imu_residuals(measured, T, first, second, STILL, build.GRAVITY)
    np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_jacobians(problem):
    """Every block by central differences, at residuals of radians. Mutation: without the inverse right Jacobian."""
    measured, T, first, second = problem
    c = build.calibration(np.random.default_rng(52))
    g = build.GRAVITY
    f = imu_factors(measured, T, first, second, c, g)
    assert np.abs(f.residual[:, :3]).max() > 1.0
    for k in range(3):
        unit = np.eye(3)[k]
        blocks = (
            (k, "R", lambda s, h, k=k: replace(s, R=build.turned(s.R, k, h))),
            (3 + k, "p", lambda s, h, u=unit: replace(s, p=s.p + h * u)),
            (6 + k, "v", lambda s, h, u=unit: replace(s, v=s.v + h * u)),
        )
        for column, _, move in blocks:
            build.check(
                f.r_D_first[:, :, column], lambda h, move=move: imu_residuals(measured, T, move(first, h), second, c, g)
            )
            build.check(
                f.r_D_second[:, :, column],
                lambda h, move=move: imu_residuals(measured, T, first, move(second, h), c, g),
            )
        for name, block in (("gyro_bias_delta", f.r_D_bg), ("accel_bias_delta", f.r_D_ba)):
            build.check(
                block[:, :, k],
                lambda h, name=name, u=unit: imu_residuals(
                    measured, T, first, second, replace(c, **{name: getattr(c, name) + h * u}), g
                ),
            )
    build.check(
        f.r_D_t, lambda h: imu_residuals(measured, T, first, second, replace(c, time_delta_s=c.time_delta_s + h), g)
    )


def test_the_extrinsic_does_not_intervene(problem):
    """As the paper notes in IV-A.3: R_c and p_c are not in the IMU residuals. Mutation: any use of them."""
    measured, T, first, second = problem
    c = build.calibration(np.random.default_rng(53))
    other = replace(c, R_imu_lidar=np.full((3, 3), np.nan), p_imu_lidar=np.full(3, np.nan))
    np.testing.assert_array_equal(
        imu_residuals(measured, T, first, second, c, build.GRAVITY),
        imu_residuals(measured, T, first, second, other, build.GRAVITY),
    )


def test_moving_the_world_changes_nothing(problem):
    """Turned about the vertical, shifted, and seen from a steady train. Mutation: R instead of R' in r_v."""
    measured, T, first, second = problem
    yaw, shift, speed = Rotation.from_rotvec([0.0, 0.0, -2.0]).as_matrix(), np.array([3.0, -1.0, 2.0]), np.ones(3)

    def moved(s, elapsed):
        return ScanStates(yaw @ s.R, (s.p + shift + elapsed * speed) @ yaw.T, (s.v + speed) @ yaw.T)

    np.testing.assert_allclose(
        imu_residuals(measured, T, moved(first, 0.0 * T[:, None]), moved(second, T[:, None]), STILL, build.GRAVITY),
        imu_residuals(measured, T, first, second, STILL, build.GRAVITY),
        atol=1e-11,
    )
