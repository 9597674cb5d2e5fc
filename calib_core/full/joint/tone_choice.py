"""Which of the frequencies that stand out are tones: by what each would lower the cost, all else following.

Loud is not the same. The periodogram (tones.py) has what the problem pulls at the readings where the motion, the biases and the
sensors' parameters already gave way: what a tone of one hertz has bent them by pulls loudest at half a hertz, where the hand
moves. With the columns C of a tone beside all others J in the normal equations, their Schur complement has them follow

    S = C' C - C' J (J' J)^-1 J' C,   g = -C' r (where the others are at rest),   decrease = g' S^-1 g / 2

(Rao's score test). By chance twice that is chi-square of as many degrees as a tone has amplitudes. One linearisation with
all candidates has every one's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.joint.estimation import Estimation, JointData
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state_views import with_tones_beside
from calib_core.full.prepare.nuisance import LASER_BLOCKS, TONE
from calib_core.imu.tones import PARAMETERS
from calib_core.solver.arrow import NotPositiveDefinite, solve_shared
from calib_core.solver.information import above_round_off, covariance
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Explaining:
    """A tone of hz, and by how much it would lower the cost."""

    hz: float
    decrease: float


def laser_columns(state: Estimation, problem: JointProblem) -> list[int]:
    """The shared columns of the lasers' own parameters. What one laser reads is not what an engine shakes: where none of them
    follows, a tone explains as much, and of 128 lasers an elimination is a fifth of the work."""
    first, places = problem.layout(state.estimate).nuisance().start, state.nuisance.places
    return [
        first + k for block in LASER_BLOCKS if block in places for k in range(places[block].start, places[block].stop)
    ]


def _decreases(S: FloatArray, g: FloatArray, whole: FloatArray, count: int) -> list[float]:
    """By how much each of `count` tones lowers the cost, all else following. S (T, T), g (T,): what that leaves of them all.

    whole: (T,), the diagonal of S before anything followed. Along what the others make up altogether, as a tone does where no
    plane shows it, round-off is left, of either sign, and explains nothing.
    """
    # Of nothing at all, or less by round-off, nothing is left.
    scale = np.sqrt(np.divide(1.0, whole, out=np.zeros_like(whole), where=whole > 0.0))
    values, pulls = np.empty((count, PARAMETERS)), np.empty((count, PARAMETERS))
    for k in range(count):
        own = slice(k * PARAMETERS, (k + 1) * PARAMETERS)
        values[k], along = np.linalg.eigh(S[own, own] * scale[own, None] * scale[own])
        pulls[k] = (along.T @ (g[own] * scale[own])) ** 2
    told = above_round_off(values)
    return [
        0.5 * float((pull[told] / value[told]).sum()) for pull, value, told in zip(pulls, values, told, strict=True)
    ]


def explaining(data: JointData, problem: JointProblem, toned: Estimation, count: int, least: float) -> list[Explaining]:
    """Those of the last `count` tones of a state that lower the cost by `least` each by itself, the best first.

    toned: the problem's state with all of them among the unknowns too, at no size yet.
    """
    problem = with_tones_beside(data, problem, toned)
    problem = replace(problem, frozen=(*problem.frozen, *laser_columns(toned, problem)))
    try:
        S, g = solve_shared(problem.linearise(toned.estimate))
    except NotPositiveDefinite:
        return []
    first = problem.layout(toned.estimate).nuisance().start
    end = first + toned.nuisance.places[TONE].stop
    of = np.arange(end - count * PARAMETERS, end)
    others = np.setdiff1d(np.arange(len(g)), of)
    follow = S[np.ix_(of, others)] @ covariance(S[np.ix_(others, others)]).matrix
    whole = np.diag(S)[of]
    S, g = S[np.ix_(of, of)] - follow @ S[np.ix_(others, of)], g[of] - follow @ g[others]
    decreases = _decreases(S, g, whole, count)
    # Nothing takes more away than there is: what seems to is round-off of what all else makes up.
    most = problem.cost(toned.estimate)
    found = [
        Explaining(*one)
        for one in zip(toned.nuisance.tones_hz[-count:], decreases, strict=True)
        if least < one[1] <= most
    ]
    return sorted(found, key=lambda one: -one.decrease)
