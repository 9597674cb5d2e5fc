"""Chains with a direction that no plane sees, against a slow elimination with more digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors.imu import KnotStates
from calib_core.full.assess.influence import factor_influences
from calib_core.full.joint.priors import Priors, prior_rows
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, GRAVITY, BiasNodes, Bins, Estimate
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.joint.unseen import Unseen
from calib_core.imu.preintegration import NoiseDensity, UpsampledImu, preintegrate
from calib_core.solver.arrow import Eliminated, solve_arrow
from calib_core.solver.information import covariance
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray

KNOTS, H_S = 700, 0.01
#: A consumer's IMU.
DENSITY = NoiseDensity(np.full(3, 1e-4), np.full(3, 1.2e-3))


def _corridor(see: int, *, silent_at: int = -1) -> tuple[JointProblem, Estimate]:
    """Seven seconds of a rig that turns, by points on two walls and a floor; see: of three directions, how many have planes."""
    rng = np.random.default_rng(1)
    t = H_S * np.arange(KNOTS)
    turns = np.stack([0.4 * np.sin(1.1 * t), 0.5 * np.sin(0.7 * t + 1.0), 0.8 * np.sin(0.9 * t + 2.0)], axis=1)
    normals = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    turned = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    e = Estimate(
        states=KnotStates(
            turned @ Rotation.from_rotvec(turns).as_matrix(), 0.3 * np.sin(turns), 0.3 * np.cos(turns) * 0.8
        ),
        R_imu_lidar=Rotation.random(rng=rng).as_matrix(),
        p_imu_lidar=np.array([0.1, -0.05, 0.08]),
        time_offset_s=0.0,
        gravity=turned @ np.array([0.0, 0.0, -9.81]),
        gyro_bias=np.zeros((1, 3)),
        accel_bias=np.zeros((1, 3)),
        normals=normals @ turned.T,
        offsets_m=np.array([1.0, 1.2, 2.0, 1.4]),
    )
    links = KNOTS - 1
    linked = np.arange(links) != silent_at
    gyro, accel = rng.normal(size=(links, 4, 3)), 9.0 + rng.normal(size=(links, 4, 3))
    knots = rng.normal(size=(2, KNOTS, 3))
    readings = UpsampledImu(t, H_S, gyro, accel, knots[0], knots[1], np.zeros((links, 6)), linked)
    nodes = BiasNodes(np.array([t[links // 2]]), np.zeros(links, np.int64), np.zeros(links))
    planes = [j for j in range(4) if see == 3 or j != 2]
    pairs = np.array([(k, j) for k in range(KNOTS) for j in planes if rng.random() < 0.5])
    y = np.concatenate([rng.normal(size=(len(pairs), 9, 3)), np.ones((len(pairs), 9, 1))], axis=2)
    y = 100.0 * np.concatenate([y, 0.01 * rng.normal(size=(len(pairs), 9, 1))], axis=2)
    bins = Bins(pairs[:, 0], pairs[:, 1], np.swapaxes(y, 1, 2) @ y, np.full(len(pairs), 9), 0.0)
    priors = Priors(e.R_imu_lidar, (), 9.81, 0.05, gyro_walk=1e-5, accel_walk=1e-4)
    nothing = np.zeros((links, 3))
    links_of = preintegrate(readings, nothing, nothing, DENSITY)
    return JointProblem(readings, nodes, links_of, nothing, nothing, bins, priors, KNOTS // 3), e


def _slowly(system: ArrowSystem) -> FloatArray:
    """The border's information by eliminating knot after knot with the longest floating-point numbers there are."""
    T = np.longdouble
    D, lower, border = (each.astype(T) for each in (system.diagonal, system.lower, system.border))
    left, carried = system.corner.astype(T), np.zeros((9, border.shape[2]), T)
    L = np.eye(9, dtype=T)
    for k in range(len(D)):
        own, theirs = D[k].copy(), border[k].copy()
        if k:
            M = _forward(L, lower[k - 1].T).T
            own, theirs = own - M @ M.T, theirs - M @ carried
        L = _cholesky(own)
        carried = _forward(L, theirs)
        left = left - carried.T @ carried
    return np.asarray(left, np.float64)


def _cholesky(A: FloatArray) -> FloatArray:
    L = np.zeros_like(A)
    for j in range(len(A)):
        L[j, j] = np.sqrt(A[j, j] - L[j, :j] @ L[j, :j])
        L[j + 1 :, j] = (A[j + 1 :, j] - L[j + 1 :, :j] @ L[j, :j]) / L[j, j]
    return L


def _forward(L: FloatArray, right: FloatArray) -> FloatArray:
    out = np.zeros_like(right)
    for i in range(len(L)):
        out[i] = (right[i] - L[i, :i] @ out[:i]) / L[i, i]
    return out


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="this machine has no longer numbers than doubles")
@pytest.mark.parametrize("see", [2, 3])
def test_a_direction_that_no_plane_sees_costs_no_digits(see: int) -> None:
    """Fails where the drift is not held, or links feel the fall that gravity's step brings: by 20 % and more."""
    problem, e = _corridor(see)
    system = problem.linearise(e)
    quick, slow = (
        covariance(information).matrix
        for information in (solve_arrow(system).information, _slowly(ArrowSystem.of(system)))
    )
    scale = np.sqrt(np.diag(slow))
    np.testing.assert_allclose(quick / scale[:, None] / scale, slow / scale[:, None] / scale, atol=2e-3)


def test_each_run_is_held_by_one_knot_of_its_own() -> None:
    """Fails where a run after a silence is not held, the gauge knot's place is held twice, or each part holds its first knot."""
    problem, e = _corridor(2, silent_at=400)
    unseen = Unseen.of(problem.bins, e, problem.readings, problem.gauge_knot)
    empty = ArrowSystem.zeros(KNOTS, 9, problem.layout(e).size)
    for first, last in ((0, 100), (100, 401), (401, KNOTS)):
        unseen.hold(empty.part(first, last), first)
    u = e.normals[2]
    expected = np.zeros((KNOTS, 9, 9))
    expected[problem.gauge_knot, 6:, 6:] = expected[401, 6:, 6:] = expected[401, 3:6, 3:6] = 1e4 * np.outer(u, u)
    np.testing.assert_allclose(empty.diagonal, expected, atol=1e-6)
    along = np.abs(unseen.everywhere.T @ u)
    np.testing.assert_allclose(along, 1.0, atol=1e-9)


def test_nothing_is_held_where_planes_face_three_ways() -> None:
    """Fails where the limit of what is seen is so high that a room's planes do not reach it."""
    problem, e = _corridor(3)
    assert problem.unseen(e).everywhere.shape == (3, 0)
    assert replace(problem, hold_velocity=True).unseen(e).runs == ()


def test_gravity_stays_as_it_is_along_a_level_way_that_nothing_sees() -> None:
    """Its magnitude tells a part that is small nothing, a large one a lot: down a shaft it is all of it.

    Mutations: held where it is steep; not at all; across as well.
    """
    level, steep, seen = _gravity_std(2, 0.4), _gravity_std(2, 5.0), _gravity_std(3, 0.4)
    assert level[2] < 2e-4
    assert steep[2] > 0.05
    assert np.all(level[:2] > 5e-3)
    assert np.all(seen > 1e-3)


def _gravity_std(see: int, along_m_s2: float) -> FloatArray:
    """(3,) [m/s2] of gravity across and, last, along what may be unseen, where so much of it lies along that."""
    problem, e = _corridor(see)
    solved = solve_arrow(problem.linearise(replace(e, gravity=e.gravity + along_m_s2 * e.normals[2])))
    axes = e.normals[:3]
    return np.sqrt(np.diag(axes @ covariance(solved.information).matrix[GRAVITY, GRAVITY] @ axes.T))


def test_influences_are_those_of_all_knots_as_they_follow() -> None:
    """Where gravity's step lets the knots fall, links feel none of it. Oracle: with what priors and holds have, they sum
    up to the covariance. Mutation: knots that do not fall along.
    """
    problem, e = _corridor(2)
    of, system = factor_influences(problem, e), problem.linearise(e)
    layout = problem.layout(e)
    stated = covariance(solve_arrow(system).information).matrix[:CALIBRATION, :CALIBRATION] / UNITS / UNITS[:, None]
    along, border = (each / UNITS for each in Eliminated.of(system).unit_responses(system, np.arange(CALIBRATION)))
    prior = prior_rows(problem.priors, problem.nodes, e, layout)[1] @ border
    planes, drift = border[layout.every_plane()], e.normals[2] @ along[problem.gauge_knot, 6:]
    held = 1e-6 * np.einsum("kia,kib->ab", along, along) + 1e-4 * planes.T @ planes + 1e4 * np.outer(drift, drift)
    allowed = of.links.allowed.sum(axis=0) + of.bins.allowed.sum(axis=0) + prior.T @ prior + held
    unit = 1.0 / np.sqrt(np.diag(stated))
    np.testing.assert_allclose(unit[:, None] * allowed * unit, unit[:, None] * stated * unit, atol=5e-3)
