"""The arrow solver against the same system written out in full and solved by NumPy."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest

from calib_core.solver import arrow
from calib_core.solver.arrow import ArrowSolution, Eliminated, NotPositiveDefinite, solve_arrow, solve_shared
from calib_core.solver.system import ArrowPart, ArrowSystem
from calib_core.types import FloatArray


def random_system(seed: int, knots: int, n: int, shared: int) -> ArrowSystem:
    """Normal equations of random residuals between neighbours and the border."""
    rng = np.random.default_rng(seed)
    system = ArrowSystem.zeros(knots, n, shared)
    for k in range(knots):
        second = k + 1 if k + 1 < knots else None
        J0, J1 = rng.normal(size=(2, 2 * n, n))
        JS = rng.normal(size=(2 * n, shared))
        r = rng.normal(size=2 * n)
        system.diagonal[k] += J0.T @ J0
        system.border[k] += J0.T @ JS
        system.gradient[k] += J0.T @ r
        system.corner += JS.T @ JS
        system.gradient_shared += JS.T @ r
        if second is not None:
            system.diagonal[second] += J1.T @ J1
            system.lower[k] += J1.T @ J0
            system.border[second] += J1.T @ JS
            system.gradient[second] += J1.T @ r
    return system


def dense(system: ArrowSystem) -> tuple[FloatArray, FloatArray]:
    """H and gradient with every zero written out, border last."""
    knots, n, _ = system.diagonal.shape
    shared = system.corner.shape[0]
    H = np.zeros((knots * n + shared, knots * n + shared))
    for k in range(knots):
        at = slice(k * n, (k + 1) * n)
        H[at, at] = system.diagonal[k]
        H[at, knots * n :] = system.border[k]
        H[knots * n :, at] = system.border[k].T
        if k + 1 < knots:
            after = slice((k + 1) * n, (k + 2) * n)
            H[after, at] = system.lower[k]
            H[at, after] = system.lower[k].T
    H[knots * n :, knots * n :] = system.corner
    return H, np.concatenate([system.gradient.ravel(), system.gradient_shared])


@pytest.mark.parametrize(("knots", "n", "shared"), [(1, 9, 4), (2, 3, 1), (7, 4, 5), (30, 9, 13)])
@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_step_is_the_dense_solution(knots: int, n: int, shared: int, damping: float) -> None:
    """Fails when `eliminate_kernel` takes M's columns for its rows, or damping leaves the border out."""
    system = random_system(knots + n, knots, n, shared)
    H, g = dense(system)
    expected = -np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
    solution = solve_arrow(system, damping=damping)
    step = np.concatenate([solution.step.ravel(), solution.step_shared])
    np.testing.assert_allclose(step, expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_a_chain_may_be_cut_anywhere(monkeypatch: pytest.MonkeyPatch, damping: float) -> None:
    """Against the dense solution, with a column that a part of the chain touches and one that is frozen.

    Mutation: leave out what a piece says of the knot before it; let go of the last piece's own columns; forget the knot
    after a piece on the way back.
    """
    system = random_system(8, 31, 3, 5)
    system.border[:20, :, 3] = system.border[14:, :, 1] = 0.0
    frozen = replace(system, frozen=(2,))
    monkeypatch.setattr(arrow, "_PIECE", 6)
    H, g = dense(system)
    free = np.delete(np.arange(len(g)), 31 * 3 + 2)
    expected = np.zeros(len(g))
    expected[free] = -np.linalg.solve((H + damping * np.diag(np.diag(H)))[np.ix_(free, free)], g[free])
    solution = solve_arrow(frozen, damping=damping)
    step = np.concatenate([solution.step.ravel(), solution.step_shared])
    np.testing.assert_allclose(step, expected, rtol=1e-8, atol=1e-10)
    if damping == 0.0:
        along, border = Eliminated.of(frozen).unit_responses(frozen, np.array([2, 0, 1]))
        inverse = np.zeros_like(H)
        inverse[np.ix_(free, free)] = np.linalg.inv(H[np.ix_(free, free)])
        columns = 31 * 3 + np.array([2, 0, 1])
        got = np.vstack([along.reshape(-1, 3), border])
        np.testing.assert_allclose(got, inverse[:, columns], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("piece", [6, 256])
def test_who_asks_for_no_step_gets_the_same_of_what_is_shared(monkeypatch: pytest.MonkeyPatch, piece: int) -> None:
    """To the last bit. Mutations: a piece's first knot kept for its last; frozen columns known."""
    system = random_system(8, 31, 3, 5)
    system.border[:20, :, 3] = system.border[14:, :, 1] = 0.0
    system = replace(system, frozen=(2,))
    monkeypatch.setattr(arrow, "_PIECE", piece)
    whole = solve_arrow(system)
    information, gradient = solve_shared(system)
    np.testing.assert_array_equal(information, whole.information)
    np.testing.assert_array_equal(gradient, whole.gradient_shared)
    np.testing.assert_array_equal(information[2], arrow.FROZEN * (np.arange(5) == 2))
    assert gradient[2] == 0.0


def test_who_asks_for_no_step_holds_no_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of ten minutes it is 80 MB. Mutation: none of its rows, as a view that keeps them all."""
    monkeypatch.setattr(arrow, "_PIECE", 6)
    for piece in arrow._eliminated(random_system(8, 31, 3, 5), 0.0, for_steps=False).pieces:
        for of_chain in (piece.L, piece.M):
            whole = of_chain if of_chain.base is None else of_chain.base
            assert whole.size == 0


@dataclass
class Apart:
    """A system whose parts have their columns in another order, without those that are zero there, and a share of the corner."""

    whole: ArrowSystem

    @property
    def knots(self) -> int:
        return self.whole.knots

    @property
    def shared(self) -> int:
        return self.whole.shared

    @property
    def frozen(self) -> tuple[int, ...]:
        return self.whole.frozen

    def part(self, first: int, last: int) -> ArrowPart:
        part = self.whole.part(first, last)
        columns = np.random.default_rng(first).permutation(np.flatnonzero(np.any(part.border != 0.0, axis=(0, 1))))
        share = (last - first) / self.knots
        among = np.ix_(columns, columns)
        return replace(
            part,
            border=part.border[:, :, columns],
            columns=columns,
            corner=share * self.whole.corner[among],
            gradient_shared=share * self.whole.gradient_shared[columns],
        )

    def common(self) -> tuple[FloatArray, FloatArray]:
        corner, gradient = self.whole.common()
        for first, last in pairwise(self.edges()):
            part = self.part(first, last)
            corner[np.ix_(part.columns, part.columns)] -= part.corner
            gradient[part.columns] -= part.gradient_shared
        return corner, gradient

    def edges(self) -> list[int]:
        pieces = max(1, round(self.knots / arrow._PIECE))
        return [0, *((np.arange(1, pieces) * self.knots) // pieces + 1).tolist(), self.knots]

    def pulls(self, along: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        return self.whole.pulls(along)

    def border_times(self, shared: FloatArray) -> FloatArray:
        return self.whole.border_times(shared)


@pytest.mark.parametrize("piece", [6, 256])
def test_a_part_may_have_columns_of_its_own(monkeypatch: pytest.MonkeyPatch, piece: int) -> None:
    """The same system with each part's columns in another order, those left out that are zero there, its share of the corner.

    Mutations: columns taken in order; a part's corner, or its gradient, not added; frozen ones kept.
    """
    rng = np.random.default_rng(3)
    whole = random_system(9, 31, 3, 6)
    held = rng.random((31, 1, 6)) < 0.2
    held[10:, :, 4] = held[:25, :, 1] = False
    whole = replace(whole, border=np.where(held, whole.border, 0.0), frozen=(2,))
    whole.corner[:] += 30.0 * np.eye(6)
    monkeypatch.setattr(arrow, "_PIECE", piece)
    expected, found = solve_arrow(whole, damping=0.1), solve_arrow(Apart(whole), damping=0.1)
    np.testing.assert_allclose(found.step, expected.step, atol=1e-12)
    np.testing.assert_allclose(found.step_shared, expected.step_shared, atol=1e-12)
    np.testing.assert_allclose(found.information, expected.information, rtol=1e-9, atol=1e-9)
    assert found.predicted_decrease == pytest.approx(expected.predicted_decrease)


def test_written_out_it_is_the_same() -> None:
    """Mutations: the first knot's coupling with none before it kept; a part's corner not added."""
    whole = replace(random_system(9, 12, 3, 6), frozen=(2,))
    again = ArrowSystem.of(Apart(whole))
    for name in ("diagonal", "lower", "border", "corner", "gradient", "gradient_shared"):
        np.testing.assert_allclose(getattr(again, name), getattr(whole, name), rtol=1e-12, atol=1e-12)
    assert again.frozen == (2,)


def test_information_is_the_inverse_of_the_borders_covariance() -> None:
    """Fails when the Schur complement adds B' A^-1 B instead of subtracting it."""
    system = random_system(3, 12, 9, 6)
    covariance = np.linalg.inv(dense(system)[0])[-6:, -6:]
    np.testing.assert_allclose(np.linalg.inv(solve_arrow(system).information), covariance, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_predicted_decrease_is_half_the_step_against_the_gradient(damping: float) -> None:
    """Fails when the border's share is left out of the slope.

    Undamped, the quadratic model falls by exactly g' H^-1 g / 2.
    """
    system = random_system(4, 9, 5, 3)
    H, g = dense(system)
    step = np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
    assert solve_arrow(system, damping=damping).predicted_decrease == pytest.approx(0.5 * g @ step, rel=1e-9)


def test_unknowns_of_very_different_sizes_cost_no_digits() -> None:
    """Fails when damping is added to the diagonal instead of growing it: a step would then depend on the units.

    The oracle solves the same system in units in which every unknown is of size one.
    """
    knots, n, shared = 8, 4, 3
    system = random_system(5, knots, n, shared)
    size = 10.0 ** np.linspace(-7, 7, n)
    shared_size = np.array([1e-6, 1.0, 1e6])
    scaled = replace(
        system,
        diagonal=system.diagonal * size[:, None] * size,
        lower=system.lower * size[:, None] * size,
        border=system.border * size[:, None] * shared_size,
        corner=system.corner * shared_size[:, None] * shared_size,
        gradient=system.gradient * size,
        gradient_shared=system.gradient_shared * shared_size,
    )
    plain, odd = solve_arrow(system, damping=0.3), solve_arrow(scaled, damping=0.3)
    np.testing.assert_allclose(odd.step * size, plain.step, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(odd.step_shared * shared_size, plain.step_shared, rtol=1e-8)


def test_a_chain_that_is_not_positive_definite_is_refused() -> None:
    """Fails when LinAlgError of the chain is not turned into NotPositiveDefinite."""
    chain = random_system(6, 5, 3, 2)
    chain.diagonal[2] -= 1e4 * np.eye(3)
    with pytest.raises(NotPositiveDefinite, match="chain"):
        solve_arrow(chain)


def test_the_border_takes_no_step_along_what_nothing_determines() -> None:
    """Fails when the border is solved without asking what its information resolves: a huge step, or an error.

    Two columns that act only through their sum: no step of the difference, and for the rest the minimum-norm answer.
    """
    system = random_system(6, 8, 3, 3)
    mix = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 1.0, 0]]).T
    twin = replace(
        system,
        border=system.border @ mix,
        corner=mix.T @ system.corner @ mix,
        gradient_shared=mix.T @ system.gradient_shared,
    )
    solution = solve_arrow(twin)
    reduced = solve_arrow(
        replace(
            system,
            border=system.border[:, :, :2],
            corner=system.corner[:2, :2],
            gradient_shared=system.gradient_shared[:2],
        )
    )
    assert solution.step_shared[1] == pytest.approx(solution.step_shared[2], abs=1e-7)
    np.testing.assert_allclose([solution.step_shared[0], 2 * solution.step_shared[1]], reduced.step_shared, atol=1e-7)
    np.testing.assert_allclose(solution.step, reduced.step, atol=1e-7)


def test_the_system_is_left_as_it_was() -> None:
    """Fails when damping is added to the system in place: the next, larger damping would come on top."""
    system = random_system(7, 6, 4, 3)
    before, _ = dense(system)
    solve_arrow(system, damping=0.5)
    np.testing.assert_array_equal(dense(system)[0], before)


def test_solving_again_starts_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads are made once for the process: a solve in a loop must not make its own.

    Mutation: a ThreadPoolExecutor in `_eliminated`.
    """
    monkeypatch.setattr(arrow, "_PIECE", 2)
    system = random_system(seed=1, knots=6, n=3, shared=4)
    for _ in range(8):
        solve_arrow(system)
    started = []
    start = threading.Thread.start
    monkeypatch.setattr(threading.Thread, "start", lambda self: (started.append(self), start(self)))
    for _ in range(3):
        solve_arrow(system)
    assert len(started) <= 1  # a worker that was not yet needed


@pytest.mark.parametrize("piece", [6, 256])
def test_another_gradient_goes_through_the_same_elimination(monkeypatch: pytest.MonkeyPatch, piece: int) -> None:
    """Against the dense solution, whether the chain is cut or not, and with a column that is frozen.

    Mutations: leave out what a piece's gradient says of the knot before it, or of the one after; the border's own gradient
    that of before.
    """
    system = random_system(8, 31, 3, 5)
    system.border[:20, :, 3] = system.border[14:, :, 1] = 0.0
    system.frozen = (2,)
    monkeypatch.setattr(arrow, "_PIECE", piece)
    rng = np.random.default_rng(9)
    other = replace(system, gradient=rng.normal(size=system.gradient.shape), gradient_shared=rng.normal(size=5))
    eliminated = arrow.Eliminated.of(system)
    first = eliminated.solution(system)
    H, g = dense(other)
    free = np.delete(np.arange(len(g)), 31 * 3 + 2)
    expected = np.zeros(len(g))
    expected[free] = -np.linalg.solve(H[np.ix_(free, free)], g[free])
    for _ in range(2):
        found = eliminated.again(other)
        np.testing.assert_allclose(np.append(found.step, found.step_shared), expected, rtol=1e-8, atol=1e-10)
        assert found.predicted_decrease == pytest.approx(-0.5 * float(g @ expected))
        np.testing.assert_allclose(found.information, first.information)
    np.testing.assert_allclose(eliminated.again(system).step, first.step, rtol=1e-8, atol=1e-12)


def test_a_covariance_that_many_ask_for_is_made_once() -> None:
    """And is the information's. Mutations: made at each question; of something else."""
    information = np.diag([4.0, 1e6, 1e-4])
    solution = ArrowSolution(np.zeros((0, 9)), np.zeros(3), information, 0.0)
    np.testing.assert_allclose(solution.covariance.matrix, np.diag([0.25, 1e-6, 1e4]), rtol=1e-12)
    assert solution.covariance is solution.covariance
