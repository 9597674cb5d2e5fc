"""Noise on the implicit residual against Monte Carlo, and eq. (14) against itself written out."""

from dataclasses import replace

import numpy as np
import pytest

from calib_core.geometry import exp
from calib_core.paper.lidar_factor import lidar_distances, lidar_factors
from calib_core.paper.weights import balance, balanced_weights, distance_variance, identity_weights
from tests.core.paper import build


def test_variance_of_a_distance():
    """Range, DR and Dp drawn from their covariances: the spread of d is as propagated. Mutation: cov_v for cov_p."""
    rng = np.random.default_rng(60)
    m, s, R0 = build.lidar(rng, 5), build.states(rng, 5), build.rotations(rng, 1)[0]
    c = replace(build.calibration(rng), gyro_bias_delta=np.zeros(3), accel_bias_delta=np.zeros(3), time_delta_s=0.0)
    pre = m.preintegrated
    claimed = distance_variance(lidar_factors(m, c, s, R0, build.GRAVITY), pre, m.points_lidar, 0.02)
    beam = m.points_lidar / np.linalg.norm(m.points_lidar, axis=1, keepdims=True)
    root_R, root_p = (
        np.linalg.cholesky(pre.cov_R + 1e-12 * np.eye(3)),
        np.linalg.cholesky(pre.cov_p + 1e-12 * np.eye(3)),
    )
    draws = []
    for _ in range(4000):
        turn = np.einsum("nij,nj->ni", root_R, rng.normal(size=(5, 3)))
        push = np.einsum("nij,nj->ni", root_p, rng.normal(size=(5, 3)))
        noisy = replace(
            m,
            points_lidar=m.points_lidar + 0.02 * rng.normal(size=(5, 1)) * beam,
            preintegrated=replace(pre, DR=pre.DR @ exp(turn), Dp=pre.Dp + push),
        )
        draws.append(lidar_distances(noisy, c, s, R0, build.GRAVITY))
    # The sample variance of 4000 draws is known to 2.2 %; attitudes of a few hundredths leave second-order terms.
    np.testing.assert_allclose(np.var(draws, axis=0), claimed, rtol=0.12)


def test_balance_is_equation_14():
    """3 N / M mean(1 / var) mean(tr(cov)), by a loop. Mutation: the mean of 1 / var replaced by 1 / mean(var)."""
    rng = np.random.default_rng(61)
    inverse_var, root = rng.uniform(1.0, 9.0, 50), rng.normal(size=(7, 3, 3))
    cov = root @ np.swapaxes(root, 1, 2)
    expected = 3.0 * 50 / 8 * (sum(inverse_var) / 50) * (sum(np.trace(each) for each in cov) / 7)
    assert balance(50, 8, inverse_var, cov) == pytest.approx(expected, rel=1e-12)


def test_weight_of_a_pair_is_lambda_times_its_inverse_covariance():
    """sqrt_info' sqrt_info = lambda cov^-1 in each block, nothing between them. Mutation: lambda not under the root."""
    rng = np.random.default_rng(62)
    root = rng.normal(size=(3, 4, 3, 3))
    cov = 1e-4 * (root @ np.swapaxes(root, 2, 3) + np.eye(3))
    inverse_var = np.full(100, 2500.0)
    weights = balanced_weights(inverse_var, 5, cov)
    info = np.swapaxes(weights.sqrt_info, 1, 2) @ weights.sqrt_info
    for i in range(3):
        block = slice(3 * i, 3 * i + 3)
        expected = balance(100, 5, inverse_var, cov[i]) * np.linalg.inv(cov[i])
        # The floor adds a hundredth of the typical variance to every covariance.
        np.testing.assert_allclose(
            np.trace(info[:, block, block] @ cov[i], axis1=1, axis2=2),
            np.trace(expected @ cov[i], axis1=1, axis2=2),
            rtol=0.1,
        )
        info[:, block, block] = 0.0
    np.testing.assert_array_equal(info, 0.0)


def test_level_of_the_inertial_noise_cancels():
    """Eq. (14) is blind to it: all covariances a thousandfold give the same weights.

    Mutation: lambda without the trace.
    """
    rng = np.random.default_rng(63)
    root = rng.normal(size=(3, 4, 3, 3))
    cov = root @ np.swapaxes(root, 2, 3) + np.eye(3)
    once, more = balanced_weights(np.ones(9), 3, cov), balanced_weights(np.ones(9), 3, 1000.0 * cov)
    np.testing.assert_allclose(more.sqrt_info, once.sqrt_info, rtol=1e-9)


def test_first_round_weighs_everything_alike():
    """Unit covariances: distances 1, every inertial component the same lambda.

    Mutation: no eq. (14) in the first round.
    """
    weights = identity_weights(300, 10, 4)
    np.testing.assert_array_equal(weights.inverse_var_d, 1.0)
    info = np.swapaxes(weights.sqrt_info, 1, 2) @ weights.sqrt_info
    np.testing.assert_allclose(info, np.broadcast_to(3.0 * 300 / 10 * 3.0 * np.eye(9), (4, 9, 9)), rtol=1e-9)


def test_readings_without_noise():
    """Covariances of zero give finite weights, distances without noise a finite variance. Mutation: no floors."""
    weights = balanced_weights(np.ones(9), 3, np.zeros((3, 4, 3, 3)))
    assert np.all(np.isfinite(weights.sqrt_info))
