"""Whether parts of a recording answer as far from one another as noise has it: the sentence of the report and of the page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from calib_core.result import OwnAnswer

#: Of readings that noise alone tells apart, so many lie within one standard deviation.
WITHIN_ONE_SIGMA = 0.6827
#: Fewer than what chance alone leaves in all but one recording of so many are too few.
ONE_IN = 100
#: What noise leaves in one recording of six, beyond one standard deviation of the count, is seldom.
SELDOM = 0.16
#: What is said of too few.
TOO_FEW = "fewer than noise explains"
#: Ways of taking a recording apart, as its document calls them where they contradict each other.
STRETCHES, PLANES, RANGES = "stretches of time", "planes", "near and far points"


def zero_crossings_told(parts: Sequence[OwnAnswer], *, torn: bool = False) -> str:
    """How many of the bars of one standard deviation hold zero, and whether noise explains so few.

    torn: whether these parts are known to contradict each other, as few that lie far off make them, however many hold zero.
    """
    crossing, bars = crossing_zero(parts)
    chance = as_chance_has(crossing, bars)
    if torn and chance != TOO_FEW:
        chance = "but some of the others lie farther off than noise explains"
    return f"{crossing} of {bars} bars do, {chance}"


def as_chance_has(crossing: int, bars: int) -> str:
    """Whether so few bars crossing zero are what noise explains, by the binomial law."""
    p = WITHIN_ONE_SIGMA
    so_few = sum(math.comb(bars, k) * p**k * (1.0 - p) ** (bars - k) for k in range(crossing + 1))
    if so_few < 1.0 / ONE_IN:
        return TOO_FEW
    return "as expected from noise" if so_few > SELDOM else "few, but noise alone may cause that"


def crossing_zero(parts: Sequence[OwnAnswer]) -> tuple[int, int]:
    """How many of the bars of one standard deviation hold zero, and how many there are."""
    within = [
        abs(shift) <= std
        for part in parts
        for shift, std in zip(
            [*part.rotation_shift_deg, *part.translation_shift_m, part.time_offset_shift_s],
            [*part.rotation_std_deg, *part.translation_std_m, part.time_offset_std_s],
            strict=True,
        )
    ]
    return sum(within), len(within)
