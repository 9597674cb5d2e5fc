"""Trust-region descent on the manifold: Levenberg-Marquardt steps on the arrow, accepted by what they gain.

The paper uses Manopt's trust region; the damping here plays the radius's part. A step is taken if the cost falls; the
damping then shrinks with the ratio of the fall to the model's promise, and grows where a step is refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from calib_core.paper.problem import PaperProblem, PaperState
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.solver.system import ArrowSystem

#: A round is over when the model promises less than this share of the cost.
_CONVERGED = 1e-9
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-12, 1e8

OnStep = Callable[[PaperState, ArrowSystem], None]


@dataclass(frozen=True)
class Descent:
    """Where a round ended. system: the normal equations there.   iterations: accepted steps."""

    state: PaperState
    system: ArrowSystem
    iterations: int
    converged: bool


def descend(problem: PaperProblem, state: PaperState, *, max_iterations: int, on_step: OnStep) -> Descent:
    """The minimum of the problem's cost from a state. on_step hears every accepted step and may raise to stop."""
    system = problem.linearised(state)
    damping = _FIRST_DAMPING
    accepted = 0
    while accepted < max_iterations and damping < _MOST_DAMPING:
        try:
            step = solve_arrow(system, damping=damping)
        except NotPositiveDefinite:
            damping *= 10.0
            continue
        promised = step.predicted_decrease
        if promised <= _CONVERGED * system.cost:
            return Descent(state, system, accepted, converged=True)
        candidate = state.moved(step.step, step.step_shared)
        gain = (system.cost - problem.cost(candidate)) / promised
        if gain > 0.0:
            state, system = candidate, problem.linearised(candidate)
            accepted += 1
            on_step(state, system)
            damping = max(damping * (0.1 if gain > 0.5 else 1.0), _LEAST_DAMPING)
        else:
            damping *= 10.0
    return Descent(state, system, accepted, converged=False)
