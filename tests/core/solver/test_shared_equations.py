"""Steps by the equations of the one before, and what descents hand on to one another."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.solver.levenberg import Outcome, SharedEquations, minimise
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray
from tests.core.solver.descended import Bowl, Valley


class Bent(Valley):
    """r = [3 x + y - 4 + bend x^2, x - y]: nearly linear, so that equations change little on the way."""

    bend = 0.01

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([3.0 * e[0] + e[1] - 4.0 + self.bend * e[0] ** 2, e[0] - e[1] + 0.3])

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[3.0 + 2.0 * self.bend * estimate[0], 1.0], [1.0, -1.0]])
        H, g = J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


@pytest.mark.parametrize(("problem", "start"), [(Bent(), [2.0, 2.0]), (Valley(), [-1.2, 1.0]), (Bowl(), [5.0, -3.0])])
def test_shared_equations_lead_to_the_same_minimum(
    eliminations: list[float], problem: Valley, start: list[float]
) -> None:
    """By fewer eliminations where equations hardly change; without sharing each step has its own.

    Mutation: the gradient shared too (it stays where the first step led).
    """
    ends, made = [], []
    for share in (False, True):
        eliminations.clear()
        ends.append(
            minimise(
                problem,
                np.array(start),
                max_iterations=200,
                tolerance=1e-12,
                shared=SharedEquations() if share else None,
            )
        )
        made.append(len(eliminations))
    np.testing.assert_allclose(ends[1].estimate, ends[0].estimate, atol=1e-5)
    assert ends[1].outcome is ends[0].outcome
    assert made[0] >= ends[0].iterations
    if isinstance(problem, Bent):
        assert made[1] < made[0]


def test_equations_that_change_are_not_shared() -> None:
    """Where they bend, steps of other equations come nearer slowly: they are as many as without.

    Mutations: no bound on how long a shared step may be (26 steps instead of 5); on what it leaves of the one before (9).
    """
    problem = Bent()
    problem.bend = 1.0
    own, shared = (
        minimise(
            problem,
            np.array([2.0, 2.0]),
            max_iterations=200,
            tolerance=1e-12,
            shared=SharedEquations() if share else None,
        )
        for share in (False, True)
    )
    np.testing.assert_allclose(shared.estimate, own.estimate, atol=1e-7)
    assert shared.iterations <= own.iterations + 1


def test_a_descent_begins_by_the_equations_of_the_one_before(eliminations: list[float]) -> None:
    """Beside the minimum, and makes none. Mutations: not kept; not begun with."""
    shared = SharedEquations()
    first = minimise(Bent(), np.array([2.0, 2.0]), max_iterations=200, tolerance=1e-12, shared=shared)
    eliminations.clear()
    beside = first.estimate + np.array([0.01, -0.02])
    next_ = minimise(Bent(), beside, tolerance=1e-12, shared=shared)
    assert eliminations == []
    assert next_.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(next_.estimate, first.estimate, atol=1e-5)
    minimise(Bent(), beside, tolerance=1e-12)
    assert eliminations


class Weighed(Bent):
    """A linear one whose points weigh so many times as much."""

    bend = 0.0

    def __init__(self, times: float) -> None:
        super().__init__()
        self.times = times

    def residual(self, e: FloatArray) -> FloatArray:
        return np.sqrt(self.times) * super().residual(e)

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.sqrt(self.times) * np.array([[3.0, 1.0], [1.0, -1.0]])
        H, g = J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


@pytest.mark.parametrize(
    ("times", "roughly", "own", "left"),
    [(1.05, True, 0, 0.05), (1.5, True, 1, 0.0), (0.5, True, 1, 0.0), (1.05, False, 1, 0.0)],
)
def test_a_rough_step_is_taken_where_it_finds_what_it_predicts(
    eliminations: list[float], times: float, roughly: bool, own: int, left: float
) -> None:
    """From afar, by equations of points that weighed less: at most that part of its way is left. Where the curvature is another
    one by half, its own are made, which lead all the way; as they are where nobody asks for rough ones.

    Mutations: any that lowers the cost is taken; only one that predicts too much is not; a rough one though nobody asked; never.
    """
    shared = SharedEquations()
    before = minimise(Weighed(1.0), np.array([0.0, 0.0]), tolerance=1e-12, shared=shared)
    eliminations.clear()
    start = before.estimate + np.array([3.0, 4.0])
    end = minimise(Weighed(times), start, max_iterations=1, shared=shared, roughly=roughly)
    assert len(eliminations) == own
    assert np.linalg.norm(end.estimate - before.estimate) <= 5.0 * left + 1e-9
