"""How far the answer can be trusted: the information's covariance, what is counted beside it, and what parts disagree about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calib_core.full.assess.considered import Considered, consider
from calib_core.full.assess.disagreement import (
    Apart,
    Disagreement,
    disagreements,
    take_apart,
    together,
    unexplained_variance,
)
from calib_core.full.assess.given import Contradiction, contradictions, held_contradictions, say_contradictions
from calib_core.full.assess.observability import Knowledge, assess, named_direction
from calib_core.full.assess.settings import PARTS
from calib_core.full.joint.by_laser import ByLaser, by_laser
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.state import CALIBRATION, TIME_OFFSET
from calib_core.full.joint.undetermined import UNITS
from calib_core.full.prepare.settings import STEPS
from calib_core.full.run import Run
from calib_core.types import FloatArray

#: The code of what is said of parts that disagree by more than noise explains.
DISAGREEMENT = "solve.disagreement"
#: The ways of taking a recording apart, to a person.
_WORDS = {
    "time": "stretches of time",
    "surfaces": "places on the planes",
    "planes": "planes",
    "range": "near and far points",
    "lasers": "lasers",
}


@dataclass(frozen=True)
class Confidence:
    """knowledge: with everything counted.   considered: None where the sensors' parameters were estimated, or are none.

    apart: the parts that were compared.   contradicted: what was given beforehand and is wrong.   sensors_unexplained: (N,) what
    noise does not explain of the variances of the sensors' parameters that were estimated.
    """

    knowledge: Knowledge
    considered: Considered | None
    found: tuple[Disagreement, ...]
    apart: Apart
    contradicted: tuple[Contradiction, ...] = ()
    sensors_unexplained: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def is_torn(self) -> bool:
        """Whether stretches of time contradict each other: no error bar is wide enough then to be relied on."""
        return is_torn(self.found)


def confidence(run: Run, solved: Solved) -> Confidence:
    """Of a solved recording; says where its parts disagree.

    Raises NotPositiveDefinite.
    """
    assert solved.minimum.solution is not None
    information = solved.minimum.solution.information
    frozen = not run.settings.estimate_time_offset
    priors, problem, estimate = solved.problem.priors, solved.problem, solved.estimate
    plain = assess(information, priors, frozen_offset=frozen)
    considered = None
    added: FloatArray = np.zeros((7, 7))
    sensors = solved.nuisance.sensors
    if sensors.blocks and run.settings.intrinsics == "consider":
        considered = consider(problem, estimate, sensors.prior_std)
        added = considered.added
    stated = plain.covariance / UNITS / UNITS[:, None]
    apart = take_apart(problem, estimate, by_laser(solved), eliminated=solved.shared.kept)
    found = tuple(disagreements(apart, stated))
    beyond = together([each for each in found if each.is_beyond_noise], stated + added)
    added = added + shape_covariance(run, solved.state.shape_shift, stated + added + beyond)
    contradicted = contradictions(
        priors.rows[CALIBRATION:],
        priors.calibration_vector(estimate),
        np.sqrt(np.diag(plain.covariance)),
        np.diag(added + beyond) * UNITS**2,
    )
    wider = max((each.ratio for each in found if each.is_beyond_noise), default=1.0)
    contradicted += held_contradictions(run, solved, wider)
    say_contradictions(run, contradicted)
    if beyond.any():
        _say(run, found, beyond)
    knowledge = assess(
        information,
        priors,
        frozen_offset=frozen,
        offset_std_s=float(np.hypot(run.clocks.line.mean_std_s, run.clocks.steps_std_s)),
        added=added + beyond,
    )
    if not frozen:
        _say_steps(run, knowledge)
    unexplained = _sensors_unexplained(run, solved, found) if considered is None else np.zeros(sensors.size)
    return Confidence(knowledge, considered, found, apart, tuple(contradicted), unexplained)


def shape_covariance(run: Run, shift: FloatArray, stated: FloatArray) -> FloatArray:
    """(7, 7), scaled units, of what shapes of planes that could not be estimated along may do to the answer: one standard
    deviation is as far as it went with them. Says so where that is as much as is stated in any direction.

    shift: (7,) [rad, m, s].   stated: (7, 7), scaled units, without it.
    """
    scaled = shift / UNITS
    if scaled @ np.linalg.lstsq(stated, scaled, rcond=None)[0] >= 1.0:
        turned_deg, moved_mm = np.degrees(np.linalg.norm(shift[:3])), 1e3 * np.linalg.norm(shift[3:6])
        run.say(
            "warning",
            "planes.shape",
            "planes are off flat, and their shape could not be estimated along, as it did not come to rest; the answer went by "
            f"{turned_deg:.2g} deg and {moved_mm:.2g} mm with it, and the error bars are widened by that; choose planes that are "
            "flat and stand still, or record where there are such",
        )
    return np.outer(scaled, scaled)


def _sensors_unexplained(run: Run, solved: Solved, found: Sequence[Disagreement]) -> FloatArray:
    """(N,) of the variances of the sensors' parameters: what parts disagree about where they do, and of the clocks' rate what
    jittering stamps leave open.
    """
    if not solved.nuisance.sensors.blocks:
        return np.zeros(0)
    problem, lasers = solved.problem, solved.nuisance.lasers
    start = problem.layout(solved.estimate).nuisance().start
    told_apart = [ByLaser(problem.lidar, lasers)] if lasers else []
    own = slice(start, start + solved.nuisance.sensors.size)
    variance = np.zeros(solved.nuisance.sensors.size)
    # In a minute of sixteen lasers it takes two seconds to ask each of a hundred.
    if any(each.is_beyond_noise for each in found):
        variance = unexplained_variance(problem, solved.estimate, own, found, told_apart)
    if problem.sensors.clock_place >= 0:
        variance[problem.sensors.clock_place] += run.clocks.line.rate_std_ppm**2
    return variance


def is_torn(found: Sequence[Disagreement]) -> bool:
    """Whether stretches of time contradict each other. Walls that are not flat have their places disagree, not time."""
    return any(each.name == "time" and each.is_beyond_noise and each.ratio > PARTS.torn for each in found)


def _say_steps(run: Run, knowledge: Knowledge) -> None:
    steps_std_s = run.clocks.steps_std_s
    else_std_s = np.sqrt(max(knowledge.covariance[TIME_OFFSET, TIME_OFFSET] - steps_std_s**2, 0.0))
    if steps_std_s > STEPS.worth_saying * else_std_s:
        for step in run.clocks.steps:
            run.say("warning", "clock.coarse", step.text)


def _say(run: Run, found: tuple[Disagreement, ...], beyond: FloatArray) -> None:
    torn = ", and may be too narrow all the same: do not rely on them, and record again" if is_torn(found) else ""
    parts = ", ".join(f"{_WORDS[each.name]} {each.ratio:.1f} times" for each in found if each.is_beyond_noise)
    lasers = "lasers that read short or long, " if any(d.name == "lasers" and d.is_beyond_noise for d in found) else ""
    run.say(
        "warning",
        DISAGREEMENT,
        f"the parts of the recording disagree by more than noise explains ({parts}): surfaces that are not flat, a mount that "
        f"gives, {lasers}or a fault that nothing models; the error bars are widened, most for {named_direction(beyond)}{torn}",
    )
