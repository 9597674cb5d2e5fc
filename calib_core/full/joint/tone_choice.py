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
from calib_core.full.joint.policies import Tones
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


def _scaled(whole: FloatArray) -> FloatArray:
    """What makes the diagonal one. Of nothing at all, or less by round-off, nothing is left."""
    return np.sqrt(np.divide(1.0, whole, out=np.zeros_like(whole), where=whole > 0.0))


def _decreases(S: FloatArray, g: FloatArray, whole: FloatArray, count: int) -> list[float]:
    """By how much each of `count` tones lowers the cost, all else following. S (T, T), g (T,): what that leaves of them all.

    whole: (T,), the diagonal of S before anything followed. Along what the others make up altogether, as a tone does where no
    plane shows it, round-off is left, of either sign, and explains nothing.
    """
    scale = _scaled(whole)
    values, pulls = np.empty((count, PARAMETERS)), np.empty((count, PARAMETERS))
    for k in range(count):
        own = slice(k * PARAMETERS, (k + 1) * PARAMETERS)
        values[k], along = np.linalg.eigh(S[own, own] * scale[own, None] * scale[own])
        pulls[k] = (along.T @ (g[own] * scale[own])) ** 2
    told = above_round_off(values)
    return [
        0.5 * float((pull[told] / value[told]).sum()) for pull, value, told in zip(pulls, values, told, strict=True)
    ]


def _left_by_others(
    problem: JointProblem, toned: Estimation, count: int
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """S (T, T) and g (T,) of the last `count` tones once all else follows, and S's diagonal before; None: nothing is told."""
    try:
        S, g = solve_shared(problem.linearise(toned.estimate))
    except NotPositiveDefinite:
        return None
    first = problem.layout(toned.estimate).nuisance().start
    end = first + toned.nuisance.places[TONE].stop
    of = np.arange(end - count * PARAMETERS, end)
    others = np.setdiff1d(np.arange(len(g)), of)
    follow = S[np.ix_(of, others)] @ covariance(S[np.ix_(others, others)]).matrix
    whole = np.diag(S)[of]
    return S[np.ix_(of, of)] - follow @ S[np.ix_(others, of)], g[of] - follow @ g[others], whole


def explaining(data: JointData, problem: JointProblem, toned: Estimation, count: int, least: float) -> list[Explaining]:
    """Those of the last `count` tones of a state that lower the cost by `least` each by itself, the best first.

    toned: the problem's state with all of them among the unknowns too, at no size yet.
    """
    problem = _beside_lasers(data, problem, toned)
    left = _left_by_others(problem, toned, count)
    if left is None:
        return []
    # Nothing takes more away than there is: what seems to is round-off of what all else makes up.
    most = problem.cost(toned.estimate)
    found = [
        Explaining(*one)
        for one in zip(toned.nuisance.tones_hz[-count:], _decreases(*left, count), strict=True)
        if least < one[1] <= most
    ]
    return sorted(found, key=lambda one: -one.decrease)


def is_one_planes(data: JointData, problem: JointProblem, toned: Estimation, rules: Tones) -> bool:
    """Whether the last tone of a state is what a single plane says and all others deny: then that plane is at fault.

    A floor that was taken for two, a hand apart, has the rig heave by as much: as readings, a tone of a tenth of a hertz. An
    engine shakes the rig against all planes alike. So each is left out in turn. The tone of the size that all planes tell would
    lower the cost of the others, x their S, by x' S x / 2; what it does lower it by is g' S^-1 g / 2. Where the first is much,
    they would see it, and where the second is little beside it, they do not.
    """
    problem = _beside_lasers(data, problem, toned)
    everything = _left_by_others(problem, toned, 1)
    if everything is None:
        return False
    S, g, whole = everything
    scale = _scaled(whole)
    values, along = np.linalg.eigh(S * scale[:, None] * scale)
    told = above_round_off(values)
    size = scale * (along[:, told] @ ((along[:, told].T @ (g * scale)) / values[told]))
    for plane in range(len(toned.planes)):
        others = _left_by_others(replace(problem, bins=problem.bins.but_of(plane)), toned, 1)
        if others is None:
            continue
        seen = 0.5 * float(size @ others[0] @ size)
        if seen > rules.explains and _decreases(*others, 1)[0] < rules.agreed * seen:
            return True
    return False


def _beside_lasers(data: JointData, problem: JointProblem, toned: Estimation) -> JointProblem:
    """With a state's tones among the unknowns, and what the lasers read held."""
    problem = with_tones_beside(data, problem, toned)
    return replace(problem, frozen=(*problem.frozen, *laser_columns(toned, problem)))
