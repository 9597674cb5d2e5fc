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

from calib_core.solver.arrow import ArrowSolution, Eliminated, NotPositiveDefinite, solve_arrow
from calib_core.solver.system import ArrowEquations

E = TypeVar("E")
#: Of a cost: what summing hundreds of thousands of squares in double precision cannot tell apart. Measured: where the cost
#: itself no longer changes, stiff equations (a tone's frequency beside the motion) go on predicting 1.2e-12 of it.
COST_ROUND_OFF = 4e-12
#: The least damping beside none, a share of each unknown's own curvature. A sensor's parameters that trade with the rotation
#: are held by a billionth of it: a larger damping leaves nothing of a step along such a valley (seen: 1e-6, a hundred steps).
_LEAST_DAMPING = 1e-9
#: The same near a minimum, where planes hardly see the way along a street: a drift of metres along it bends off, and a billionth
#: holds it to a tenth of a millimetre (seen: 17 of a cost predicted, 8.7 found by this, 0.2 by a billionth, 180 steps in all).
#: From there damping grows tenfold, then a hundredfold, then a thousandfold each time.
_LEAST_ALONG_VALLEYS, _FASTEST = 1e-14, 1e3
#: A step that finds less than this there, and is damped or finds less than half of what it predicts, creeps along what hardly
#: anything tells: by a twentieth of a sigma, if it were any. So many in a row are the last (seen: twelve steps down a street
#: that found nothing of 6e-5, thirteen in a corridor, with twenty-six eliminations, for 0.0005 of a cost).
_CREEPING, _CREEPS = 1e-3, 3
#: Steps tried at one linearisation, each ten times as damped as the one before: from none at all to a thousand times the
#: curvature.
_TRIALS = 15
#: The equations of the step before serve for one that predicts less than this: a fifth of a standard deviation long in all
#: unknowns together. So they do while each such step leaves a hundredth of what the one before had left, a tenth of its
#: length: where the motion is rough, they do not, and are made anew.
_SAME_EQUATIONS, _LEFT = 0.02, 0.01
#: A step by other equations finds what it predicts but for the part by which their curvature is another one, and leaves as
#: large a part of its length: a tenth, which a round that gives points to planes anew leaves as well.
_ALIKE = 0.1


class Problem(Protocol[E]):
    """What the loop asks of a problem."""

    def cost(self, estimate: E) -> float:
        """Half the sum of squares."""
        ...

    def linearise(self, estimate: E) -> ArrowEquations:
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
    CREEPING = "the steps that are left go along what hardly anything tells, and find next to nothing"
    SINGULAR = "the normal equations stayed singular"


@dataclass
class SharedEquations:
    """What descents hand on to one another. kept: by which undamped steps were made last, None before the first.

    Nobody else holds them, and they go before others are made: two at once would be the most memory of a solve.
    """

    kept: Eliminated | None = None


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
    relative: float = 0.0,
    on_step: Callable[[E, float, ArrowSolution], None] | None = None,
    shared: SharedEquations | None = None,
    roughly: bool = False,
    along_valleys: bool = False,
) -> Minimum[E]:
    """The least-squares estimate from a start.

    tolerance: it has converged where an undamped step would lower the cost by less than this, or than its round-off,
    relative: or than this part of what the first step would have.
    shared: small steps may be those of the equations of the one before (`_SAME_EQUATIONS`), as the first may be of the descent
    before, and the solution's information is then of there.   roughly: not only small ones, but any that finds about what it
    predicts (`_ALIKE`).
    along_valleys: a refused step is first damped by next to nothing. Near the minimum, where only what is hardly known bends;
    from afar it leads into other valleys. What creeps along one ends.
    """
    by = _Equations(shared, roughly)
    end, equations, damping = _descend(
        problem, estimate, max_iterations, (tolerance, relative), on_step, by, _Damping(along_valleys)
    )
    if damping == 0.0 or equations is None or end.solution is None:
        return end
    # The damped equations are no information: with them, what is hardly known would pass for known.
    try:
        return replace(end, solution=solve_arrow(equations))
    except NotPositiveDefinite:
        return replace(end, solution=None, outcome=Outcome.SINGULAR)


@dataclass
class _Equations:
    """The equations by which steps are made, and whether they may be those of the step before.

    shared, roughly: as `minimise` has them.   before: the decrease that the last step predicted.   nearly: the step that shared
    ones give at this linearisation, where it is one to be taken.
    """

    shared: SharedEquations | None = None
    roughly: bool = False
    before: float = np.inf
    nearly: ArrowSolution | None = None

    def begin(self, now: ArrowEquations) -> None:
        """Another linearisation."""
        self.nearly = None
        if self.shared is None or self.shared.kept is None:
            return
        if not self.shared.kept.is_of_kind(now):
            self.shared.kept = None
            return
        nearly = self.shared.kept.again(now)
        if self.roughly or nearly.predicted_decrease <= min(_SAME_EQUATIONS, _LEFT * self.before):
            self.nearly = nearly

    def is_borne_out(self, found: float) -> bool:
        """Whether a step by them has lowered the cost by about what it predicted, where it was any size."""
        if self.nearly is None or self.nearly.predicted_decrease <= _SAME_EQUATIONS:
            return True
        return abs(found - self.nearly.predicted_decrease) <= _ALIKE * self.nearly.predicted_decrease

    def solved(self, now: ArrowEquations, damping: float) -> ArrowSolution:
        """The step to try next. Raises NotPositiveDefinite."""
        if self.nearly is not None:
            return self.nearly
        if self.shared is None:
            return Eliminated.of(now, damping=damping).solution(now)
        self.shared.kept = None
        own = Eliminated.of(now, damping=damping)
        if damping == 0.0:
            self.shared.kept = own
        return own.solution(now)

    def refused(self) -> bool:
        """Whether the step that did not lower the cost was by other equations: then its own come next, as little damped."""
        shared, self.nearly = self.nearly is not None, None
        return shared


@dataclass
class _Damping:
    """How much the next step is damped. along_valleys: as `minimise` has it."""

    along_valleys: bool
    now: float = 0.0
    refusals: int = 0
    creeps: int = 0

    @property
    def least(self) -> float:
        """Beside none."""
        return _LEAST_ALONG_VALLEYS if self.along_valleys else _LEAST_DAMPING

    def refused(self) -> None:
        """A step did not lower the cost, or could not be made."""
        more = min(10.0 ** (self.refusals + 1), _FASTEST) if self.along_valleys else 10.0
        self.now, self.refusals = max(self.now * more, self.least), self.refusals + 1

    def accepted(self, found: float, predicted: float) -> Outcome | None:
        """One did, by so much. Returns whether it is the last."""
        creeps = found < _CREEPING and (self.now > 0.0 or found < 0.5 * predicted)
        self.creeps = self.creeps + 1 if creeps else 0
        self.now, self.refusals = 0.0 if self.now <= self.least else self.now * 0.1, 0
        return Outcome.CREEPING if self.along_valleys and self.creeps >= _CREEPS else None


def _descend(
    problem: Problem[E],
    estimate: E,
    max_iterations: int,
    tolerances: tuple[float, float],
    on_step: Callable[[E, float, ArrowSolution], None] | None,
    by: _Equations,
    damping: _Damping,
) -> tuple[Minimum[E], ArrowEquations | None, float]:
    """Where it ended, the last linearisation and the damping of its solution."""
    cost, used = problem.cost(estimate), 0.0
    solution: ArrowSolution | None = None
    equations: ArrowEquations | None = None
    first = np.inf
    tolerance, relative = tolerances
    for iteration in range(max_iterations):
        equations = problem.linearise(estimate)
        solution, used = None, 0.0  # an earlier linearisation's says nothing of this one
        by.begin(equations)
        accepted = negligible = False
        candidate, new_cost = estimate, cost
        for _ in range(_TRIALS):
            try:
                solution, used = by.solved(equations, damping.now), damping.now
            except NotPositiveDefinite:
                damping.refused()
                continue
            if iteration == 0 and not np.isfinite(first):
                first = solution.predicted_decrease
            least = max(tolerance, COST_ROUND_OFF * cost, relative * first if used == 0.0 else 0.0)
            negligible = solution.predicted_decrease < least
            candidate = problem.moved(estimate, solution)
            new_cost = problem.cost(candidate)
            lower = bool(np.isfinite(new_cost) and new_cost <= cost + COST_ROUND_OFF * abs(cost))
            accepted = lower and by.is_borne_out(cost - new_cost)
            if accepted or negligible:
                break
            if not by.refused():
                damping.refused()
        if solution is None:
            return Minimum(estimate, cost, None, Outcome.SINGULAR, iteration + 1, first), equations, used
        by.before, found = solution.predicted_decrease, cost - new_cost
        if accepted:
            estimate, cost = candidate, new_cost
            if on_step is not None:
                on_step(estimate, cost, solution)
        if negligible and used == 0.0:  # a damped step that is small says nothing of how far the minimum is
            outcome: Outcome | None = Outcome.CONVERGED
        else:
            outcome = damping.accepted(found, solution.predicted_decrease) if accepted else Outcome.STALLED
        if outcome is not None:
            return Minimum(estimate, cost, solution, outcome, iteration + 1, first), equations, used
    return Minimum(estimate, cost, solution, Outcome.EXHAUSTED, max_iterations, first), equations, used
