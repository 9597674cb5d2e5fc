"""The joint problem against its residuals written out one below the other and differenced numerically."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors.imu import KnotStates, link_residuals
from calib_core.full.joint.first_estimate import bias_nodes
from calib_core.full.joint.priors import Held, prior_rows
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import BiasNodes, Estimate
from calib_core.geometry import plane_axes
from calib_core.solver.arrow import solve_arrow
from calib_core.solver.system import ArrowEquations, ArrowSystem
from calib_core.types import FloatArray
from tests.core.full.joint.misfit_problem import (
    KNOTS,
    LAYOUT,
    OFFSET_S,
    PLANES,
    frame_held,
    problem_of,
    step_of,
)

#: Full-size steps of every kind of unknown, so that none hides behind another's units.
_UNIT = 1e-5


def _stacked(problem: JointProblem, e: Estimate, about: Estimate) -> FloatArray:
    """All residuals: links as they are seen about an estimate, the roots of the scatter matrices times a, priors."""
    change = (
        problem.nodes.at_links(e.gyro_bias) - problem.links_gyro_bias,
        problem.nodes.at_links(e.accel_bias) - problem.links_accel_bias,
    )
    links = link_residuals(problem.seen_links(about), e.states, e.gravity, *change)
    b = problem.bins
    lidar = []
    for k, j, scatter in zip(b.knot, b.plane, b.scatter, strict=True):
        delta = e.time_offset_s - b.time_offset_s
        omega = problem.readings.knot_gyro[k] - problem.nodes.at_knots(e.gyro_bias)[k]
        R = e.states.R[k] @ Rotation.from_rotvec(-omega * delta).as_matrix()
        p = e.states.p[k] - e.states.v[k] * delta
        # n . (R (R_c x + p_c) + p) + w for the three unit vectors and the origin gives n_lidar and w_lidar.
        corners = np.vstack([np.zeros(3), np.eye(3)]) @ e.R_imu_lidar.T + e.p_imu_lidar
        w, *tips = (corners @ R.T + p) @ e.normals[j] + e.offsets_m[j]
        lidar.append(np.linalg.cholesky(scatter).T @ np.array([*(np.array(tips) - w), w, 1.0]))
    prior, _ = prior_rows(problem.priors, problem.nodes, e, LAYOUT)
    return np.concatenate([links.ravel(), np.concatenate(lidar), prior])


def _numerical_jacobian(problem: JointProblem, e: Estimate) -> FloatArray:
    """Central differences of the stacked residuals over every unknown, knots first."""
    size = KNOTS * 9 + LAYOUT.size
    columns = []
    for i in range(size):
        step = _UNIT * np.eye(size)[i]
        forth, back = (
            _stacked(problem, e.moved(s * step[: KNOTS * 9].reshape(KNOTS, 9), s * step[KNOTS * 9 :], LAYOUT), e)
            for s in (1, -1)
        )
        columns.append((forth - back) / (2 * _UNIT))
    return np.array(columns).T


def _written_out(equations: ArrowEquations) -> tuple[FloatArray, FloatArray]:
    system = ArrowSystem.of(equations)
    n, size = 9, KNOTS * 9 + LAYOUT.size
    H = np.zeros((size, size))
    for k in range(KNOTS):
        at, border = slice(k * n, k * n + n), slice(KNOTS * n, size)
        H[at, at], H[at, border], H[border, at] = (
            system.diagonal[k],
            system.border[k],
            system.border[k].T,
        )
        if k + 1 < KNOTS:
            H[at.stop : at.stop + n, at], H[at, at.stop : at.stop + n] = system.lower[k], system.lower[k].T
    H[KNOTS * n :, KNOTS * n :] = system.corner
    return H, np.concatenate([system.gradient.ravel(), system.gradient_shared])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("delta_s", [0.0, 0.004])
@pytest.mark.parametrize("unseen", range(3))
def test_normal_equations_are_those_of_the_stacked_residuals(seed: int, delta_s: float, unseen: int) -> None:
    """Fails when the border misses the bins' share of a plane, or the node right of a link gets the left's weight; when the
    frame is held by the IMU's pose, or that of the lidar without the lever arm.

    With delta the gyro bias also turns the pose that a bin asks for, by delta times as much: left out, and so here. Where no
    plane sees a direction, all but one knot are held along it, and links say nothing of it.
    """
    problem, e = problem_of(seed, delta_s=delta_s, unseen=unseen)
    r, J = _stacked(problem, e, e), _numerical_jacobian(problem, e)
    assert problem.cost(e) == pytest.approx(0.5 * r @ r)
    H, g = _written_out(problem.linearise(e))
    idle = np.zeros(len(g))
    idle[: KNOTS * 9] = 1e-6
    idle[KNOTS * 9 + LAYOUT.plane(0).start :] += 1e-4
    told = e.normals[problem.bins.plane] * np.sqrt(problem.bins.scatter[:, 3, 3])[:, None]
    free = np.linalg.svd(told)[2][3 - unseen :]
    drift = np.zeros((len(g), len(g)))
    for k in range(KNOTS):
        drift[9 * k + 6 : 9 * k + 9, 9 * k + 6 : 9 * k + 9] = 1e4 * free.T @ free
        if k != problem.gauge_knot:
            drift[9 * k + 3 : 9 * k + 6, 9 * k + 3 : 9 * k + 6] = 1e4 * free.T @ free
    use = np.ones(len(g), bool)
    if delta_s:
        bias = LAYOUT.gyro_bias()
        use[KNOTS * 9 + bias.start : KNOTS * 9 + bias.stop] = False
    expected = J.T @ J
    scale = np.sqrt(np.diag(expected))
    difference = (H - np.diag(idle) - drift - frame_held(problem, e) - expected) / scale[:, None] / scale
    # 1e8 on the diagonal costs eight of its own digits.
    np.testing.assert_allclose(difference[np.ix_(use, use)], 0.0, atol=2e-6)
    np.testing.assert_allclose((g - J.T @ r)[use] / scale[use], 0.0, atol=2e-6 * np.linalg.norm(r))


def test_gradient_is_the_derivative_of_the_cost() -> None:
    """Fails when `cost` and `linearise` price the lidar differently (no half in one of them).

    Twenty random directions over all kinds of unknowns at once.
    """
    problem, e = problem_of(3)
    _, g = _written_out(problem.linearise(e))
    rng = np.random.default_rng(4)
    for _ in range(20):
        way = rng.normal(size=len(g))
        forth, back = (
            problem.cost(problem.moved(e, step_of(s * way[: KNOTS * 9], s * way[KNOTS * 9 :]))) for s in (1e-6, -1e-6)
        )
        assert (forth - back) / 2e-6 == pytest.approx(g @ way, rel=1e-5)


@pytest.mark.parametrize("delta_s", [0.0, 0.01])
def test_bin_jacobian_column_by_column(delta_s: float) -> None:
    """Fails when phi is not carried across the delay (no exp(omega delta)), or the velocity's column is + delta n."""
    problem, e = problem_of(5, delta_s=delta_s)
    J = problem.lidar.bins_seen(e)[1]
    starts = {0: 0, 9: LAYOUT.size}
    assert starts[9] == LAYOUT.size
    for column in range(19):
        values = []
        for sign in (1, -1):
            knots, shared = np.zeros((KNOTS, 9)), np.zeros(LAYOUT.size)
            if column < 9:
                knots[:, column] = sign * _UNIT
            elif column < 16:
                shared[column - 9] = sign * _UNIT
            else:
                for j in range(PLANES):
                    shared[LAYOUT.plane(j).start + column - 16] = sign * _UNIT
            values.append(problem.lidar.planes_seen(problem.moved(e, step_of(knots, shared)))[:, :4])
        numerical = (values[0] - values[1]) / (2 * _UNIT)
        np.testing.assert_allclose(J[:, :, column], numerical, atol=1e-7, err_msg=str(column))


def test_prior_rows_are_differenced_too() -> None:
    """Fails when a random walk's row has no minus, gravity's row is not of unit length, or a direction's is not divided by its
    standard deviation.

    The rotation prior about its own reference, where the solve holds it.
    """
    problem, e = problem_of(6)
    aslant = Held(np.array([0.3, -0.2, 0.1, 0.5, 0.4, -0.6, 0.2]), 0.05, 0.1)
    problem = replace(problem, priors=replace(problem.priors, held=(aslant,)))
    residual, J = prior_rows(problem.priors, problem.nodes, e, LAYOUT)
    assert J.shape == (len(residual), LAYOUT.size)
    for column in range(LAYOUT.size):
        steps = (step_of(np.zeros(KNOTS * 9), s * _UNIT * np.eye(LAYOUT.size)[column]) for s in (1, -1))
        forth, back = (prior_rows(problem.priors, problem.nodes, problem.moved(e, step), LAYOUT)[0] for step in steps)
        np.testing.assert_allclose(J[:, column], (forth - back) / (2 * _UNIT), atol=1e-6)


def test_priors_say_what_they_are_told() -> None:
    """Fails when the walk's spread does not grow with the root of time, a fixed gravity has no row, or what was given has none.

    One by one: rotation, translation and time rows; gravity's magnitude; the first node; the steps between nodes.
    """
    problem, e = problem_of(7)
    residual, _ = prior_rows(problem.priors, problem.nodes, e, LAYOUT)
    span = problem.nodes.times_s[1] - problem.nodes.times_s[0]
    expected = [-0.3 / 0.5, 0.1 / 0.2, (e.p_imu_lidar[1] - 1.0) / 0.4, (OFFSET_S - 0.5) / 0.3]
    expected.append((np.linalg.norm(e.gravity) - 9.8) / 0.05)
    for values, first, walk in ((e.gyro_bias, 0.2, 0.3), (e.accel_bias, 1.0, 0.7)):
        for axis in range(3):
            expected += [values[0, axis] / first, *(np.diff(values[:, axis]) / (walk * np.sqrt(span)))]
    np.testing.assert_allclose(np.sort(residual), np.sort(expected), atol=1e-12)
    fixed, _ = prior_rows(replace(problem.priors, gravity_std_m_s2=0.0), problem.nodes, e, LAYOUT)
    assert np.abs(fixed).max() > 1e4


def test_moving_moves_each_kind_of_unknown_in_its_own_way() -> None:
    """Fails when a normal is not normalised, a plane's two turns act along each other's axis, or gravity grows by turning."""
    problem, e = problem_of(8)
    rng = np.random.default_rng(9)
    knots, shared = rng.normal(size=(KNOTS, 9)), 0.1 * rng.normal(size=LAYOUT.size)
    m = problem.moved(e, step_of(knots, shared))
    np.testing.assert_allclose(m.R_imu_lidar, e.R_imu_lidar @ Rotation.from_rotvec(shared[:3]).as_matrix(), atol=1e-13)
    np.testing.assert_allclose(m.p_imu_lidar, e.p_imu_lidar + shared[3:6])
    assert m.time_offset_s == e.time_offset_s + shared[6]
    pulled = e.gravity + shared[7:10]
    heavier = np.linalg.norm(e.gravity) + shared[7:10] @ e.gravity / np.linalg.norm(e.gravity)
    np.testing.assert_allclose(m.gravity, pulled * heavier / np.linalg.norm(pulled))
    np.testing.assert_allclose(m.gyro_bias, e.gyro_bias + shared[LAYOUT.gyro_bias()].reshape(-1, 3))
    np.testing.assert_allclose(m.accel_bias, e.accel_bias + shared[LAYOUT.accel_bias()].reshape(-1, 3))
    np.testing.assert_allclose(m.states.p, e.states.p + knots[:, 3:6])
    for j in range(PLANES):
        u, v, w = shared[LAYOUT.plane(j)]
        e1, e2 = plane_axes(e.normals[j])
        tilted = e.normals[j] + u * e1 + v * e2
        np.testing.assert_allclose(m.normals[j], tilted / np.linalg.norm(tilted), atol=1e-14)
        assert m.offsets_m[j] == pytest.approx(e.offsets_m[j] + w)


@pytest.mark.parametrize(("lasts_s", "spacing_s"), [(20.0, 2.5), (52.0, 4.0), (100.0, 5.0)])
def test_bias_nodes_stand_closer_in_a_short_recording(lasts_s: float, spacing_s: float) -> None:
    """Fails when every recording gets a node each 5 s: a walk strays from the straight line between them."""
    times_s = bias_nodes(np.arange(0.0, lasts_s + 0.005, 0.01)).times_s
    np.testing.assert_allclose(np.diff(times_s), spacing_s, rtol=1e-3)


def test_the_map_frame_is_free() -> None:
    """Fails when a lidar factor leaves the knot's position out: its plane would not move along.

    Law: turning and shifting map, planes and gravity together changes no cost.
    """
    problem, e = problem_of(10, delta_s=0.003)
    R, t = Rotation.from_rotvec([0.5, -1.0, 0.8]).as_matrix(), np.array([4.0, -2.0, 7.0])
    normals = e.normals @ R.T
    moved = replace(
        e,
        states=KnotStates(R @ e.states.R, e.states.p @ R.T + t, e.states.v @ R.T),
        gravity=R @ e.gravity,
        normals=normals,
        offsets_m=e.offsets_m - normals @ t,
    )
    assert problem.cost(moved) == pytest.approx(problem.cost(e), rel=1e-12)


def test_the_lidar_at_the_gauge_knot_and_frozen_columns_stay() -> None:
    """Fails when the gauge's weight is on another knot, or on the IMU, or a frozen column keeps its border."""
    problem, e = problem_of(11)
    frozen = (6, LAYOUT.plane(1).start)
    held = replace(problem, gauge_knot=3, frozen=frozen)
    solution = solve_arrow(held.linearise(e), damping=1e-9)
    small = 1e-6 / np.abs(solution.step_shared[:6]).max()
    after = held.moved(e, replace(solution, step=small * solution.step, step_shared=small * solution.step_shared))
    turned, shifted = (
        np.abs(a - b).max()
        for a, b in (
            (after.states.R[3] @ after.R_imu_lidar, e.states.R[3] @ e.R_imu_lidar),
            (
                after.states.p[3] + after.states.R[3] @ after.p_imu_lidar,
                e.states.p[3] + e.states.R[3] @ e.p_imu_lidar,
            ),
        )
    )
    assert max(turned, shifted) < 1e-3 * 1e-6
    assert np.abs(small * solution.step[3, :3]).max() > 1e-2 * 1e-6
    assert np.abs(solution.step_shared[list(frozen)]).max() < 1e-12
    free = solve_arrow(problem.linearise(e), damping=1e-9)
    assert np.abs(free.step_shared[list(frozen)]).min() > 1e-6


def test_a_part_has_the_columns_that_its_links_touch() -> None:
    """By hand: links 0-1 are between nodes 0 and 1, 2-3 between 1 and 2, 4-5 between 2 and 3.

    Mutations: without the last link's node on the right; of all nodes.
    """
    problem, e = problem_of(0)
    assert [problem.nodes.window(*links) for links in ((0, 1), (1, 3), (2, 6), (5, 6))] == [
        (0, 2),
        (0, 3),
        (1, 3),
        (2, 2),
    ]
    known = LAYOUT.with_nodes(1, 3)
    assert len(known) == 7 + 3 + 2 * 9 + 3 * PLANES
    np.testing.assert_array_equal(known[10:19], LAYOUT.gyro_bias().start + 3 + np.arange(9))
    np.testing.assert_array_equal(known[19:28], LAYOUT.accel_bias().start + 3 + np.arange(9))
    np.testing.assert_array_equal(known[28:], np.arange(LAYOUT.plane(0).start, LAYOUT.size))
    np.testing.assert_array_equal(problem.linearise(e).part(3, 5).columns, known)  # the link into it is its own too
    assert BiasNodes.spread(problem.readings.knots_s, None).window(0, 6) == (0, 1)


def test_bias_nodes_interpolate() -> None:
    """Fails when a link takes the bias at its left knot instead of at its middle, or an hour gets a node every 3 s.

    Linear biases are reproduced: at the links' middles exactly, at the knots to the ends' half links.
    """
    knots = 5.0 + 0.1 * np.arange(101)
    nodes = BiasNodes.spread(knots, 3.0)
    assert len(nodes.times_s) == 5
    values = np.outer(nodes.times_s, [1.0, -2.0, 0.5])
    middles = 0.5 * (knots[1:] + knots[:-1])
    np.testing.assert_allclose(nodes.at_links(values), np.outer(middles, [1.0, -2.0, 0.5]), atol=1e-12)
    np.testing.assert_allclose(nodes.at_knots(values)[1:-1], np.outer(knots[1:-1], [1.0, -2.0, 0.5]), atol=1e-12)
    hour = BiasNodes.spread(np.arange(0.0, 3600.0, 0.5), 3.0)
    assert len(hour.times_s) == CHAIN.most_nodes
    np.testing.assert_allclose(np.diff(hour.times_s), 3599.5 / (CHAIN.most_nodes - 1))
    for spacing in (None, 8.0):
        single = BiasNodes.spread(knots, spacing)
        np.testing.assert_array_equal(single.at_knots(np.array([[1.0, 2.0, 3.0]])), np.tile([1.0, 2.0, 3.0], (101, 1)))


@pytest.mark.parametrize("unseen", [0, 1])
@pytest.mark.parametrize("edges", [(0, 1, 2, 3, 4, 5, 6, 7), (0, 3, 7), (0, 6, 7), (0, 1, 7)])
def test_parts_put_together_are_the_whole(edges: tuple[int, ...], unseen: int) -> None:
    """Oracle: all knots as one part; what parts are added in another order differs by round-off.

    Mutations: a link into a part counted in its corner too; not counted in its first knot; the coupling of the first knot with
    the one before it left out; the gauge knot held in each part; its bins' knots counted from its first bin's.
    """
    problem, e = problem_of(4, delta_s=0.004, unseen=unseen)
    b, seen = problem.bins, problem.bins.knot != 3
    bins = replace(b, knot=b.knot[seen], plane=b.plane[seen], scatter=b.scatter[seen], count=b.count[seen])
    problem = replace(problem, bins=bins)
    e = replace(e, gyro_bias=e.gyro_bias + 0.05 * np.arange(LAYOUT.nodes)[:, None])
    equations = problem.linearise(e)
    whole = ArrowSystem.of(equations)
    corner, shared = equations.common()
    for first, last in pairwise(edges):
        part = equations.part(first, last)
        border = np.zeros((last - first, 9, LAYOUT.size))
        border[:, :, part.columns] = part.border
        corner[np.ix_(part.columns, part.columns)] += part.corner
        shared[part.columns] += part.gradient_shared
        lower = np.concatenate([np.zeros((1, 9, 9)), whole.lower])
        for name, found, expected in (
            ("diagonal", part.diagonal, whole.diagonal[first:last]),
            ("lower", part.lower, lower[first:last]),
            ("border", border, whole.border[first:last]),
            ("gradient", part.gradient, whole.gradient[first:last]),
        ):
            near = 1e-12 * max(float(np.abs(expected).max()), 1.0)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=near, err_msg=name)
    for found, expected in ((corner, whole.corner), (shared, whole.gradient_shared)):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("unseen", range(3))
@pytest.mark.parametrize("held", [{}, {"hold_velocity": True}, {"planes_hold_frame": True}])
@pytest.mark.parametrize("at_once", [3, 100])
def test_the_border_times_columns_is_what_it_is_written_out(
    monkeypatch: pytest.MonkeyPatch, unseen: int, held: dict[str, bool], at_once: int
) -> None:
    """Mutations: links beyond the first stretch of knots left out; the fall along what no plane sees left out of the bins, or not
    taken from the links; the frame's hold left out, or there where something else holds it; all bins on the first plane.
    """
    monkeypatch.setattr("calib_core.full.joint.equations.CHAIN", replace(CHAIN, knots_at_once=at_once))
    problem, e = problem_of(5, delta_s=0.004, unseen=unseen)
    equations = replace(problem, **held).linearise(e)
    columns = np.random.default_rng(6).normal(size=(LAYOUT.size, 2))
    expected = ArrowSystem.of(equations).border @ columns
    np.testing.assert_allclose(equations.border_times(columns), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("unseen", range(3))
@pytest.mark.parametrize("held", [{}, {"hold_velocity": True}, {"planes_hold_frame": True}])
@pytest.mark.parametrize("at_once", [3, 100])
def test_the_gradient_alone_is_that_of_the_whole(
    monkeypatch: pytest.MonkeyPatch, unseen: int, held: dict[str, bool], at_once: int
) -> None:
    """At the estimate, and of what is shared where the knots have moved.

    Mutations: priors left out; the fall along what no plane sees, or links that feel it; a link's second knot not moved along, or
    its pull on it; the frame's hold left out of what a moved knot pulls at, or there where something else holds it; the nodes'
    shares exchanged; a second bin at a knot left out.
    """
    monkeypatch.setattr("calib_core.full.joint.equations.CHAIN", replace(CHAIN, knots_at_once=at_once))
    problem, e = problem_of(5, delta_s=0.004, unseen=unseen)
    equations = replace(problem, **held).linearise(e)
    whole = ArrowSystem.of(equations)
    knots, shared = equations.pulls()
    np.testing.assert_allclose(knots, whole.gradient, atol=1e-12 * np.abs(whole.gradient).max())
    np.testing.assert_allclose(shared, whole.gradient_shared, atol=1e-12 * np.abs(whole.gradient_shared).max())
    along = np.random.default_rng(6).normal(size=(KNOTS, 9))
    moved = whole.pulls(along)[1]
    np.testing.assert_allclose(equations.pulls(along)[1], moved, atol=1e-12 * np.abs(moved).max())
