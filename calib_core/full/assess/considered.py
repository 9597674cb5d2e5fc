"""Sensor parameters that are not estimated but counted: what their uncertainty adds to the calibration's (Schmidt).

With A the information of what is estimated and B its block with the parameters p of prior covariance P, an error dp of theirs
moves the estimate by -A^-1 B dp: the covariance grows by A^-1 B P B' A^-1, and the shift by one prior sigma is a column of it.
One step of the joint equations tells what p would have been: a score beyond chance is named although nothing is changed by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.assess.settings import WORDING
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, Estimate
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.prepare.nuisance import Nuisance
from calib_core.solver.arrow import ArrowSolution, solve_arrow
from calib_core.solver.information import covariance
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class Considered:
    """added: (7, 7) scaled units.   shift: (7, N) SI, by how much the answer is off where a parameter is one prior sigma above
    what it was taken for.   value, std: (N,) what the parameters would have been estimated to be.
    """

    added: FloatArray
    shift: FloatArray
    value: FloatArray
    std: FloatArray


def consider(problem: JointProblem, estimate: Estimate, sensors: Nuisance) -> Considered:
    """The parameters held at their priors' means, at the optimum of the rest. Raises NotPositiveDefinite."""
    start = problem.layout(estimate).nuisance().start
    own = slice(start, start + sensors.size)
    frozen = tuple(column for column in problem.frozen if not own.start <= column < own.stop)
    system = replace(problem, frozen=frozen).linearise(estimate)
    solution = solve_arrow(system)
    size = problem.layout(estimate).size
    free = np.setdiff1d(np.arange(size), [*frozen, *range(own.start, own.stop)])
    A = solution.information[np.ix_(free, free)]
    B = solution.information[free, own]
    every = np.zeros((size, sensors.size))
    every[free] = covariance(A).matrix @ B
    moved = every[:CALIBRATION]
    shift, seven = moved * sensors.prior_std, moved @ sensors.prior_root / UNITS[:, None]
    value = estimate.sensors.onto(estimate.sensors.blocks.sensors).values + solution.step_shared[own]
    return Considered(seven @ seven.T, shift, value, parameter_std(solution, own))


def beyond_noise(solved: Solved, own: slice, values: FloatArray) -> IntArray:
    """Which of the parameters in columns `own` noise alone would not put as far off as they are. values: (N,)."""
    assert solved.minimum.solution is not None
    std = parameter_std(solved.minimum.solution, own)
    return np.flatnonzero(np.abs(values) > WORDING.off_sigmas * std)


def parameter_std(solution: ArrowSolution, own: slice) -> FloatArray:
    """(N,) standard deviations of the parameters in columns `own`, everything else marginal but for what is frozen."""
    return np.asarray(np.sqrt(np.maximum(np.diag(solution.covariance.matrix)[own], 0.0)))
