"""The whole cost: gradient and normal matrix against differences of it, what is held, and the descent."""

import numpy as np
import pytest

from calib_core.paper.lidar_factor import LidarMeasurements
from calib_core.paper.problem import N_SHARED, PaperProblem, PaperState, covariance_of_calibration
from calib_core.paper.records import ImuStates
from calib_core.paper.solve import descend
from calib_core.paper.weights import Weights
from calib_core.solver.arrow import solve_arrow
from tests.core.paper import build

KNOTS, POINTS = 4, 40


def make(seed=90, *, fixed=False):
    """A small random problem and a state."""
    rng = np.random.default_rng(seed)
    lidar = build.lidar(rng, POINTS)
    knot = np.sort(rng.integers(1, KNOTS, POINTS))
    root = rng.normal(size=(KNOTS - 1, 9, 9)) + 3.0 * np.eye(9)
    weights = Weights(rng.uniform(0.5, 2.0, POINTS), root)
    problem = PaperProblem(
        lidar,
        knot,
        build.preintegrated(rng, KNOTS - 1),
        rng.uniform(0.1, 0.2, KNOTS - 1),
        build.GRAVITY,
        weights,
        fixed,
    )
    s = build.states(rng, KNOTS)
    p = s.p.copy()
    p[0] = 0.0
    return problem, PaperState(build.calibration(rng), ImuStates(s.R, p, s.v))


@pytest.mark.parametrize("fixed", [False, True])
def test_gradient(fixed: bool):
    """Every component against a difference of the cost. Mutation: the first pair's attitude not moved to the border."""
    problem, state = make(fixed=fixed)
    system = problem.linearised(state)
    assert system.cost == pytest.approx(problem.cost(state), rel=1e-12)
    h = 1e-6
    for index in range(KNOTS * 9 + N_SHARED):
        flat = np.zeros(KNOTS * 9 + N_SHARED)
        flat[index] = h
        step, shared = flat[: KNOTS * 9].reshape(KNOTS, 9), flat[KNOTS * 9 :]
        slope = (problem.cost(state.moved(step, shared)) - problem.cost(state.moved(-step, -shared))) / (2.0 * h)
        found = np.concatenate([system.gradient.ravel(), system.gradient_shared])[index]
        held = index < 6 or (fixed and (index < KNOTS * 9 or index >= KNOTS * 9 + 13))
        assert found == pytest.approx(0.0 if held else slope, rel=1e-6, abs=1e-5 * system.cost)


def test_normal_matrix_is_that_of_the_residuals():
    """J'J from differences of the residuals, dense, in the same places. Mutation: `lower` transposed."""
    problem, state = make()
    system = problem.linearised(state)
    size = KNOTS * 9 + N_SHARED
    dense = np.zeros((size, size))
    for k in range(KNOTS):
        rows = slice(9 * k, 9 * k + 9)
        dense[rows, rows] = system.diagonal[k]
        dense[rows, KNOTS * 9 :] = system.border[k]
        dense[KNOTS * 9 :, rows] = system.border[k].T
        if k:
            before = slice(9 * k - 9, 9 * k)
            dense[rows, before] = system.lower[k - 1]
            dense[before, rows] = system.lower[k - 1].T
    dense[KNOTS * 9 :, KNOTS * 9 :] = system.corner

    def residuals(flat):
        moved = state.moved(flat[: KNOTS * 9].reshape(KNOTS, 9), flat[KNOTS * 9 :])
        from calib_core.paper.imu_factor import imu_residuals
        from calib_core.paper.lidar_factor import ScanStates

        k = moved.knots
        first, second = ScanStates(k.R[:-1], k.p[:-1], k.v[:-1]), ScanStates(k.R[1:], k.p[1:], k.v[1:])
        imu = imu_residuals(problem.links, problem.duration_s, first, second, moved.shared, build.GRAVITY)
        whitened = (problem.weights.sqrt_info @ imu[..., None]).ravel()
        return np.concatenate([np.sqrt(problem.weights.inverse_var_d) * problem.distances(moved), whitened])

    h = 1e-6
    jacobian = np.stack([(residuals(h * e) - residuals(-h * e)) / (2.0 * h) for e in np.eye(size)], axis=1)
    jacobian[:, :6] = 0.0
    expected = jacobian.T @ jacobian
    expected[np.arange(6), np.arange(6)] = 1.0
    np.testing.assert_allclose(dense, expected, atol=2e-5 * np.abs(expected).max())


def test_yaw_is_held_and_the_first_position_is_zero():
    """No step moves either. Mutation: three columns of the first attitude's basis."""
    _, state = make()
    rng = np.random.default_rng(91)
    moved = state.moved(rng.normal(size=(KNOTS, 9)) * [1, 1, 1, 0, 0, 0, 1, 1, 1], rng.normal(size=N_SHARED))
    turn = state.knots.R[0] @ moved.knots.R[0].T
    # A turn about a horizontal axis of the world leaves that axis: no vertical part in the rotation vector.
    np.testing.assert_allclose(turn[1, 0] - turn[0, 1], 0.0, atol=1e-12)
    np.testing.assert_array_equal(moved.knots.p[0], 0.0)


def test_descent_reaches_a_stationary_point_and_never_climbs():
    """Cost falls at every accepted step, and at the end the gradient is gone. Mutation: accept whatever the gain."""
    problem, state = make(93)
    costs = [problem.cost(state)]
    result = descend(problem, state, max_iterations=200, on_step=lambda _, system: costs.append(system.cost))
    assert np.all(np.diff(costs) < 0.0)
    assert result.converged
    scaled = result.system.gradient / np.sqrt(np.einsum("kii->ki", result.system.diagonal))
    assert np.abs(scaled).max() < 1e-3 * np.sqrt(result.system.cost)


def test_covariance_is_the_marginal_one():
    """The (7, 7) block of the inverse of the whole matrix. Mutation: the inverse of the corner alone."""
    problem, state = make(94)
    system = problem.linearised(state)
    size = KNOTS * 9
    dense = np.zeros((size + N_SHARED, size + N_SHARED))
    for k in range(KNOTS):
        rows = slice(9 * k, 9 * k + 9)
        dense[rows, rows] = system.diagonal[k]
        dense[rows, size:] = system.border[k]
        if k:
            dense[rows, 9 * k - 9 : 9 * k] = system.lower[k - 1]
    dense[size:, size:] = system.corner
    dense = np.tril(dense) + np.tril(dense, -1).T
    dense[:size, size:] = np.concatenate(system.border)
    dense[size:, :size] = dense[:size, size:].T
    # The contract's standing prior: 1 rad, 10 m, 10 s; as wide for the biases and the first attitude.
    dense[range(size, size + 15), range(size, size + 15)] += [1.0] * 3 + [0.01] * 4 + [1.0] * 3 + [0.01] * 3 + [1.0] * 2
    expected = np.linalg.inv(dense)[size : size + 7, size : size + 7]
    np.testing.assert_allclose(covariance_of_calibration(solve_arrow(system)), expected, rtol=1e-8, atol=1e-10)


def test_points_of_a_scan_touch_only_their_knot():
    """NaN in a knot that no point and no pair looks at would spread. Mutation: states taken by point, not by knot."""
    problem, state = make(95)
    assert isinstance(problem.lidar, LidarMeasurements)
    before = problem.distances(state)
    v = state.knots.v.copy()
    v[2] = np.nan
    after = problem.distances(PaperState(state.shared, ImuStates(state.knots.R, state.knots.p, v)))
    np.testing.assert_array_equal(np.isnan(after), problem.knot_of_point == 2)
    np.testing.assert_array_equal(after[problem.knot_of_point != 2], before[problem.knot_of_point != 2])
