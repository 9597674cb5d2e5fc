"""What of an IMU shows only at the end of a solve: accelerometers that are apart (Kalibr's size effect), and lines that bend.

An accelerometer that sits beside the others by r feels w' x r + w x (w x r) more, some millimetres of which turn the answer by
many of its standard deviations. All of them beside where they are thought to be is the lidar's own lever arm: nothing tells that
but how far apart they are. Chips have theirs within a millimetre, so that none is allowed for that does not show. One step from
the end of a solve, with a wide prior p^2 I of the nine r, tells them: what it says of the six beside their middle is, without
that prior,

    J = V^-1 - I / p^2,     x = J^-1 V^-1 v        (v, V: the six and their covariance, J: the information of the data)

and x' J x follows a chi-square law where all six are zero. What parts of the recording disagree about looks like anything, a bent
wall like this: the square counts as many times less as they disagree more than noise allows.

An accelerometer's line bends, q a^2, by what its sheet has as nonlinearity. Unknown from the start, that takes slow tones upon
itself while the motion is rough; it is told in the same way, by the same step, with what its sheet allows for p.

So is what an IMU's own low-pass filter does beside delaying: the spread and the skew of its answer to a jolt, which matter where
the motion is not slow against the cutoff.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from calib_core.full.assess.disagreement import Disagreement
from calib_core.full.assess.settings import APART, BENDING, FILTERED, LOOK, AccelerometersApart, Bending, Filtered
from calib_core.full.joint.bias_walks import with_usual_walks
from calib_core.full.joint.estimation import Estimation, Solved
from calib_core.full.joint.round import with_bins
from calib_core.full.joint.tone_choice import laser_columns
from calib_core.full.joint.tones import bare
from calib_core.full.prepare.nuisance import LATE, LOW_PASS, QUADRATIC, SIZE_EFFECT, SKEW, SPREAD, Nuisance, priors_of
from calib_core.full.run import Run
from calib_core.intrinsics import Block
from calib_core.solver.arrow import solve_arrow
from calib_core.solver.information import covariance
from calib_core.types import FloatArray

#: (9, 6) what three places are beside their middle.
_BESIDE = np.linalg.svd(np.eye(9) - np.kron(np.full((3, 3), 1.0 / 3.0), np.eye(3)))[0][:, :6]
_RULES: dict[Block, AccelerometersApart | Bending | Filtered] = {
    SIZE_EFFECT: APART,
    QUADRATIC: BENDING,
    **dict.fromkeys(LOW_PASS, FILTERED),
}


@dataclass(frozen=True, slots=True)
class Told:
    """What the data tell of parameters that are zero as far as anybody knows, along K directions of theirs.

    at: (K,) least squares.   std: (K,) of it.
    """

    at: FloatArray
    std: FloatArray

    def chance(self, wider: float = 1.0) -> float:
        """That all are zero and yet so far off. wider: by how many times errors are larger than stated."""
        square = float(np.sum((self.at / self.std) ** 2)) / wider**2
        return float(scipy.special.gammaincc(0.5 * len(self.at), 0.5 * square))

    @property
    def size_m(self) -> float:
        """Standard deviation of places along each axis that makes these the likeliest."""
        sizes_m = np.arange(np.log(0.1 * APART.least_m), np.log(10.0 * APART.tried_m), np.log(APART.step))
        variance = np.exp(2.0 * sizes_m)[:, None] + self.std**2
        return float(np.exp(sizes_m[np.argmin(np.sum(np.log(variance) + self.at**2 / variance, axis=1))]))

    @property
    def allowed_m(self) -> float:
        """The same for places that nothing tells, their middle above all: a size that k numbers tell is itself so unsure that
        what is as large by it follows a t law, of k / (k - 2) times the variance.
        """
        size_m = self.size_m
        told = max(float(np.sum(size_m**2 / (size_m**2 + self.std**2))), APART.fewest)
        return size_m * float(np.sqrt(told / (told - 2.0)))


def with_late_blocks(run: Run, solved: Solved, found: Sequence[Disagreement]) -> Solved | None:
    """The same solve with what shows among the unknowns, to go on from; None where nothing does, or all were asked before.

    found: what parts of the recording disagree about.
    """
    asked = [block for block in LATE if _is_wanted(run, block) and block not in solved.nuisance.places]
    if not asked:
        return None
    tried: dict[Block, float] = {
        SIZE_EFFECT: APART.tried_m,
        QUADRATIC: _bend_s2_m(run),
        **dict(zip(LOW_PASS, (FILTERED.spread_s2, FILTERED.skew_s3), strict=True)),
    }
    wider = max((each.ratio for each in found if each.is_beyond_noise), default=1.0)
    if solved.nuisance.lasers and not _may_show(late_told(solved, tried, asked, lasers_follow=False), wider):
        return None
    told = late_told(solved, tried, asked)
    state = solved.state
    for block, of in told.items():
        if of is None or of.chance(wider) >= _RULES[block].chance:
            continue
        if block != SIZE_EFFECT:
            state = with_late(state, block, tried[block])
        elif APART.least_m < of.size_m < APART.most_m:
            state = with_late(state, block, of.allowed_m)
        if block == SPREAD and SKEW in asked:
            # What smears as a pole does is as lopsided, whether that shows or not, and the time offset is off by it.
            lasts_s = float(np.sqrt(np.sqrt(np.mean(of.at**2))))
            state = with_late(state, SKEW, FILTERED.skew_of_spread * lasts_s**3)
    return None if state is solved.state else replace(solved, state=_listening_anew(run, state))


def _may_show(told: Mapping[Block, Told | None], wider: float) -> bool:
    """Whether something may be beyond chance where lasers follow, told while they did not: then it explains more, as what lasers
    read and what an IMU's parts do have little in common, a little."""
    return any(of is not None and of.chance(wider * LOOK.narrower) < _RULES[block].chance for block, of in told.items())


def _listening_anew(run: Run, state: Estimation) -> Estimation:
    """Without what the biases and a calm IMU's readings were thought to do, which the new unknown may have done."""
    state = with_usual_walks(run, state)
    if run.noise.shaken:
        return state
    return replace(bare(state) if state.nuisance.tones_hz else state, untuned=False)


def still_show(solved: Solved) -> bool:
    """Whether one of them that is among the unknowns is beyond chance, with everything else that was let go along."""
    blocks = [block for block in LATE if block in solved.nuisance.places]
    if not blocks or solved.minimum.solution is None:
        return False
    start = solved.problem.layout(solved.estimate).nuisance().start
    spread = solved.minimum.solution.covariance.matrix
    for block in blocks:
        place, rule = solved.nuisance.places[block], _RULES[block]
        own, of = slice(start + place.start, start + place.stop), _directions(solved.nuisance, block)
        value, allowed = of.T @ solved.estimate.sensors.of(block), float(solved.nuisance.prior_std[place.start])
        told = told_of(value, of.T @ spread[own, own] @ of, allowed, APART.told, rule.fewest)
        if told is not None and told.chance() < rule.chance:
            return True
    return False


def _directions(nuisance: Nuisance, block: Block) -> FloatArray:
    """(N, K) along which something tells of a block: of places, how each is beside their middle."""
    place = nuisance.places[block]
    return _BESIDE if block == SIZE_EFFECT else np.eye(place.stop - place.start)


def _is_wanted(run: Run, block: Block) -> bool:
    wanted = run.settings.intrinsics
    return wanted == "auto" if isinstance(wanted, str) else block in wanted


def _bend_s2_m(run: Run) -> float:
    """What is usual of the lines of this IMU's accelerometers."""
    imu, _ = priors_of(run.recording, run.settings, run.beyond_sheets)
    return imu.accelerometer_quadratic_std_s2_m


def late_told(
    solved: Solved, stds: Mapping[Block, float], asked: Sequence[Block], *, lasers_follow: bool = True
) -> dict[Block, Told | None]:
    """By one step from the end of a solve, where each parameter of a block asked is allowed this much; None where that says too
    little.

    lasers_follow: False where the lasers' own parameters are held, of which 128 lasers have five hundred.
    """
    tried = solved.state
    for block in asked:
        tried = with_late(tried, block, stds[block])
    # The end's own points, as they were gathered when fewer were in play.
    problem, nuisance = with_bins(solved.data, tried, solved.problem.bins), tried.nuisance
    if not lasers_follow:
        problem = replace(problem, frozen=(*problem.frozen, *laser_columns(tried, problem)))
    try:
        solution = solve_arrow(problem.linearise(tried.estimate))
        free = np.setdiff1d(np.arange(len(solution.information)), problem.frozen)
        spread = covariance(solution.information[np.ix_(free, free)]).matrix
    except (ArithmeticError, np.linalg.LinAlgError):
        return {}
    start = problem.layout(tried.estimate).nuisance().start
    told: dict[Block, Told | None] = {}
    for block in asked:
        place = nuisance.places[block]
        own = np.arange(start + place.start, start + place.stop)
        at = np.searchsorted(free, own)
        of = _directions(nuisance, block)
        value, rule = of.T @ solution.step_shared[own], _RULES[block]
        if block == SPREAD and value.sum() < 0.0:  # a filter that averages smears; none that sharpens is known
            told[block] = None
            continue
        told[block] = told_of(value, of.T @ spread[np.ix_(at, at)] @ of, stds[block], rule.known, rule.fewest)
    return told


def told_of(value: FloatArray, spread: FloatArray, prior: float, known_to: float, fewest: int) -> Told | None:
    """Of what a step tells of parameters (N,), with its covariance (N, N), where each was allowed this standard deviation.

    known_to: share of that variance to which the data have to tell a direction; None where they tell fewer than asked.
    """
    variance, axes = np.linalg.eigh(spread)
    known = (variance > 0.0) & (variance < known_to * prior**2)
    if np.count_nonzero(known) < fewest:
        return None
    by_data = 1.0 / variance[known] - 1.0 / prior**2
    return Told(axes[:, known].T @ value / variance[known] / by_data, 1.0 / np.sqrt(by_data))


def with_late(state: Estimation, block: Block, std: float) -> Estimation:
    """With one of them among the unknowns, so large: of which nothing is known yet, or as it is where it was among them."""
    return state.with_nuisance(state.nuisance.with_late(block, std))
