"""What a benchmark yields: numbers with a unit, a direction that is better, and how far they may slip.

Only ratios are held against the baseline (an error over its bound, a time over that of a reference kernel on the same
machine): a number of seconds says more about the machine than about the program.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

Direction = Literal["lower", "higher", "near-one", "shown"]
RATIO = "ratio"


class Metric(BaseModel):
    """One number. tolerance: the slip against the baseline that is let pass, as a share of it.

    direction: which way is better; `near-one`: departures from 1 either way are worse; `shown`: never judged.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    key: str
    value: float
    unit: str
    direction: Direction = "shown"
    tolerance: float = Field(default=0.1, ge=0)

    def is_judged(self) -> bool:
        """Whether the gate looks at it: ratios with a direction only."""
        return self.unit == RATIO and self.direction != "shown"


class Slip(BaseModel):
    """A metric that is worse than the baseline allows."""

    model_config = ConfigDict(frozen=True)
    key: str
    text: str


def slips(measured: Iterable[Metric], baseline: Mapping[str, Metric]) -> list[Slip]:
    """What is worse than the baseline allows, and what the baseline holds but was not measured in its workload.

    A judged metric without a baseline is a slip too: it has to be blessed first, so that nothing drifts unseen.
    """
    found: list[Slip] = []
    for metric in measured:
        if not metric.is_judged():
            continue
        before = baseline.get(metric.key)
        if before is None:
            found.append(Slip(key=metric.key, text=f"{metric.key} = {metric.value:.4g} has no baseline; bless it."))
        elif _badness(metric) > _badness(before) + metric.tolerance * max(abs(before.value), 1e-12):
            found.append(
                Slip(
                    key=metric.key,
                    text=f"{metric.key} = {metric.value:.4g}, the baseline is {before.value:.4g} "
                    f"and {100 * metric.tolerance:.0f} % may be lost.",
                )
            )
    return found


def _badness(metric: Metric) -> float:
    """Larger is worse. NaN is worse than everything."""
    if math.isnan(metric.value):
        return math.inf
    match metric.direction:
        case "higher":
            return -metric.value
        case "near-one":
            return abs(metric.value - 1.0)
        case _:
            return metric.value
