"""The descent on problems whose minimum, and whose way of failing, are known."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.solver.levenberg import Outcome, minimise
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray
from tests.core.solver.descended import FORBIDDEN, Bowl, Trade, Valley


class Upwards(Valley):
    """Claims the opposite slope: no step lowers the cost."""

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        system = super().linearise(estimate)
        system.gradient *= -1.0
        system.gradient_shared *= -1.0
        return system


class Flat(Valley):
    """Curvature of the wrong sign: nothing can be factorised, whatever the damping."""

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        system = super().linearise(estimate)
        system.diagonal *= -1.0
        return system


def test_information_is_never_that_of_a_damped_step() -> None:
    """Fails when the solution of the last, damped step is handed out: its information is more than the problem has.

    The bowl's curvature is the same everywhere, so what the border has is known: 0.1 (J' J) without its chain.
    """
    J = np.array([[3.0, 1.0], [1.0, -1.0]])
    H = 0.1 * J.T @ J
    for most in (1, 3, 60):
        end = minimise(Bowl(), np.array([5.0, -3.0]), max_iterations=most)
        assert end.solution is not None
        assert end.solution.information[0, 0] == pytest.approx(H[1, 1] - H[0, 1] ** 2 / H[0, 0], rel=1e-12)


def test_valley_is_followed_to_its_minimum_and_the_cost_never_rises() -> None:
    """Fails when a step is accepted whatever its cost."""
    costs: list[float] = []
    problem = Valley()
    end = minimise(problem, np.array([-1.2, 1.0]), max_iterations=60, on_step=lambda _, cost, __: costs.append(cost))
    np.testing.assert_allclose(end.estimate, [1.0, 1.0], atol=1e-5)
    assert end.outcome is Outcome.CONVERGED
    assert costs == sorted(costs, reverse=True)
    assert end.cost == costs[-1] < 1e-10


def test_a_cost_that_is_not_a_number_is_never_accepted() -> None:
    """Fails when acceptance does not ask whether the cost is finite: NaN estimates follow."""
    problem = Valley()
    costs: list[float] = []
    # The first full step from here leads to y = -3.84, beyond the wall.
    end = minimise(problem, np.array([-1.2, 1.0]), max_iterations=60, on_step=lambda _, cost, __: costs.append(cost))
    assert any(asked[1] < FORBIDDEN for asked in problem.asked)
    assert np.isfinite(costs).all()
    np.testing.assert_allclose(end.estimate, [1.0, 1.0], atol=1e-4)


def test_damping_grows_until_the_cost_falls() -> None:
    """Fails when damping stays zero after a refused step."""
    end = minimise(Bowl(), np.array([0.0, 0.2]), max_iterations=200)
    np.testing.assert_allclose(end.estimate, [1.0, 1.0], atol=1e-3)


def test_outcomes_say_why() -> None:
    """Fails when the loop reports CONVERGED for whatever made it stop."""
    start = np.array([-1.2, 1.0])
    assert minimise(Valley(), start, max_iterations=2).outcome is Outcome.EXHAUSTED
    assert minimise(Upwards(), start).outcome is Outcome.STALLED
    singular = minimise(Flat(), start)
    assert singular.outcome is Outcome.SINGULAR
    assert singular.solution is None
    np.testing.assert_array_equal(singular.estimate, start)


def test_first_decrease_is_that_of_the_first_undamped_step() -> None:
    """Fails when the last step's decrease is reported: every minimum would look like a fixed point.

    From (1, 2): r = (10, 0), and the step to the minimum of the linear model takes all of the cost, 50.
    """
    end = minimise(Valley(), np.array([1.0, 2.0]))
    assert end.first_decrease == pytest.approx(50.0)
    again = minimise(Valley(), end.estimate)
    assert again.first_decrease < 1e-6
    assert again.outcome is Outcome.CONVERGED
    assert again.iterations == 1


class Vanishing(Valley):
    """Nothing can be factorised from the second linearisation on."""

    linearised = 0

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        system = super().linearise(estimate)
        self.linearised += 1
        if self.linearised > 1:
            system.diagonal *= -1.0
        return system


def test_a_system_that_becomes_singular_is_said_to_be() -> None:
    """What the first linearisation knew is not handed out for the second, where nothing could be solved.

    Mutation: keep `solution` from one iteration to the next: STALLED, with the information of a place that was left.
    """
    end = minimise(Vanishing(), np.array([1.0, 2.0]))
    assert end.outcome is Outcome.SINGULAR
    assert end.solution is None
    np.testing.assert_allclose(end.estimate, [1.0, 1.0])


def test_a_small_damped_step_is_not_convergence() -> None:
    """Far from its minimum, up a claimed slope, damping makes any step small.

    Mutation: ask for a negligible decrease without asking whether the step was damped.
    """
    end = minimise(Upwards(), np.array([-1.2, 1.0]), tolerance=0.1)
    assert end.outcome is Outcome.STALLED
    assert end.cost > 1.0


def test_a_step_below_the_costs_round_off_is_convergence() -> None:
    """A cost of 1e9 that the step changes by 1e-4, which summing cannot tell. Mutation: tolerance alone."""

    class Deep(Valley):
        """The valley on a high plateau, whose cost is rounded as a sum of many is."""

        def cost(self, estimate: FloatArray) -> float:
            return float(np.round(1e9 + super().cost(estimate), 2))

    at = np.array([1.0, 1.0 + 1e-3])
    end = minimise(Deep(), at)
    assert end.outcome is Outcome.CONVERGED
    assert end.iterations == 1


class Timid(Bowl):
    """Claims one and a half times the curvature: steps go two thirds of the way, and promise a ninth of the one before."""

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        system = super().linearise(estimate)
        more = (15.0 * part for part in (system.diagonal, system.lower, system.border, system.corner))
        return ArrowSystem(*more, system.gradient, system.gradient_shared)


def test_it_ends_at_a_part_of_the_first_step() -> None:
    """A ninth of a ninth of a ninth of a ninth is below a thousandth, one less is not: the fifth step ends it. Where steps are
    damped they are small wherever they are, and count for nothing.

    Mutations: `relative` ignored; of the step before instead of the first; of damped steps too: STALLED, far from the minimum.
    """
    start = np.array([5.0, 3.0])
    end = minimise(Timid(), start, max_iterations=60, relative=1e-3)
    assert (end.iterations, end.outcome) == (5, Outcome.CONVERGED)
    np.testing.assert_allclose(end.estimate - 1.0, (start - 1.0) / 3**5)
    end = minimise(Valley(), np.array([-1.2, 1.0]), max_iterations=60, relative=1e-2)
    assert end.outcome is Outcome.CONVERGED
    np.testing.assert_allclose(end.estimate, [1.0, 1.0], atol=1e-4)


def test_what_two_unknowns_trade_is_found_in_a_few_steps() -> None:
    """As a sensor's axes trade with the rotation: the full step bends off, and what is damped for it must not be all of the way.

    Mutation: a least damping of 1e-6, with which as many steps end half-way.
    """
    problem = Trade()
    end = minimise(problem, np.zeros(2), max_iterations=10)
    assert end.outcome is Outcome.CONVERGED
    assert end.estimate[0] == pytest.approx(2.0, abs=1e-6)
