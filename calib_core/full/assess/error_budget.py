"""The error budget of the answer: everything that the seven may be off by, each part by itself, with its reason.

    part            what may be off                                         measured by            told by
    noise           what the residuals' noise leaves, with all that was     observability.py       `uncertainty` itself
                    known beforehand
    considered      parameters of the sensors that were held though they    considered.py          sensor.considered
                    are not known exactly
    shapes          bends of planes that would not come to rest: as far     joint/bent_surfaces.py       planes.shape
                    as the answer went with them
    disagreement    what parts of the recording contradict one another      disagreement.py        solve.disagreement
                    about by more than noise explains
    clocks          jitter and ticks of stamps, and clouds that a grid      full/run.py            clock.coarse
                    thinned, of which no residual knows: the offset alone

The parts are independent of one another, so that they add up. Two of them are measured against others: parts of the recording
are asked whether they disagree beyond `noise`, and what of it counts is told in units of `noise` and `considered` together
(`disagreement.together`), which leave out what is open.

What the answer states is made of the budget by `observability.assess`, not by the sum alone: what the data leave open priors
hold, and what a person gave was weighed by a solve that knew of `noise` and of nothing else. Where all is known and nothing was
given it is the sum.

Inside all is in the scaled units, 1 deg, 10 mm and 1 ms, in which these errors are of one size: eigenvectors of radians beside
metres and seconds are those of the units. Whoever asks a part from outside asks `covariance`, SI.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.full.assess.considered import Considered
from calib_core.full.assess.disagreement import Disagreement, together
from calib_core.full.joint.state import CALIBRATION, TIME_OFFSET
from calib_core.full.joint.undetermined import UNITS
from calib_core.types import FloatArray

#: The codes of what is said of planes' shapes, of parts that disagree, and of clocks.
SHAPES, DISAGREEMENT, CLOCKS = "planes.shape", "solve.disagreement", "clock.coarse"


@dataclass(frozen=True, slots=True)
class ErrorPart:
    """One thing that the answer may be off by. name: as in the table above.   scaled: (7, 7) covariance in units of 1 deg, 10 mm,
    1 ms.
    """

    name: str
    scaled: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """(7, 7), SI, in the contract's order."""
        return in_si(self.scaled)

    @property
    def is_there(self) -> bool:
        """Whether it widens anything."""
        return bool(np.any(self.scaled))


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """All of them. noise, considered, shapes, disagreement: (7, 7), scaled units, zero where there is nothing of it.

    clocks_std_s: of the time offset; zero where that was held.
    """

    noise: FloatArray
    considered: FloatArray
    shapes: FloatArray
    disagreement: FloatArray
    clocks_std_s: float

    @staticmethod
    def of(
        noise: FloatArray,
        considered: Considered | None,
        shape_shift: FloatArray,
        found: Sequence[Disagreement],
        clocks_std_s: float,
    ) -> ErrorBudget:
        """Put together. noise: (7, 7), scaled units.   shape_shift: (7,) [rad, m, s] by which the answer went with shapes: one of
        their sigmas.   found: of all ways to take a recording apart; what is within noise counts for nothing.
        """
        counted = np.zeros((CALIBRATION, CALIBRATION)) if considered is None else considered.added
        shift = shape_shift / UNITS
        beyond = together([each for each in found if each.is_beyond_noise], noise + counted)
        return ErrorBudget(noise, counted, np.outer(shift, shift), beyond, clocks_std_s)

    @property
    def beyond_noise(self) -> FloatArray:
        """(7, 7), scaled units: all that the solve knew nothing of; the clocks' share goes to the time offset alone."""
        return self.considered + self.shapes + self.disagreement

    @property
    def beside_shapes(self) -> FloatArray:
        """(7, 7), scaled units: what shapes are held against."""
        return self.noise + self.considered + self.disagreement

    @property
    def parts(self) -> tuple[ErrorPart, ...]:
        """In the order of the table above."""
        clocks = np.zeros((CALIBRATION, CALIBRATION))
        clocks[TIME_OFFSET, TIME_OFFSET] = (self.clocks_std_s / UNITS[TIME_OFFSET]) ** 2
        return (
            ErrorPart("noise", self.noise),
            ErrorPart("considered", self.considered),
            ErrorPart("shapes", self.shapes),
            ErrorPart("disagreement", self.disagreement),
            ErrorPart("clocks", clocks),
        )

    @property
    def total(self) -> FloatArray:
        """(7, 7), SI: the sum of the parts."""
        return np.asarray(sum(each.covariance for each in self.parts))

    def part(self, name: str) -> ErrorPart:
        """The one of this name."""
        return next(each for each in self.parts if each.name == name)


def in_si(scaled: FloatArray) -> FloatArray:
    """A covariance (7, 7) in units of 1 deg, 10 mm, 1 ms in rad, m and s."""
    return np.asarray(scaled * UNITS[:, None] * UNITS)


def in_scaled(covariance: FloatArray) -> FloatArray:
    """The inverse of `in_si`."""
    return np.asarray(covariance / UNITS / UNITS[:, None])
