"""What a person gave beforehand, held against what the recording says: a wrong number bends everything else until it fits.

A Gaussian prior of standard deviation p and the data's answer make one of standard deviation s. Where the two agree, that answer
is away from what was given by a zero-mean amount of variance p^2 - s^2, and the data's own by p^2 / (p^2 - s^2) times as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.assess.settings import GIVEN
from calib_core.full.joint.bounds import amount
from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.priors import PriorRow
from calib_core.full.joint.state import GRAVITY, TIME_OFFSET
from calib_core.full.joint.undetermined import NAMES
from calib_core.full.run import Run
from calib_core.solver.arrow import solve_shared
from calib_core.solver.information import covariance
from calib_core.types import FloatArray

#: The code of what is said of a prior that the recording contradicts.
CONTRADICTED = "prior.contradicted"


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Something given that the recording contradicts. what: its name.   away: from its value, of what the recording alone says,
    with its unit.   sigmas: of that distance, that of what was given and the recording's together.
    """

    what: str
    away: str
    sigmas: float

    @property
    def text(self) -> str:
        """For a person."""
        return (
            f"what was given for the {self.what} contradicts the recording, which alone would have it "
            f"{self.away} away ({self.sigmas:.0f} standard deviations): all else was bent to fit; "
            "correct it, or solve without it"
        )


def contradictions(
    rows: Sequence[PriorRow], at: FloatArray, stds: FloatArray, added: FloatArray | None = None
) -> list[Contradiction]:
    """Those of the rows that the recording contradicts. at, stds: (7,) of the answer, as the rows speak of it, SI units.

    added: (7,) variances of what the recording says, SI units, that stds know nothing of.
    """
    found = []
    for row in rows:
        left = max(1.0 - (stds[row.column] / row.std) ** 2, GIVEN.least_told)
        moved = float(at[row.column]) - row.value
        beyond = 0.0 if added is None else float(added[row.column])
        sigmas = abs(moved / left) / np.sqrt(row.std**2 / left + beyond)
        if sigmas > GIVEN.sigmas:
            away = amount(moved / left, row.column)
            found.append(Contradiction(NAMES[row.column], away, float(sigmas)))
    return found


def held_contradictions(run: Run, solved: Solved, wider: float) -> list[Contradiction]:
    """Of a time offset and a magnitude of gravity that were held fixed: those that the recording would have elsewhere.

    Let go, the problem takes one step from where it came to rest. wider: by which the parts of the recording disagree.
    """
    settings, estimate = run.settings, solved.estimate
    is_held = {"offset": not settings.estimate_time_offset, "gravity": settings.gravity.std_m_s2 == 0.0}
    if not any(is_held.values()):
        return []
    problem = replace(
        solved.problem,
        frozen=tuple(column for column in solved.problem.frozen if column != TIME_OFFSET),
        priors=replace(
            solved.problem.priors,
            gravity_m_s2=float(np.linalg.norm(estimate.gravity)),
            gravity_std_m_s2=GIVEN.loose_gravity_m_s2 if is_held["gravity"] else solved.problem.priors.gravity_std_m_s2,
        ),
    )
    information, pull = solve_shared(problem.linearise(estimate))
    known = covariance(information).matrix
    step = known @ pull
    up = estimate.gravity / np.linalg.norm(estimate.gravity)
    gravity_m_s2, gravity_std = float(up @ step[GRAVITY]), float(np.sqrt(up @ known[GRAVITY, GRAVITY] @ up))
    told = [
        (is_held["offset"], NAMES[TIME_OFFSET], step[TIME_OFFSET], np.sqrt(known[TIME_OFFSET, TIME_OFFSET]), "ms"),
        (is_held["gravity"], "magnitude of gravity", gravity_m_s2, gravity_std, "m/s\u00b2"),
    ]
    return [
        Contradiction(
            what, f"{abs(moved) * (1e3 if unit == 'ms' else 1.0):.3g} {unit}", float(abs(moved) / (wider * std))
        )
        for held, what, moved, std, unit in told
        if held and abs(moved) > GIVEN.sigmas * wider * std
    ]


def say_contradictions(run: Run, found: Sequence[Contradiction]) -> None:
    """One warning for each."""
    for each in found:
        run.say("warning", CONTRADICTED, each.text)
