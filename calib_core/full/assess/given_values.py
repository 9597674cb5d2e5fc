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
from calib_core.full.joint.state import CALIBRATION, GRAVITY, TIME_OFFSET
from calib_core.full.joint.undetermined import NAMES, UNDETERMINED, UNITS
from calib_core.full.run import Run
from calib_core.solver.arrow import solve_shared
from calib_core.solver.information import covariance, covariance_of
from calib_core.types import FloatArray

#: The code of what is said of a prior that the recording contradicts.
CONTRADICTED = "prior.contradicted"
#: What planes that are held are called among all that is given.
PLANES = "planes"


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Something given that the recording contradicts. what: its name.   away: from its value, of what the recording alone says,
    with its unit.   sigmas: of that distance, that of what was given and the recording's together.   bends: whether the
    calibration was moved by it as much as by all its noise.
    """

    what: str
    away: str
    sigmas: float
    bends: bool = True

    @property
    def text(self) -> str:
        """For a person."""
        bent = "everything else was bent to fit it" if self.bends else "it hardly changes the calibration"
        return (
            f"what was given for the {self.what} contradicts the recording, which by itself puts it "
            f"{self.away} away ({self.sigmas:.0f} standard deviations): {bent}; correct it, or solve without it"
        )


def contradictions(
    rows: Sequence[PriorRow], at: FloatArray, stds: FloatArray, added: FloatArray | None = None
) -> list[Contradiction]:
    """Those of the rows that the recording contradicts. at, stds: (7,) of the answer, as the rows speak of it, SI units.

    added: (7,) variances of what the recording says, SI units, that stds know nothing of.
    Where the recording alone leaves a parameter open, a solve holds it where the prior had it when it was found to be open,
    and not where the last round would: that distance is nothing that the recording says.
    """
    found = []
    open_stds = UNDETERMINED * UNITS
    for row in rows:
        told = 1.0 - (stds[row.column] / row.std) ** 2
        if told <= 0.0 or stds[row.column] / np.sqrt(told) > open_stds[row.column]:
            continue
        left = max(told, GIVEN.least_told)
        moved = float(at[row.column]) - row.value
        beyond = 0.0 if added is None else float(added[row.column])
        sigmas = abs(moved / left) / np.sqrt(row.std**2 / left + beyond)
        if sigmas > GIVEN.sigmas:
            away = amount(moved / left, row.column)
            found.append(Contradiction(NAMES[row.column], away, float(sigmas)))
    return found


def held_contradictions(run: Run, solved: Solved, wider: float) -> list[Contradiction]:
    """Of a time offset, a magnitude of gravity and planes that were held fixed: those that the recording would have elsewhere.

    Let go, the problem takes one step from where it came to rest. wider: by which the parts of the recording disagree. Of what
    stamps are off by no part knows: the time offset that they tell is unsure by that, too.
    """
    settings, estimate = run.settings, solved.estimate
    holds_offset, holds_gravity = not settings.estimate_time_offset, settings.gravity.std_m_s2 == 0.0
    if not (holds_offset or holds_gravity) and settings.estimate_planes:
        return []
    layout = solved.problem.layout(estimate)
    every_plane = layout.every_plane()
    let_go = {TIME_OFFSET, *range(every_plane.start, every_plane.stop)}
    problem = replace(
        solved.problem,
        frozen=tuple(column for column in solved.problem.frozen if column not in let_go),
        priors=replace(
            solved.problem.priors,
            gravity_m_s2=float(np.linalg.norm(estimate.gravity)),
            gravity_std_m_s2=GIVEN.loose_gravity_m_s2 if holds_gravity else solved.problem.priors.gravity_std_m_s2,
        ),
        planes_hold_frame=False,
    )
    information, pull = solve_shared(problem.linearise(estimate))
    known = covariance(information).matrix
    step = known @ pull
    up = estimate.gravity / np.linalg.norm(estimate.gravity)
    gravity_m_s2, gravity_std = float(up @ step[GRAVITY]), float(np.sqrt(up @ known[GRAVITY, GRAVITY] @ up))
    offset_s = float(step[TIME_OFFSET])
    offset_std_s = float(np.hypot(np.sqrt(known[TIME_OFFSET, TIME_OFFSET]), run.clocks.offset_std_s / wider))
    told = []
    if holds_offset:
        told += [Contradiction(NAMES[TIME_OFFSET], f"{1e3 * abs(offset_s):.3g} ms", abs(offset_s) / offset_std_s)]
    if holds_gravity:
        away = f"{abs(gravity_m_s2):.3g} m/s\u00b2"
        told += [Contradiction("magnitude of gravity", away, abs(gravity_m_s2) / gravity_std)]
    if not settings.estimate_planes:
        parts = [step[layout.plane(j)] for j in range(layout.planes)]
        of_all = of_planes([plane.name for plane in solved.planes], parts, known[every_plane, every_plane], wider)
        told += [replace(of_all, bends=_bends(solved, step[:CALIBRATION]))]
    return [replace(each, sigmas=each.sigmas / wider) for each in told if each.sigmas > GIVEN.sigmas * wider]


def of_planes(names: Sequence[str], steps: Sequence[FloatArray], known: FloatArray, wider: float) -> Contradiction:
    """How far planes would go, and which most of all. steps: (3,) of each, two turns and the offset.   known: (3P, 3P).

    What planes stand wrong by among themselves other unknowns take up together: so all are asked as one, by the squares that
    letting them go saves. Those follow a chi-square law of all but the six by which planes move as one, and their place in it is
    told as that of a normal law (Wilson and Hilferty 1931). The offset is told where it is known best, amid a plane's points:
    about any other place it moves as the plane turns.
    """
    every = np.concatenate(steps)
    degrees = max(len(every) - GIVEN.frame, 1)
    ninth = 2.0 / (9.0 * degrees)
    saved = float(every @ np.linalg.solve(known, every)) / wider**2
    sigmas = max(((saved / degrees) ** (1.0 / 3.0) - 1.0 + ninth) / np.sqrt(ninth), 0.0)
    blocks = [known[k : k + 3, k : k + 3] for k in range(0, len(every), 3)]
    squares = [float(step @ np.linalg.solve(block, step)) for step, block in zip(steps, blocks, strict=True)]
    worst = int(np.argmax(squares))
    step, block = steps[worst], blocks[worst]
    shift_m = float(step[2] - np.linalg.solve(block[:2, :2], block[:2, 2]) @ step[:2])
    away = f"{1e3 * abs(shift_m):.2g} mm and {np.degrees(np.linalg.norm(step[:2])):.2g} deg"
    return Contradiction(f"{PLANES} ({names[worst]} most of all)", away, float(sigmas) * wider)


def _bends(solved: Solved, moved: FloatArray) -> bool:
    """Whether the calibration is moved (7,) by more of its standard deviations, squared, than noise moves it on average."""
    assert solved.minimum.solution is not None
    stated = covariance_of(solved.minimum.solution.information, slice(0, CALIBRATION))
    return float(moved @ np.linalg.solve(stated, moved)) > CALIBRATION


def say_contradictions(run: Run, found: Sequence[Contradiction]) -> None:
    """One sentence for each: a warning of what bent the answer."""
    for each in found:
        run.say("warning" if each.bends else "info", CONTRADICTED, each.text)
