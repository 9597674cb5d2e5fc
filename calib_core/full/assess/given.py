"""What a person gave beforehand, held against what the recording says: a wrong number bends everything else until it fits.

A Gaussian prior of standard deviation p and the data's answer make one of standard deviation s. Where the two agree, that answer
is away from what was given by a zero-mean amount of variance p^2 - s^2, and the data's own by p^2 / (p^2 - s^2) times as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.settings import GIVEN
from calib_core.full.joint.bounds import amount
from calib_core.full.joint.priors import PriorRow
from calib_core.full.joint.undetermined import NAMES
from calib_core.full.run import Run
from calib_core.types import FloatArray

#: The code of what is said of a prior that the recording contradicts.
CONTRADICTED = "prior.contradicted"


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A prior that the recording contradicts. away: from its value, of what the recording alone says, in SI units.

    sigmas: of that distance, the prior's and the recording's together.
    """

    row: PriorRow
    away: float
    sigmas: float

    @property
    def text(self) -> str:
        """For a person."""
        return (
            f"what was given for the {NAMES[self.row.column]} contradicts the recording, which alone would have it "
            f"{amount(self.away, self.row.column)} away ({self.sigmas:.0f} standard deviations): all else was bent to fit; "
            "correct it, or solve without it"
        )


def contradictions(rows: Sequence[PriorRow], at: FloatArray, stds: FloatArray) -> list[Contradiction]:
    """Those of the rows that the recording contradicts. at, stds: (7,) of the answer, as the rows speak of it, SI units."""
    found = []
    for row in rows:
        left = max(1.0 - (stds[row.column] / row.std) ** 2, GIVEN.least_told)
        moved = float(at[row.column]) - row.value
        sigmas = abs(moved) / (row.std * np.sqrt(left))
        if sigmas > GIVEN.sigmas:
            found.append(Contradiction(row, moved / left, float(sigmas)))
    return found


def say_contradictions(run: Run, found: Sequence[Contradiction]) -> None:
    """One warning for each."""
    for each in found:
        run.say("warning", CONTRADICTED, each.text)
