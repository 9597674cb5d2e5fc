"""How a forecast changes with the choice of planes: the forecast's own problem with the points of the chosen ones alone.

    growth = std(some of the planes) / std(all of them)

The lasers' own parameters stay at their priors in it, which changes these ratios by a few per cent and makes a click's answer
a matter of a tenth of a second.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from calib_core.factors.laser_features import LaserFactors
from calib_core.full.assess.observability import assess
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import CALIBRATION, Estimate
from calib_core.solver.arrow import NotPositiveDefinite, solve_arrow
from calib_core.threads import one_blas_thread
from calib_core.types import FloatArray, IntArray
from calib_core.written import as_read, as_written, keep, kept

_FILE = "foresight.npz"


@dataclass(frozen=True)
class Foresight:
    """The problem of a forecast, about the estimate that it was judged at.

    proposed: how many planes were proposed.   of_proposal: (P,) which of them each plane of the problem is, -1 for one that came
    into view.   share: of the recording that the problem is of; the rest is taken to say as much a second.
    """

    problem: JointProblem
    estimate: Estimate
    proposed: int
    of_proposal: IntArray
    share: float

    def growth(self, places: Collection[int]) -> FloatArray:
        """(7,) factors, at least 1, by which the calibration's standard deviations grow where these planes alone count.

        places: of the planes among the proposals; what comes into view counts in any case. A direction that stays open grows to
        the standing prior's size; all are infinite where no point is left.
        """
        chosen = set(places) & set(range(self.proposed))
        if len(chosen) == self.proposed:
            return np.ones(CALIBRATION)
        counts = np.flatnonzero(np.isin(self.of_proposal, [-1, *chosen]))
        return np.maximum(self._stds(counts.tolist()) / self._of_all, 1.0)

    @cached_property
    def _of_all(self) -> FloatArray:
        return self._stds(range(len(self.estimate.normals)))

    def _stds(self, chosen: Collection[int]) -> FloatArray:
        """(7,) of the data alone, SI; infinite where they fix nothing."""
        bins = self.problem.bins
        some = np.isin(bins.plane, list(chosen))
        if not some.any():
            return np.full(CALIBRATION, np.inf)
        fewer = replace(
            bins, knot=bins.knot[some], plane=bins.plane[some], scatter=bins.scatter[some], count=bins.count[some]
        )
        try:
            with one_blas_thread():
                information = solve_arrow(replace(self.problem, bins=fewer).linearise(self.estimate)).information
        except NotPositiveDefinite:
            return np.full(CALIBRATION, np.inf)
        return assess(information, self.problem.priors, inflation=float(np.sqrt(self.share))).data_std


def foresight(
    problem: JointProblem, estimate: Estimate, proposed: int, of_proposal: Sequence[int], share: float
) -> Foresight:
    """Of a forecast's problem, at the estimate that it was judged about. The others: as in the record."""
    bins = replace(problem.bins, lasers=LaserFactors.empty())
    return Foresight(replace(problem, bins=bins), estimate, proposed, np.array(of_proposal, dtype=np.int64), share)


def keep_foresight(folder: Path, foresight: Foresight | None) -> None:
    """Put into the folder for `kept_foresight`, whole or not at all; what is there goes where there is none.

    Where the folder takes nothing, as on a full disk, nothing is kept: a report must not be lost for it.
    """
    path = folder / _FILE
    if foresight is not None:
        keep(path, *as_written(foresight))
        return
    with suppress(OSError):
        path.unlink(missing_ok=True)


def kept_foresight(folder: Path) -> Foresight | None:
    """What was put there; None where there is nothing, or nothing of this version."""
    found = kept(folder / _FILE)
    try:
        return None if found is None else as_read(Foresight, *found)
    except (ValueError, KeyError, TypeError):
        return None
