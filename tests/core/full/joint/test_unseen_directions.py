"""Chains with a direction that no plane sees, against a slow elimination with more digits than there are."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib_core.factors.imu import KnotStates, link_residuals
from calib_core.full.assess.influence import Clustering, factor_influences
from calib_core.full.joint.priors import Priors, prior_rows
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, GRAVITY, BiasNodes, Bins, Estimate
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.joint.unseen_directions import Unseen, unseen_counts
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
    """The border's information by eliminating knot after knot in decimal numbers of forty digits."""
    exact = np.vectorize(Decimal, otypes=[object])
    with localcontext() as context:
        context.prec = 40
        D, lower, border = (exact(each) for each in (system.diagonal, system.lower, system.border))
        left, carried = exact(system.corner), exact(np.zeros((9, border.shape[2])))
        L = exact(np.eye(9))
        for k in range(len(D)):
            own, theirs = D[k].copy(), border[k].copy()
            if k:
                M = _forward(L, lower[k - 1].T).T
                own, theirs = own - M @ M.T, theirs - M @ carried
            L = _cholesky(own)
            carried = _forward(L, theirs)
            left = left - carried.T @ carried
    return np.asarray(left, np.float64)


def _cholesky(A: NDArray[np.object_]) -> NDArray[np.object_]:
    L = np.full_like(A, Decimal(0))
    for j in range(len(A)):
        L[j, j] = (A[j, j] - L[j, :j] @ L[j, :j]).sqrt() if j else A[j, j].sqrt()
        for i in range(j + 1, len(A)):
            L[i, j] = (A[i, j] - (L[i, :j] @ L[j, :j] if j else 0)) / L[j, j]
    return L


def _forward(L: NDArray[np.object_], right: NDArray[np.object_]) -> NDArray[np.object_]:
    out = np.full_like(right, Decimal(0))
    for i in range(len(L)):
        out[i] = (right[i] - (L[i, :i] @ out[:i] if i else 0)) / L[i, i]
    return out


@pytest.mark.parametrize("see", [2, 3])
def test_a_direction_that_no_plane_sees_costs_no_digits(see: int) -> None:
    """Oracle: the links whole, held along it by nothing but a kilometre, in numbers of forty digits.

    Fails where links keep their velocities or their places along it (by 20 % and more, or with a negative variance), lose what
    they have across it, or lose their noise's correlation with it.
    """
    problem, e = _corridor(see)
    whole = replace(problem.linearise(e), links=problem.links, unseen=replace(problem.unseen(e), runs=()))
    quick, slow = (
        covariance(information).matrix
        for information in (solve_arrow(problem.linearise(e)).information, _slowly(ArrowSystem.of(whole)))
    )
    scale = np.sqrt(np.diag(slow))
    np.testing.assert_allclose(quick / scale[:, None] / scale, slow / scale[:, None] / scale, atol=2e-3)


def test_links_say_nothing_along_it_and_all_they_did_across() -> None:
    """Oracle: the inverse of their covariance without the two rows along the way, by hand. Mutations: rows dropped from the
    information, as if what they share with the others were known; the way taken in the map's axes; a run's last link left whole.
    """
    problem, e = _corridor(2)
    u = e.normals[2]
    cut = problem.seen_links(e).sqrt_info
    for k in (0, 250, KNOTS - 2):
        along = np.zeros((9, 2))
        along[3:6, 0] = along[6:9, 1] = e.states.R[k].T @ u
        across = np.linalg.svd(along)[0][:, 2:]
        whole = np.linalg.inv(problem.links.sqrt_info[k].T @ problem.links.sqrt_info[k])
        expected = across @ np.linalg.inv(across.T @ whole @ across) @ across.T
        np.testing.assert_allclose(cut[k].T @ cut[k], expected, atol=1e-9 * np.abs(expected).max())
        assert np.all(np.triu(cut[k], 1) == 0.0)


def test_knots_are_carried_along_it_by_the_readings() -> None:
    """Oracle: all links' own residuals, which are nothing along it then, and what they were across.

    Mutations: gravity left out; the biases' changes left out; from each run's first knot, so that the gauge knot moves; the
    velocity alone.
    """
    problem, e = _corridor(2, silent_at=400)
    u, dbg, dba = e.normals[2], np.full((KNOTS - 1, 3), 1e-3), np.full((KNOTS - 1, 3), 0.05)
    unseen = problem.unseen(e)
    carried = unseen.carried(e.states, problem.links, e.gravity, dbg, dba)
    raw = replace(problem.links, sqrt_info=np.tile(np.eye(9), (KNOTS - 1, 1, 1)))
    before, after = (link_residuals(raw, states, e.gravity, dbg, dba) for states in (e.states, carried))
    ways = np.swapaxes(e.states.R[:-1], 1, 2) @ u
    for rows in (slice(3, 6), slice(6, 9)):
        along = np.sum(ways * after[:, rows], axis=1)
        np.testing.assert_allclose(np.delete(along, 400), 0.0, atol=1e-10)
        across = [each[:, rows] - np.sum(ways * each[:, rows], axis=1)[:, None] * ways for each in (before, after)]
        np.testing.assert_allclose(*across, atol=1e-10)
    for knot in (problem.gauge_knot, 401):
        kept, were = (carried.p[knot], carried.v[knot]), (e.states.p[knot], e.states.v[knot])
        np.testing.assert_allclose(kept, were, atol=1e-14)  # libraries of linear algebra round otherwise


def test_each_knot_is_held_along_what_its_run_does_not_see() -> None:
    """Fails where one knot of a run alone is held, each part holds its own first ones, those of another run, or the gauge knot's
    place, which the lever arm moves: it would be known to a centimetre by that.
    """
    problem, e = _corridor(2, silent_at=400)
    unseen = Unseen.of(problem.bins, e, problem.readings, problem.gauge_knot)
    empty = ArrowSystem.zeros(KNOTS, 9, problem.layout(e).size)
    for first, last in ((0, 100), (100, 401), (401, KNOTS)):
        unseen.hold(empty.part(first, last), first)
    u = e.normals[2]
    expected = np.zeros((KNOTS, 9, 9))
    expected[:, 3:6, 3:6] = expected[:, 6:, 6:] = 1e4 * np.outer(u, u)
    expected[problem.gauge_knot, 3:6, 3:6] = 0.0
    np.testing.assert_allclose(empty.diagonal, expected, atol=1e-6)
    along = np.abs(unseen.everywhere.T @ u)
    np.testing.assert_allclose(along, 1.0, atol=1e-9)


def test_nothing_is_held_where_planes_face_three_ways() -> None:
    """Fails where the limit of what is seen is so high that a room's planes do not reach it."""
    problem, e = _corridor(3)
    assert problem.unseen(e).everywhere.shape == (3, 0)
    assert replace(problem, hold_velocity=True).unseen(e).runs == ()


def _leaning(problem: JointProblem, e: Estimate, told: float) -> Estimate:
    """Walls and floor, the first of which leans so that they tell of the way along them so much [1/m2]."""
    one, other = (float(problem.bins.scatter[problem.bins.plane == j, 3, 3].sum()) for j in (0, 3))
    lean = np.sqrt(told * (one + other) / (one * other))  # of two that look across, one a little aside
    normals = e.normals.copy()
    normals[0] = np.cos(lean) * e.normals[0] + np.sin(lean) * e.normals[2]
    return replace(e, normals=normals)


def test_what_is_hardly_seen_is_seen_or_not_for_as_long_as_points_are_gathered() -> None:
    """By a wall that leans a little more with a step: the cost goes on from where it was, as every step asks of it.

    Mutation: asked anew of each estimate (links of a thousand million times as much come and go).
    """
    problem, e = _corridor(2)
    below, above = _leaning(problem, e, 250.0), _leaning(problem, e, 350.0)
    for first, ways in ((below, 1), (above, 0)):
        counts = unseen_counts(problem.bins, first, problem.readings, ())
        assert counts == (ways, ways)
        decided = replace(problem, bins=replace(problem.bins, unseen=counts))
        for each in (below, above):
            assert decided.unseen(each).everywhere.shape == decided.unseen(each).runs[0][2].shape == (3, ways)


@pytest.mark.parametrize(
    ("told", "before", "ways"),
    [
        (250.0, (), 1),
        (250.0, (0, 0), 1),
        (350.0, (), 0),
        (350.0, (1, 1), 1),
        (350.0, (0, 0), 0),
        (1500.0, (1, 1), 0),
        (350.0, (1,), 0),
    ],
)
def test_what_was_not_seen_has_to_be_seen_well(told: float, before: tuple[int, ...], ways: int) -> None:
    """At 300 and 1200 [1/m2], and of as many runs as before. Mutations: as before, whatever is told; one limit for both."""
    problem, e = _corridor(2)
    assert unseen_counts(problem.bins, _leaning(problem, e, told), problem.readings, before) == (ways, ways)


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


def test_influences_are_those_of_links_as_they_are_seen() -> None:
    """Where no plane sees a way. Oracle: with what priors and holds have, they sum up to the covariance.

    Mutation: links whole.
    """
    problem, e = _corridor(2)
    of, system = factor_influences(problem, e), problem.linearise(e)
    layout = problem.layout(e)
    stated = covariance(solve_arrow(system).information).matrix[:CALIBRATION, :CALIBRATION] / UNITS / UNITS[:, None]
    along, border = (each / UNITS for each in Eliminated.of(system).unit_responses(system, np.arange(CALIBRATION)))
    prior = prior_rows(problem.priors, problem.nodes, e, layout)[1] @ border
    planes, u = border[layout.every_plane()], e.normals[2]
    drift = np.concatenate([np.delete(u @ along[:, 3:6], problem.gauge_knot, axis=0), u @ along[:, 6:]])
    held = 1e-6 * np.einsum("kia,kib->ab", along, along) + 1e-4 * planes.T @ planes + 1e4 * drift.T @ drift
    counts = len(problem.links.Dv), len(problem.bins.knot)
    in_one = [[Clustering(np.zeros(count, np.int64), 1)] for count in counts]
    allowed = of.of_links(in_one[0])[0].allowed[0] + of.of_bins(in_one[1])[0].allowed[0] + prior.T @ prior + held
    unit = 1.0 / np.sqrt(np.diag(stated))
    np.testing.assert_allclose(unit[:, None] * allowed * unit, unit[:, None] * stated * unit, atol=5e-3)
