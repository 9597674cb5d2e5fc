"""What a benchmark yields: numbers with a unit, a direction that is better, how far they may slip, and what is asked of them.

Only ratios are held against the baseline (an error over its bound, a time over that of a reference kernel or of a pass over
the recording on the same machine), and the memory of a process where there is an aim for it: a number of seconds says more
about the machine than about the program.

How far a ratio may slip is what the same program's varies by on a machine with other work. In bench/results/monte_carlo.csv
are 397 runs of one version, in seven scenarios: by CPU the cheapest of two is above the cheapest of the two before by 6 to
15 % once in twenty (scenario by scenario), a single run by 7 to 25 %, and by the clock the quickest of three by 40 to 150 %.
So what is to be held narrowly is CPU over CPU; ratios by the clock are for machines that do nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

Direction = Literal["lower", "higher", "near-one", "shown"]
RATIO, PASSES, MEMORY = "ratio", "passes", "MB"
#: Of CPU over CPU, the cheapest of at least two turns; of single runs; and by the clock, turns between passes of the same run:
#: half a day apart passes.json had the whole 20 % higher and a stage 28 %.
CPU_SLACK, SINGLE_SLACK, CLOCK_SLACK, STAGE_SLACK = 0.15, 0.25, 0.35, 0.5
#: Of the most memory, which depends on what threads hold at once: a minute's was 589 MB in growth.md and 714 in growth.json,
#: a quarter of an hour apart.
MEMORY_SLACK = 0.25


class Metric(BaseModel):
    """One number. tolerance: the slip against the baseline that is let pass, as a share of it.   least: what is let pass anyway,
    in the metric's unit.   aim: what is asked, in its unit.   is_bound: worse than the aim is a slip, whatever the baseline.

    direction: which way is better; `near-one`: departures from 1 either way are worse; `shown`: never judged.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    key: str
    value: float
    unit: str
    direction: Direction = "shown"
    tolerance: float = Field(default=0.1, ge=0)
    least: float = Field(default=0.0, ge=0)
    aim: float | None = None
    is_bound: bool = False

    def is_judged(self) -> bool:
        """Whether the gate looks at it: what any machine agrees on, with a direction only."""
        return self.direction != "shown" and (self.unit in {RATIO, PASSES} or self.aim is not None)

    def is_over(self) -> bool:
        """Whether it is worse than what is asked. NaN is."""
        return self.aim is not None and _badness(self) > _badness(self.model_copy(update={"value": self.aim}))

    def told(self, before: Metric | None = None) -> str:
        """`16.2 passes; aim 10, baseline 32.6`.   before: of the baseline, where it has one."""
        held = [] if self.aim is None else [f"aim {self.aim:g}"]
        held += [] if before is None else [f"baseline {before.value:.3g}"]
        return f"{self.value:.4g} {self.unit}".rstrip() + (f"; {', '.join(held)}" if held else "")


class Slip(BaseModel):
    """A metric that is worse than the baseline allows."""

    model_config = ConfigDict(frozen=True)
    key: str
    text: str


def workload_of(key: str) -> str:
    """What a metric was measured in."""
    return key.partition(".")[0]


def slips(measured: Iterable[Metric], baseline: Mapping[str, Metric], ran: Collection[str] | None = None) -> list[Slip]:
    """What is worse than the baseline allows, and what the baseline holds but was not measured in its workload.

    A judged metric without a baseline is a slip too: it has to be blessed first, so that nothing drifts unseen.
    ran: workloads that were to be measured; all of the baseline's where that is not told.
    """
    judged = {metric.key: metric for metric in measured if metric.is_judged()}
    found = [Slip(key=key, text=text) for key, metric in judged.items() if (text := _slip(metric, baseline.get(key)))]
    held = [key for key, before in baseline.items() if before.is_judged() and (ran is None or workload_of(key) in ran)]
    return found + [
        Slip(
            key=key,
            text=f"{key} was not measured, the baseline is {baseline[key].value:.4g}; bless {workload_of(key)} where it "
            "is to go.",
        )
        for key in held
        if key not in judged
    ]


def _slip(metric: Metric, before: Metric | None) -> str:
    """What is wrong with a judged metric, in a sentence; empty where nothing is."""
    if metric.is_bound and metric.is_over():
        return f"{metric.key} = {metric.told(before)}; the aim is a limit."
    if before is None:
        return f"{metric.key} = {metric.value:.4g} has no baseline; bless it."
    lost = max(metric.tolerance * abs(before.value), metric.least, 1e-12)
    if _badness(metric) > _badness(before) + lost:
        return f"{metric.key} = {metric.value:.4g}, the baseline is {before.value:.4g} and {lost:.3g} may be lost."
    return ""


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
