"""Whether the IMU's accelerometers are in one place, and how far apart where they are not: what Kalibr calls its size effect.

An accelerometer that sits beside the others by r feels w' x r + w x (w x r) more, some millimetres of which turn the answer by
many of its standard deviations. All of them beside where they are thought to be is the lidar's own lever arm: nothing tells that
but how far apart they are. Chips have theirs within a millimetre, so that none is allowed for that does not show. One step from
the end of a solve, with a wide prior p^2 I of the nine r, tells them: what it says of the six beside their middle is, without
that prior,

    J = V^-1 - I / p^2,     x = J^-1 V^-1 v        (v, V: the six and their covariance, J: the information of the data)

and x' J x follows a chi-square law where all six are zero. What parts of the recording disagree about looks like anything, a bent
wall like this: the square counts as many times less as they disagree more than noise allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from calib_core.full.assess.disagreement import Disagreement
from calib_core.full.assess.settings import APART
from calib_core.full.joint.estimation import Estimation, Solved
from calib_core.full.joint.present import problem_of
from calib_core.full.prepare.nuisance import SIZE_EFFECT
from calib_core.full.run import Run
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.solver.information import covariance
from calib_core.types import FloatArray

#: (9, 6) what three places are beside their middle.
_BESIDE = np.linalg.svd(np.eye(9) - np.kron(np.full((3, 3), 1.0 / 3.0), np.eye(3)))[0][:, :6]


@dataclass(frozen=True, slots=True)
class Places:
    """What is known of where accelerometers are beside their middle, along K directions of the six.

    at_m: (K,) least squares.   std_m: (K,) of it.
    """

    at_m: FloatArray
    std_m: FloatArray

    def chance(self, wider: float = 1.0) -> float:
        """That all are zero and yet so far off. wider: by how many times errors are larger than stated."""
        square = float(np.sum((self.at_m / self.std_m) ** 2)) / wider**2
        return float(scipy.special.gammaincc(0.5 * len(self.at_m), 0.5 * square))

    @property
    def size_m(self) -> float:
        """Standard deviation of the places along each axis that makes these the likeliest."""
        sizes_m = np.arange(np.log(0.1 * APART.least_m), np.log(10.0 * APART.tried_m), np.log(APART.step))
        variance = np.exp(2.0 * sizes_m)[:, None] + self.std_m**2
        return float(np.exp(sizes_m[np.argmin(np.sum(np.log(variance) + self.at_m**2 / variance, axis=1))]))


def with_accelerometers_apart(run: Run, solved: Solved, found: Sequence[Disagreement]) -> Solved | None:
    """The same solve with each accelerometer's place among the unknowns, to go on from; None where they are in one place, as far
    as can be told, or were asked for before. found: what parts of the recording disagree about."""
    wanted = run.settings.intrinsics
    asked = wanted == "auto" if isinstance(wanted, str) else SIZE_EFFECT in wanted
    if not asked or SIZE_EFFECT in solved.nuisance.places:
        return None
    places = places_told(solved)
    wider = max((each.ratio for each in found if each.is_beyond_noise), default=1.0)
    if places is None or places.chance(wider) > APART.chance or places.size_m < APART.least_m:
        return None
    return replace(solved, state=with_size_effect(solved.state, places.size_m))


def places_told(solved: Solved) -> Places | None:
    """By one step from the end of a solve; None where that says too little."""
    tried = with_size_effect(solved.state, APART.tried_m)
    place, bins = tried.nuisance.places[SIZE_EFFECT], solved.problem.bins
    laid_out = (
        np.insert(bins.nuisance, place.start, np.zeros(9)) if len(bins.nuisance) else np.zeros(tried.nuisance.size)
    )
    problem = replace(problem_of(solved.data, tried), bins=replace(bins, nuisance=laid_out))
    try:
        solution = solve_arrow(problem.linearise(tried.estimate))
    except NotPositiveDefinite:
        return None
    start = problem.layout(tried.estimate).nuisance().start
    own = slice(start + place.start, start + place.stop)
    return places_of(solution.step_shared[own], covariance(solution.information).matrix[own, own], APART.tried_m)


def places_of(value_m: FloatArray, spread_m2: FloatArray, prior_m: float) -> Places | None:
    """Of what was told of the nine, (9,), with its covariance (9, 9), where each was allowed this standard deviation."""
    variance, axes = np.linalg.eigh(_BESIDE.T @ spread_m2 @ _BESIDE)
    known = (variance > 0.0) & (variance < APART.known * prior_m**2)
    if np.count_nonzero(known) < APART.fewest:
        return None
    by_data = 1.0 / variance[known] - 1.0 / prior_m**2
    told_m = axes[:, known].T @ _BESIDE.T @ value_m
    return Places(told_m / variance[known] / by_data, 1.0 / np.sqrt(by_data))


def with_size_effect(state: Estimation, std_m: float) -> Estimation:
    """With the nine among the unknowns, of which nothing is known yet."""
    nuisance = state.nuisance.with_size_effect(std_m)
    place = nuisance.places[SIZE_EFFECT]
    values = np.insert(state.estimate.nuisance, place.start, np.zeros(place.stop - place.start))
    return state.with_nuisance(nuisance, values)
