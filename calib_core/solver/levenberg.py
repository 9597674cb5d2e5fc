"""Gauss-Newton with Levenberg-Marquardt damping on any problem that can linearise, move and price an estimate.

Descent (the damped step) and acceptance (the cost must fall) are apart. The predicted decrease of the undamped step is
half the squared length of the step in units of its own standard deviations, so that convergence means the same
thing for every unknown: the answer would move by a negligible part of its own uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Generic, Protocol, TypeVar

import numpy as np

from calib_core.solver.arrow import ArrowSolution, ArrowSystem, NotPositiveDefinite, solve_arrow

E = TypeVar("E")


class Problem(Protocol[E]):
    """What the loop asks of a problem."""

    def cost(self, estimate: E) -> float:
        """Half the sum of squares."""
        ...

    def linearise(self, estimate: E) -> ArrowSystem:
        """Normal equations at an estimate."""
        ...

    def moved(self, estimate: E, solution: ArrowSolution) -> E:
        """The estimate after a step."""
        ...


class Outcome(Enum):
    """Why the loop ended."""

    CONVERGED = "the step is a negligible part of its own uncertainty"
    STALLED = "no step lowers the cost any further"
    EXHAUSTED = "the iterations were used up"
    SINGULAR = "the normal equations stayed singular"


@dataclass(frozen=True)
class Minimum(Generic[E]):
    """Where the loop ended. solution: of the last linearisation. first_decrease: predicted by the first step."""

    estimate: E
    cost: float
    solution: ArrowSolution | None
    outcome: Outcome
    iterations: int
    first_decrease: float


def minimise(
    problem: Problem[E],
    estimate: E,
    *,
    max_iterations: int = 30,
    tolerance: float = 1e-6,
    on_step: Callable[[E, float, ArrowSolution], None] | None = None,
) -> Minimum[E]:
    """The least-squares estimate from a start. tolerance: of the predicted decrease of the cost."""
    end, system, damping = _descend(problem, estimate, max_iterations, tolerance, on_step)
    if damping == 0.0 or system is None or end.solution is None:
        return end
    # The damped equations are no information: with them, what is hardly known would pass for known.
    try:
        return replace(end, solution=solve_arrow(system))
    except NotPositiveDefinite:
        return replace(end, solution=None, outcome=Outcome.SINGULAR)


def _descend(
    problem: Problem[E],
    estimate: E,
    max_iterations: int,
    tolerance: float,
    on_step: Callable[[E, float, ArrowSolution], None] | None,
) -> tuple[Minimum[E], ArrowSystem | None, float]:
    """Where it ended, the last linearisation and the damping of its solution."""
    cost = problem.cost(estimate)
    damping = used = 0.0
    solution: ArrowSolution | None = None
    system: ArrowSystem | None = None
    first = np.inf
    for iteration in range(max_iterations):
        system = problem.linearise(estimate)
        accepted = False
        candidate, new_cost = estimate, cost
        for _ in range(12):
            try:
                solution, used = solve_arrow(system, damping=damping), damping
            except NotPositiveDefinite:
                damping = max(damping * 10.0, 1e-9)
                continue
            if iteration == 0 and not np.isfinite(first):
                first = solution.predicted_decrease
            candidate = problem.moved(estimate, solution)
            new_cost = problem.cost(candidate)
            if np.isfinite(new_cost) and new_cost <= cost + 1e-12 * abs(cost):
                accepted = True
                break
            if solution.predicted_decrease < tolerance * max(1.0, 1e-6 * cost):
                return Minimum(estimate, cost, solution, Outcome.CONVERGED, iteration + 1, first), system, used
            damping = max(damping * 10.0, 1e-6)
        if solution is None:
            return Minimum(estimate, cost, None, Outcome.SINGULAR, iteration + 1, first), system, used
        if not accepted:
            return Minimum(estimate, cost, solution, Outcome.STALLED, iteration + 1, first), system, used
        estimate, cost = candidate, new_cost
        if on_step is not None:
            on_step(estimate, cost, solution)
        if damping == 0.0 and solution.predicted_decrease < tolerance:
            return Minimum(estimate, cost, solution, Outcome.CONVERGED, iteration + 1, first), system, used
        damping = 0.0 if damping <= 1e-6 else damping * 0.1
    return Minimum(estimate, cost, solution, Outcome.EXHAUSTED, max_iterations, first), system, used
