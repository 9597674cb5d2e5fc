"""How far the answer can be trusted: the budget of its errors made (error_budget.py), said, and the answer's covariance of it.

The page in order: what the residuals tell, what sensors that were held add, what parts of the recording disagree about; all of it
in one budget; what was given beforehand held against that; what a person is told (budget_sentences.py); what is known by it all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calib_core.full.assess.budget_sentences import say_clocks, say_disagreement, say_shapes
from calib_core.full.assess.considered import Considered, beyond_noise, consider
from calib_core.full.assess.disagreement import (
    Apart,
    Disagreement,
    disagreements,
    is_torn,
    take_apart,
    unexplained_variance,
)
from calib_core.full.assess.error_budget import ErrorBudget, in_scaled
from calib_core.full.assess.given_values import Contradiction, contradictions, held_contradictions, say_contradictions
from calib_core.full.assess.observability import Knowledge, assess
from calib_core.full.joint.bias_walks import wanders
from calib_core.full.joint.by_laser import ByLaser, by_laser
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.prepare.nuisance import LASER_BLOCKS
from calib_core.full.run import Run
from calib_core.settings import Axis
from calib_core.types import FloatArray, IntArray


@dataclass(frozen=True)
class Confidence:
    """knowledge: with everything counted.   budget: what was counted.   considered: None where the sensors' parameters were
    estimated, or are none.

    apart: the parts that were compared.   contradicted: what was given beforehand and is wrong.   sensors_unexplained: (N,) what
    noise does not explain of the variances of the sensors' parameters that were estimated.   weak_by_sensors: axes that would
    not be weak but for what is considered.   is_torn: stretches of time contradict each other: no error bar is wide enough then
    to be relied on.
    """

    knowledge: Knowledge
    budget: ErrorBudget
    considered: Considered | None
    found: tuple[Disagreement, ...]
    apart: Apart
    contradicted: tuple[Contradiction, ...] = ()
    sensors_unexplained: FloatArray = field(default_factory=lambda: np.zeros(0))
    weak_by_sensors: tuple[Axis, ...] = ()
    is_torn: bool = False


def confidence(run: Run, solved: Solved) -> Confidence:
    """Of a solved recording; says what widens the answer, and what was given that it contradicts.

    Raises NotPositiveDefinite.
    """
    assert solved.minimum.solution is not None
    information, frozen = solved.minimum.solution.information, not run.settings.estimate_time_offset
    problem, estimate = solved.problem, solved.estimate
    plain = assess(information, problem.priors, frozen_offset=frozen)
    noise = in_scaled(plain.covariance)
    considered = _considered(run, solved)
    apart = take_apart(problem, estimate, by_laser(solved), eliminated=solved.shared.kept)
    found = tuple(disagreements(apart, noise))
    clocks_std_s = 0.0 if frozen else run.clocks.offset_std_s
    budget = ErrorBudget.of(noise, considered, solved.state.shape_shift, found, clocks_std_s)
    say_shapes(run, solved.state.shape_shift, budget.beside_shapes)
    contradicted = _contradicted(run, solved, plain, budget, found)
    say_contradictions(run, contradicted)
    torn = is_torn(found, solved.planes, wanders=wanders(run, solved.state))
    say_disagreement(run, found, budget.disagreement, is_torn=torn)

    def known(added: FloatArray) -> Knowledge:
        return assess(information, problem.priors, frozen_offset=frozen, offset_std_s=clocks_std_s, added=added)

    knowledge = known(budget.beyond_noise)
    weak_anyhow = known(budget.beyond_noise - budget.considered).weak_axes
    by_sensors = tuple(axis for axis in knowledge.weak_axes if axis not in weak_anyhow)
    if not frozen:
        say_clocks(run, knowledge)
    unexplained = (
        _sensors_unexplained(run, solved, found) if considered is None else np.zeros(solved.nuisance.sensors.size)
    )
    return Confidence(knowledge, budget, considered, found, apart, contradicted, unexplained, by_sensors, torn)


def _considered(run: Run, solved: Solved) -> Considered | None:
    """What the sensors' parameters do that were to be counted and not estimated; None where none were."""
    sensors = solved.nuisance.sensors
    if not sensors.blocks or run.settings.intrinsics != "consider":
        return None
    return consider(solved.problem, solved.estimate, sensors)


def _contradicted(
    run: Run, solved: Solved, plain: Knowledge, budget: ErrorBudget, found: Sequence[Disagreement]
) -> tuple[Contradiction, ...]:
    """What was given or held, and is wrong by more than the budget has for what the recording says. plain: of noise alone."""
    priors = solved.problem.priors
    given = contradictions(
        priors.given,
        priors.calibration_vector(solved.estimate),
        np.sqrt(np.diag(plain.covariance)),
        np.diag(budget.beyond_noise) * UNITS**2 + np.diag(budget.part("clocks").covariance),
    )
    wider = max((each.ratio for each in found if each.is_beyond_noise), default=1.0)
    return (*given, *held_contradictions(run, solved, wider))


def _sensors_unexplained(run: Run, solved: Solved, found: Sequence[Disagreement]) -> FloatArray:
    """(N,) of the variances of the sensors' parameters: what parts disagree about where they do, and of the clocks' rate what
    jittering stamps leave open.
    """
    if not solved.nuisance.sensors.blocks:
        return np.zeros(0)
    problem, lasers = solved.problem, solved.nuisance.lasers
    start = problem.layout(solved.estimate).nuisance().start
    told_apart = [ByLaser(problem.lidar, lasers)] if lasers else []
    variance = np.zeros(solved.nuisance.sensors.size)
    # In a minute of sixteen lasers it takes two seconds to ask each of a hundred.
    some = np.arange(len(variance)) if any(each.is_beyond_noise for each in found) else _claimed(solved, start)
    if len(some):
        variance[some] = unexplained_variance(problem, solved.estimate, start + some, found, told_apart)
    if problem.sensors.clock_place >= 0:
        variance[problem.sensors.clock_place] += run.clocks.line.rate_std_ppm**2
    return variance


def _claimed(solved: Solved, start: int) -> IntArray:
    """Which parameters, but for single lasers', are so far off that it would be said of the sensors: where all else agrees, parts
    may still disagree about these. Curtains made ranges long at a slant, by 3.8 sigmas of noise.
    """
    sensors = solved.nuisance.sensors
    values = solved.estimate.sensors.onto(sensors).values
    each_lasers = [np.arange(sensors.size)[sensors.places[block]] for block in LASER_BLOCKS if block in sensors.places]
    return np.setdiff1d(
        beyond_noise(solved, slice(start, start + sensors.size), values),
        np.concatenate([*each_lasers, []]).astype(np.int64),
    )
