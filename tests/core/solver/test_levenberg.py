"""The descent on problems whose minimum, and whose way of failing, are known."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from calib_core.solver.arrow import ArrowSolution, Eliminated
from calib_core.solver.levenberg import Outcome, SharedEquations, _Damping, minimise
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray

#: Sends the descent of the valley through a wall.
_FORBIDDEN = -0.5


@dataclass
class Valley:
    """Rosenbrock's valley, r = [10 (y - x^2), 1 - x]: x in the chain, y on the border. The minimum is at (1, 1)."""

    asked: list[FloatArray] = field(default_factory=list)

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([10.0 * (e[1] - e[0] ** 2), 1.0 - e[0]])

    def cost(self, estimate: FloatArray) -> float:
        self.asked.append(estimate)
        if estimate[1] < _FORBIDDEN:
            return float("nan")
        return 0.5 * float(np.sum(self.residual(estimate) ** 2))

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[-20.0 * estimate[0], 10.0], [-1.0, 0.0]])
        H, g = J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])

    def moved(self, estimate: FloatArray, solution: ArrowSolution) -> FloatArray:
        return estimate + np.array([solution.step[0, 0], solution.step_shared[0]])


class Bowl(Valley):
    """r = [3 x + y - 4, x - y], with a curvature claimed to be ten times too small: every full step overshoots."""

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([3.0 * e[0] + e[1] - 4.0, e[0] - e[1]])

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[3.0, 1.0], [1.0, -1.0]])
        H, g = 0.1 * J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


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
    assert any(asked[1] < _FORBIDDEN for asked in problem.asked)
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


class Trade(Valley):
    """r = [1e4 (y - x) - 1.5 x^2, x - 2]: x and y trade with one another, x is held by a hundred-millionth of its curvature."""

    stiff, bend = 1e4, 1.5

    def residual(self, e: FloatArray) -> FloatArray:
        return np.array([self.stiff * (e[1] - e[0]) - self.bend * e[0] ** 2, e[0] - 2.0])

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        J = np.array([[-self.stiff - 2.0 * self.bend * estimate[0], self.stiff], [1.0, 0.0]])
        H, g = J.T @ J, J.T @ self.residual(estimate)
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


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


class Street(Trade):
    """The same with a million-millionth: metres along a street that hardly a point tells."""

    stiff, bend = 1e6, 3.0


def test_a_valley_is_gone_along_where_next_to_nothing_holds() -> None:
    """Mutation: the least damping of others, with which as many steps end before the middle."""
    start = np.zeros(2)
    end = minimise(Street(), start, max_iterations=25, along_valleys=True)
    assert end.estimate[0] == pytest.approx(2.0, abs=1e-3)
    assert end.outcome is not Outcome.EXHAUSTED
    other = minimise(Street(), start, max_iterations=25)
    assert other.estimate[0] < 1.0


class Drift(Valley):
    """A street: every step predicts as much along it, and finds nothing."""

    def cost(self, estimate: FloatArray) -> float:
        return 5.0

    def linearise(self, estimate: FloatArray) -> ArrowSystem:
        H, g = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([0.01, 0.01])
        return ArrowSystem(H[:1, :1][None], np.zeros((0, 1, 1)), H[:1, 1:][None], H[1:, 1:], g[:1][None], g[1:])


def test_steps_that_find_nothing_down_a_street_end_soon() -> None:
    """Mutations: damped steps only; gone on with to the last; so from afar as well."""
    steps: list[float] = []
    end = minimise(Drift(), np.zeros(2), along_valleys=True, on_step=lambda _, cost, __: steps.append(cost))
    assert (end.outcome, len(steps)) == (Outcome.CREEPING, 3)
    assert minimise(Drift(), np.zeros(2), max_iterations=9).outcome is Outcome.EXHAUSTED


@pytest.mark.parametrize(
    ("damped", "found", "predicted", "ends"),
    [
        (True, [1e-4, 1e-4, 1e-4], 1e-4, [False, False, True]),
        (True, [1e-4, 1e-2, 1e-4, 1e-4, 1e-4], 1e-4, [False, False, False, False, True]),
        (False, [1e-4, 1e-4, 1e-4, 1e-4], 1e-4, [False] * 4),
        (False, [1e-4, 1e-4, 1e-4], 1e-3, [False, False, True]),
    ],
)
def test_what_creeps_is_damped_or_finds_less_than_it_says(
    damped: bool, found: list[float], predicted: float, ends: list[bool]
) -> None:
    """Three in a row. Mutations: three in all; undamped steps that find what they predict."""
    damping = _Damping(along_valleys=True)
    for each, last in zip(found, ends, strict=True):
        damping.now = 1e-5 if damped else 0.0
        assert damping.accepted(each, predicted) is (Outcome.CREEPING if last else None)


@pytest.fixture
def eliminations(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The damping of each that is made from now on."""
    made: list[float] = []
    real = Eliminated.of

    def counting(system: ArrowSystem, *, damping: float = 0.0) -> Eliminated:
        made.append(damping)
        return real(system, damping=damping)

    monkeypatch.setattr(Eliminated, "of", counting)
    return made


def test_along_valleys_damping_soon_grows_faster(eliminations: list[float]) -> None:
    """From next to nothing to what bends far as quickly as others. Mutations: tenfold each time; a step's refusals counted for
    the next one; damping that stays.
    """
    minimise(Valley(), np.array([0.0, 0.2]), max_iterations=4, along_valleys=True)
    grown, sunk, again, information = [0.0, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3, 1.0], [1e-1, 1e-2, 1e-3], [1e-2], [0.0]
    assert eliminations == pytest.approx([*grown, *sunk, *again, *information])


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
