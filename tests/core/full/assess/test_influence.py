"""Influences of single factors: they sum up to the stated covariance, and to the next step, which is nothing at the optimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.factors.laser_kernels import Clusters
from calib_core.full.assess.considered import consider
from calib_core.full.assess.disagreement import (
    Disagreement,
    _is_beyond_noise,
    judge,
    roots,
    together,
    unexplained_variance,
)
from calib_core.full.assess.influence import (
    Clustering,
    FactorInfluences,
    Influences,
    factor_influences,
    parameter_influences,
)
from calib_core.full.assess.kernels import add_influences_kernel, add_own_influences_kernel
from calib_core.full.joint.by_laser import ByLaser
from calib_core.full.joint.priors import prior_rows
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.settings import CHAIN
from calib_core.full.joint.state import CALIBRATION, Estimate
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.prepare import settings
from calib_core.full.prepare.nuisance import Nuisance
from calib_core.solver.arrow import ArrowEquations, Eliminated, NotPositiveDefinite, solve_arrow
from calib_core.solver.information import covariance
from calib_core.types import FloatArray, IntArray
from tests.core.factors.triangles import triangle
from tests.core.full.assess.solved_problem import solved_problem
from tests.core.full.joint import misfit_problem as plain
from tests.core.full.joint.sensor_case import BENT, LASERS, NUISANCE, Case, written_out


def _links(of: FactorInfluences) -> Influences:
    """Each by itself."""
    count = len(of.responses.links.Dv)
    return of.of_links([Clustering(np.arange(count), count)])[0]


def _bins(of: FactorInfluences) -> Influences:
    """Each by itself."""
    count = len(of.responses.problem.bins.knot)
    return of.of_bins([Clustering(np.arange(count), count)])[0]


def _of_priors(problem: JointProblem, estimate: Estimate) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Response and residuals of the priors, and what the terms add that keep unseen states in place: (7, 7)."""
    system = problem.linearise(estimate)
    residual, jacobian = prior_rows(problem.priors, problem.nodes, estimate, problem.layout(estimate))
    along, border = Eliminated.of(system).unit_responses(system, np.arange(CALIBRATION))
    along, border = along / UNITS, border / UNITS
    planes = border[problem.layout(estimate).every_plane()]
    kept = 1e-6 * np.einsum("kia,kib->ab", along, along) + 1e-4 * planes.T @ planes
    return jacobian @ border, residual, kept


def test_influences_sum_up_to_the_covariance_and_to_the_next_step() -> None:
    """Mutations: the lasers' part left out, the mixed part once, a link's bias of one node only, changes of the parameters
    since the points were laid out left out of the pulls."""
    problem, estimate = solved_problem()
    of = factor_influences(problem, estimate)
    system = problem.linearise(estimate)
    stated = covariance(solve_arrow(system).information).matrix[:CALIBRATION, :CALIBRATION] / UNITS / UNITS[:, None]
    response, residual, kept = _of_priors(problem, estimate)
    links, bins = _links(of), _bins(of)
    allowed = links.allowed.sum(axis=0) + bins.allowed.sum(axis=0) + response.T @ response + kept
    unit = 1.0 / np.sqrt(np.diag(stated))
    np.testing.assert_allclose(unit[:, None] * allowed * unit, unit[:, None] * stated * unit, atol=2e-3)
    # The step that all pulls together ask for is the Gauss-Newton step of the calibration.
    moved = links.moved.sum(axis=0) + bins.moved.sum(axis=0) - response.T @ residual
    step = solve_arrow(system).step_shared[:CALIBRATION] / UNITS
    size = np.abs(links.moved).sum(axis=0) + np.abs(bins.moved).sum(axis=0)
    np.testing.assert_allclose((moved - step) / size, 0.0, atol=1e-6)


class _Amplified:
    """Equations under which all states follow the calibration by so many times as much."""

    def __init__(self, at_hand: Eliminated, times: float) -> None:
        self._at_hand, self._times = at_hand, times
        self.is_of_kind = at_hand.is_of_kind

    def unit_responses(self, equations: ArrowEquations, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        along, border = self._at_hand.unit_responses(equations, columns)
        return self._times * along, self._times * border


def test_what_is_beyond_all_numbers_is_no_covariance() -> None:
    """A choice of planes that told next to nothing had responses of 1e95, whose squares are squared: that ended as an overflow,
    told as one. Mutation: no look at the squares."""
    problem, estimate = solved_problem()
    at_hand = Eliminated.of(problem.linearise(estimate))
    asked: list[Callable[[FactorInfluences], object]] = [_links, _bins]
    for ask in asked:
        ask(factor_influences(problem, estimate, eliminated=cast(Eliminated, _Amplified(at_hand, 1e20))))
        with pytest.raises(NotPositiveDefinite):
            ask(factor_influences(problem, estimate, eliminated=cast(Eliminated, _Amplified(at_hand, 1e95))))
    lasers = [ByLaser(problem.lidar, LASERS)]
    with pytest.raises(NotPositiveDefinite):
        factor_influences(problem, estimate, lasers, eliminated=cast(Eliminated, _Amplified(at_hand, 1e95)))


def test_equations_at_hand_are_not_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a step before say the same; those of fewer unknowns are of no use. Mutations: never taken; taken whatever they are
    of.
    """
    problem, estimate = solved_problem()
    own = factor_influences(problem, estimate)
    at_hand = Eliminated.of(problem.linearise(estimate))
    frozen = Eliminated.of(replace(problem, frozen=(*problem.frozen, 6)).linearise(estimate))
    made: list[object] = []
    real = Eliminated.of
    monkeypatch.setattr(Eliminated, "of", lambda *a, **k: made.append(a) or real(*a, **k))
    for eliminated, often in ((at_hand, 0), (frozen, 1)):
        made.clear()
        other = factor_influences(problem, estimate, eliminated=eliminated)
        assert len(made) == often
        np.testing.assert_allclose(other.covariance, own.covariance, rtol=1e-9)
        np.testing.assert_allclose(_links(other).moved, _links(own).moved, rtol=1e-6, atol=1e-12)


def test_factors_asked_for_a_few_knots_at_a_time_say_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: each few the first ones; the last link left out; clusters counted from the first of all."""
    problem, estimate = Case(1).problem, Case(1).estimate
    of = factor_influences(problem, estimate)
    at_once = _links(of), _bins(of)
    monkeypatch.setattr("calib_core.full.assess.influence.CHAIN", replace(CHAIN, knots_at_once=3))
    for one, other in zip(at_once, (_links(of), _bins(of)), strict=True):
        np.testing.assert_allclose(other.moved, one.moved, rtol=1e-9, atol=1e-12 * np.abs(one.moved).max())
        np.testing.assert_allclose(other.allowed, one.allowed, rtol=1e-9, atol=1e-12 * np.abs(one.allowed).max())


def test_lasers_add_what_their_clusters_have_moved_and_allowed() -> None:
    """Against the products of whole matrices, cluster by cluster, with hits that have moved since moments were made. Mutations:
    the mixed part once; the change left out of either pull; a cluster to the bin of its neighbour; its bin's first pose.
    """
    rng = np.random.default_rng(3)
    bins, laser = np.array([0, 0, 2, 2, 2]), np.array([1, 0, 2, 1, 0])
    y, f = rng.normal(size=(5, 20, 5)), rng.normal(size=(5, 20, 8))
    cross, gram = (np.swapaxes(f, 1, 2) @ y).astype(np.float32), np.swapaxes(f, 1, 2) @ f
    R, p, pose = Rotation.random(2, random_state=rng).as_matrix(), rng.normal(size=(2, 3)), np.array([0, 1, 1, 1, 0])
    y[:, :, :3] = np.einsum("bij,bpj->bpi", R[pose], y[:, :, :3]) + y[:, :, 3, None] * p[pose, None]
    a, Q, F, change = (rng.normal(size=shape) for shape in ((3, 5), (3, 4, 7), (3, 8, 7), (3, 8)))
    moved, allowed = np.zeros((3, 7)), np.zeros((3, 7, 7))
    add_influences_kernel(Clusters(bins, laser, pose, cross, R, p), a, Q, F, change, moved, allowed)
    add_own_influences_kernel(bins, laser, triangle(gram).astype(np.float32), F, change, moved, allowed)
    for q in range(3):
        u, P = np.zeros(7), np.zeros((7, 7))
        for b in np.flatnonzero(bins == q):
            own = F[laser[b]]
            residual, response = y[b] @ a[q] + f[b] @ change[laser[b]], y[b, :, :4] @ Q[q] + f[b] @ own
            u -= response.T @ residual
            P += response.T @ response
            # What the bin's own scatter says of both is not the clusters' to say.
            u += Q[q].T @ y[b, :, :4].T @ y[b] @ a[q]
            P -= Q[q].T @ y[b, :, :4].T @ y[b, :, :4] @ Q[q]
        np.testing.assert_allclose(moved[q], u, rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(allowed[q], P, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("nuisance", [NUISANCE, BENT])
def test_a_laser_pulls_by_the_means_of_its_points(nuisance: Nuisance) -> None:
    """Against single points, differenced numerically, in whole matrices: a laser's points on a plane at a knot are one residual,
    their sum over the root of their number.

    Mutations: a cluster's weight once more or once less; the parameters' part of a response or of a residual left out; a laser's
    points on another patch to another laser; the lidar's columns of its neighbour.
    """
    case = Case(1, nuisance)
    of = factor_influences(case.problem, case.estimate, [ByLaser(case.problem.lidar, LASERS)])
    J, r = case.numerical_jacobian(), case.stacked(case.estimate)
    H, _ = written_out(case)
    X = np.linalg.solve(H, np.eye(len(H))[:, 9 * plain.KNOTS :][:, :CALIBRATION]) / UNITS
    links = 9 * len(case.problem.links.DR)
    rows, residual = (J[links : links + len(case.pair)] @ X), r[links : links + len(case.pair)]
    for laser in range(LASERS):
        u, P = np.zeros(CALIBRATION), np.zeros((CALIBRATION, CALIBRATION))
        for q in range(len(case.problem.bins.knot)):
            for square in range(case.squares + 1):
                mine = (case.laser == laser) & (case.pair == q) & (case.square == square)
                if mine.any():
                    root = np.sqrt(mine.sum())
                    one = rows[mine].sum(axis=0) / root
                    u -= one * residual[mine].sum() / root
                    P += np.outer(one, one)
        unit = 1.0 / np.sqrt(np.diag(P))
        np.testing.assert_allclose(
            unit * of.lasers.moved[laser], unit * u, rtol=1e-3, atol=1e-3 * np.abs(unit * u).max()
        )
        np.testing.assert_allclose(unit[:, None] * of.lasers.allowed[laser] * unit, unit[:, None] * P * unit, atol=2e-3)


@pytest.mark.parametrize("nuisance", [NUISANCE, BENT])
def test_the_sensors_parameters_are_moved_like_the_seven(nuisance: Nuisance) -> None:
    """Pulls on all columns, some at a time and each by itself: on the seven those of `factor_influences`, on the others, with
    what the priors have, the stated variance and the next step.

    Mutations: of either kernel the mixed part once, in the branch of each by itself; columns of the next lot; numbers counted
    from the first of all unknowns.
    """
    case = Case(1, nuisance)
    problem, e, layout = case.problem, case.estimate, case.problem.layout(case.estimate)
    lasers = [ByLaser(problem.lidar, LASERS)]
    own, seven = layout.nuisance(), factor_influences(problem, e, lasers)
    ((some, first),) = parameter_influences(problem, e, np.arange(CALIBRATION), lasers)
    assert some.tolist() == list(range(CALIBRATION))
    for one, other in ((_links(first), _links(seven)), (_bins(first), _bins(seven)), (first.lasers, seven.lasers)):
        np.testing.assert_allclose(one.moved, other.moved * UNITS, rtol=1e-8, atol=1e-12)
        diagonal = np.diagonal(other.allowed, axis1=1, axis2=2) * UNITS**2
        np.testing.assert_allclose(one.allowed, diagonal, rtol=1e-6, atol=1e-12 * diagonal.max())
    parts = list(parameter_influences(problem, e, np.arange(own.start, own.stop), lasers))
    assert np.concatenate([some for some, _ in parts]).tolist() == list(range(nuisance.size))
    system = problem.linearise(e)
    solution = solve_arrow(system)
    columns = np.arange(own.start, own.stop)
    along, border = Eliminated.of(system).unit_responses(system, columns)
    residual, jacobian = prior_rows(problem.priors, problem.nodes, e, layout)
    prior, planes = jacobian @ border, border[layout.every_plane()]
    kept = 1e-6 * np.sum(along**2, axis=(0, 1)) + 1e-4 * np.sum(planes**2, axis=0)
    both = [(_links(of), _bins(of)) for _, of in parts]
    allowed = np.concatenate([links.allowed.sum(axis=0) + bins.allowed.sum(axis=0) for links, bins in both])
    stated = np.diag(covariance(solution.information).matrix)[columns]
    np.testing.assert_allclose((allowed + np.sum(prior**2, axis=0) + kept) / stated, 1.0, atol=2e-3)
    pulls = [np.concatenate([links.moved, bins.moved]) for links, bins in both]
    moved = np.concatenate([each.sum(axis=0) for each in pulls]) - prior.T @ residual
    size = np.concatenate([np.abs(each).sum(axis=0) for each in pulls])
    np.testing.assert_allclose((moved - solution.step_shared[columns]) / size, 0.0, atol=1e-5)


def test_what_planes_disagree_about_widens_each_parameter_by_its_own_pulls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against single points, differenced numerically, in whole matrices.

    Mutations: what noise allows not taken off; squares of sums and sums of squares exchanged; whatever the seven disagree about.
    """
    monkeypatch.setattr("calib_core.full.assess.disagreement._is_beyond_noise", lambda _clusters, _: False)
    case = Case(1)
    problem, own = case.problem, case.problem.layout(case.estimate).nuisance()
    J, r = case.numerical_jacobian(), case.stacked(case.estimate)
    H, _ = written_out(case)
    start = 9 * plain.KNOTS + own.start
    X = np.linalg.solve(H, np.eye(len(H))[:, start : start + own.stop - own.start])
    links = 9 * len(problem.links.DR)
    mine = slice(links, links + len(case.pair))
    plane, rows, residual = problem.bins.plane[case.pair], J[mine] @ X, r[mine]
    lacking = sum(
        (rows[plane == p].T @ residual[plane == p]) ** 2 - np.sum(rows[plane == p] ** 2, axis=0)
        for p in range(len(case.estimate.normals))
    )
    said = [Disagreement("planes", 4.0, np.eye(CALIBRATION)), Disagreement("range", 1.0, np.zeros((7, 7)))]
    columns = np.arange(own.start, own.stop)
    found = unexplained_variance(problem, case.estimate, columns, said)
    np.testing.assert_allclose(found, np.maximum(lacking, 0.0), rtol=2e-3, atol=1e-3 * np.abs(lacking).max())
    assert (found > 0.0).any()
    assert unexplained_variance(problem, case.estimate, columns, said[1:]).tolist() == [0.0] * case.nuisance.size
    # Some of them, in any order.
    some = columns[[4, 1]]
    np.testing.assert_allclose(unexplained_variance(problem, case.estimate, some, said), found[[4, 1]], rtol=1e-6)
    # Pulls of what noise allows and less widen nothing; of two ways to take a recording apart the one that lacks more.
    ways = {
        "planes": Influences(np.array([[1.0, 2.0, 3.0]]), np.array([[3.0, 1.0, 1.0]])),
        "time": Influences(np.array([[1.0, 3.0, 1.0]]), np.array([[3.0, 1.0, 1.0]])),
    }
    monkeypatch.setattr("calib_core.full.assess.disagreement._Ways.clusters", lambda _ways, _of: ways)
    both = [said[0], Disagreement("time", 4.0, np.eye(CALIBRATION))]
    three = np.arange(own.start, own.start + 3)
    assert unexplained_variance(problem, case.estimate, three, both).tolist() == [0.0, 8.0, 8.0]


def test_a_parameter_that_alone_disagrees_is_found_among_many_and_noise_is_not() -> None:
    """Mutations: the limit of one parameter for each of a hundred; the law's mean for its limit."""
    rng = np.random.default_rng(5)
    unknowns, clusters, runs = 100, 40, 200
    allowed = rng.dirichlet(np.ones(clusters), unknowns).T
    beyond = 0
    for _ in range(runs):
        moved = np.sqrt(allowed) * rng.normal(size=allowed.shape)
        beyond += int(_is_beyond_noise(Influences(moved, allowed), unknowns).any())
    assert beyond <= 3  # 0.2 expected
    moved[:, 3] *= 3.0
    assert np.flatnonzero(_is_beyond_noise(Influences(moved, allowed), unknowns)).tolist() == [3]


def _clusters(rng: np.random.Generator, count: int, direction: FloatArray | None = None) -> Influences:
    """Pulls of `count` clusters that noise allows, all alike, in units of the covariance; one direction thrice as far."""
    allowed = np.repeat(np.eye(CALIBRATION)[None] / count, count, axis=0)
    moved = rng.normal(size=(count, CALIBRATION)) / np.sqrt(count)
    if direction is not None:
        moved += 3.0 * rng.normal(size=(count, 1)) * direction / np.sqrt(count)
    return Influences(moved, allowed)


def test_noise_alone_is_hardly_ever_called_disagreement() -> None:
    """Mutations: the limit at the mean, the variance without its factor of two."""
    rng = np.random.default_rng(0)
    eye = np.eye(CALIBRATION)
    for count in (8, 60):
        found = [judge("time", _clusters(rng, count), eye, eye) for _ in range(2000)]
        beyond = sum(each.is_beyond_noise for each in found)
        assert beyond <= 9  # 2 expected; more than nine of a Poisson law's 2 once in twenty thousand
        assert 0.97 < np.mean([each.ratio**2 for each in found]) < 1.03


def test_disagreement_widens_the_direction_in_which_it_lies() -> None:
    """Mutation: all directions by the same factor."""
    rng = np.random.default_rng(1)
    eye = np.eye(CALIBRATION)
    direction = np.array([0.6, 0.0, 0.0, 0.8, 0.0, 0.0, 0.0])
    excess = np.mean([judge("surfaces", _clusters(rng, 60, direction), eye, eye).excess for _ in range(200)], axis=0)
    assert direction @ excess @ direction == pytest.approx(9.0, rel=0.1)
    across = np.array([0.8, 0.0, 0.0, -0.6, 0.0, 0.0, 0.0])
    assert across @ excess @ across < 0.25
    assert excess[1, 1] < 0.25


def test_one_error_seen_in_two_ways_counts_once() -> None:
    """Mutation: the sum of both."""
    stated = np.diag([1.0, 4.0, 1.0, 1.0, 9.0, 1.0, 1.0])
    way = np.eye(CALIBRATION)[4]
    found = [Disagreement("time", 2.0, 5.0 * np.outer(way, way)), Disagreement("range", 2.0, 4.0 * np.outer(way, way))]
    np.testing.assert_allclose(together(found, stated), 5.0 * np.outer(way, way), atol=1e-9)


def test_what_is_open_is_left_out() -> None:
    """Mutation: whitening by the whole covariance: along an open lever arm it is a prior's, ten metres wide."""
    std = np.array([0.01, 0.01, 0.01, 0.1, 0.1, 0.1, 0.01])
    way = np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8, 0.0])
    whiten, root = roots(np.diag(std**2))
    assert whiten.shape == (7, 7)
    whiten, root = roots(np.diag(std**2) + 1e6 * np.outer(way, way))
    assert whiten.shape == (7, 6)
    np.testing.assert_allclose(way @ root, 0.0, atol=1e-4)


def _same_as_by_azimuths_alone(held: JointProblem, estimate: Estimate, blocks: Nuisance) -> None:
    """Azimuths so wide that nothing else counts: what all lasers have together is narrower."""
    azimuth = next(each for each in blocks.blocks if each.block == "laser_azimuth")
    assert azimuth.whitener is not None
    wide = replace(azimuth, prior_std=1e5 * azimuth.prior_std, whitener=azimuth.whitener / 1e5)
    sensors = Nuisance(tuple(wide if each is azimuth else each for each in blocks.blocks))
    found, place = consider(held, estimate, sensors), blocks.places["laser_azimuth"]
    n = len(azimuth.names)
    mean = np.full((n, n), 1.0 / n)
    shift = found.shift[:, place] / UNITS[:, None]
    added = shift @ (np.eye(n) - (1.0 - settings.LASERS.azimuth_together**2) * mean) @ shift.T
    np.testing.assert_allclose(found.added, added, rtol=1e-3, atol=1e-4 * np.abs(added).max())


def test_considered_parameters_widen_by_what_they_would_move() -> None:
    """Schmidt's covariance against the block inverse of the whole problem and against brute shifts.

    Mutations: the prior's variance for its standard deviation, the cross block transposed, azimuths alike independent."""
    problem, estimate = solved_problem()
    own = problem.layout(estimate).nuisance()
    held = replace(problem, frozen=tuple(range(own.start, own.stop)))
    blocks = estimate.sensors.blocks
    prior_std = blocks.prior_std
    found = consider(held, estimate, blocks)
    _same_as_by_azimuths_alone(held, estimate, blocks)
    whole = solve_arrow(problem.linearise(estimate)).information
    A, B = whole[: own.start, : own.start], whole[: own.start, own]
    moved = np.linalg.solve(A, B)[:CALIBRATION] / UNITS[:, None]
    P = np.diag(prior_std**2)
    place = blocks.places["laser_azimuth"]
    P[place, place] -= (
        (1.0 - settings.LASERS.azimuth_together**2) * prior_std[place.start] ** 2 / (place.stop - place.start)
    )
    added = moved @ P @ moved.T
    np.testing.assert_allclose(found.added, added, rtol=1e-4, atol=1e-9 * np.abs(found.added).max())
    # What would be estimated is where the whole problem's next step leads: at its optimum, next to where it is.
    step = solve_arrow(problem.linearise(estimate)).step_shared[own] / prior_std
    np.testing.assert_allclose((found.value - estimate.sensors.values) / prior_std, step, atol=1e-9)
    assert np.abs(step).max() < 0.05
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(covariance(whole).matrix))[own], rtol=1e-6)


@pytest.mark.parametrize("alone", [False, True])
def test_influences_are_summed_cluster_by_cluster(alone: bool) -> None:
    """Oracle: each cluster's members picked out and added up. Mutation: those of no cluster added to the last one."""
    rng = np.random.default_rng(4)
    moved, allowed = rng.normal(size=(50, 7)), rng.normal(size=(50, 7) if alone else (50, 7, 7))
    cluster = rng.integers(-1, 4, size=50)
    found = Influences.none(5, 7, alone=alone)
    for some in (slice(20), slice(20, None)):
        found.add_by(cluster[some], Influences(moved[some], allowed[some]))
    assert (cluster < 0).any()
    for k in range(5):
        np.testing.assert_allclose(found.moved[k], moved[cluster == k].sum(axis=0), atol=1e-12)
        np.testing.assert_allclose(found.allowed[k], allowed[cluster == k].sum(axis=0), atol=1e-12)
