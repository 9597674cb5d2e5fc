"""Whether each parameter of a sensor was found within its stated sigma: its squares over a campaign's runs against their law.

Over n independent runs the sum of ((found - true) / sigma)^2 is chi-square with n degrees of freedom, if sigma is right. The runs
are independent, the parameters of one run are not (what all lasers share is in each of them): each is judged by itself, and a
block of m by two orders of their chances, m p_(1) for one that is off and m / k p_(k) with k = m / 2 for many that are a little:
each is a chance whatever the parameters share (Rueger 1978), and twice the lesser is one of both.

Where mostly a prior holds a parameter, the law asks for truths drawn from that prior. Most campaigns draw from a narrower one, or
nothing at all, as whoever is told of no sensor has to expect more than there is: such a parameter is "too wide", which is said
apart from "too narrow".
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2

from bench.fault_runs import Campaign, FaultParameter

Verdict = Literal["holds", "too narrow", "too wide"]
#: Of blocks whose sigmas are right, one in a hundred fails.
LEVEL = 0.01
#: Profiles of a whole rig, whose blocks are listed one by one; of the others only what fails.
PROFILES = ("industrial", "consumer")


@dataclass(frozen=True, slots=True)
class ParameterFit:
    """One parameter over a campaign's runs. nees: mean square of its error in stated sigmas.   chance: of being as far off 1."""

    name: str
    runs: int
    nees: float
    chance: float


@dataclass(frozen=True, slots=True)
class BlockFit:
    """The parameters of one block. left: of the prior's sigma, the middle one."""

    block: str
    parameters: tuple[ParameterFit, ...]
    left: float

    @property
    def nees(self) -> float:
        """Mean over all."""
        return float(np.mean([each.nees for each in self.parameters]))

    @property
    def within(self) -> int:
        """How many lie within the 99 % interval of their own law."""
        return sum(each.chance >= LEVEL for each in self.parameters)

    @property
    def worst(self) -> ParameterFit:
        """The least likely."""
        return min(self.parameters, key=lambda each: each.chance)

    @property
    def chance(self) -> float:
        """Of one that is as far off, or many that are, where all sigmas are right: at the most that."""
        ordered = sorted(each.chance for each in self.parameters)
        m, half = len(ordered), (len(ordered) + 1) // 2
        if m == 1:
            return ordered[0]
        return min(1.0, 2.0 * min(m * ordered[0], m / half * ordered[half - 1]))

    @property
    def verdict(self) -> Verdict:
        """Which way it fails, if it does."""
        if self.chance >= LEVEL:
            return "holds"
        return "too narrow" if self.worst.nees > 1.0 else "too wide"


def fit_of(parameters: Sequence[FaultParameter]) -> ParameterFit:
    """Of one parameter, a run each."""
    squares = np.array([((each.value - each.truth) / each.std) ** 2 for each in parameters])
    total, n = float(squares.sum()), len(squares)
    chance = min(1.0, 2.0 * float(min(chi2.sf(total, n), chi2.cdf(total, n))))
    return ParameterFit(parameters[0].name, n, total / n, chance)


def blocks_of(parameters: Sequence[FaultParameter]) -> list[BlockFit]:
    """Those of one campaign that were estimated."""
    by: dict[str, dict[str, list[FaultParameter]]] = defaultdict(lambda: defaultdict(list))
    for each in parameters:
        if each.state == "estimated":
            by[each.block][each.name].append(each)
    return [
        BlockFit(
            block,
            tuple(fit_of(some) for some in names.values()),
            float(np.median([each.std / each.prior_std for some in names.values() for each in some])),
        )
        for block, names in by.items()
    ]


def section(found: Sequence[tuple[Campaign, Sequence[FaultParameter]]]) -> list[str]:
    """Of all campaigns, as lines of faults.md."""
    fits = [(campaign, blocks_of(parameters)) for campaign, parameters in found]
    fits = [(campaign, blocks) for campaign, blocks in fits if blocks]
    if not fits:
        return []
    return [
        "",
        "## Each parameter of the sensors",
        "",
        "NEES of one parameter: the mean square of its error in stated sigmas, over the runs; 1 where the sigma is right, and",
        "n times it is chi-square with n degrees of freedom. Within: parameters in the 99 % interval of that law. A block fails",
        "where one of its parameters is too far from it for so many, or half of them are: by chance, one block in a hundred at",
        "the most. Too narrow: its error bars do not hold. Too wide: they do, and say less than they could; so do those that",
        "mostly a prior makes, of a parameter or of what all of a block share, where a solve is told of no sensor and expects",
        "more than there is.",
        *_profiles(fits),
        *_others(fits),
    ]


def _profiles(fits: Sequence[tuple[Campaign, Sequence[BlockFit]]]) -> list[str]:
    rows = []
    for campaign, blocks in fits:
        if campaign.faults not in PROFILES:
            continue
        for each in blocks:
            nees = [one.nees for one in each.parameters]
            cells = [
                _where(campaign),
                campaign.faults,
                each.block,
                f"{each.worst.runs}",
                f"{each.nees:.2f}" + (f" ({min(nees):.2f} to {max(nees):.2f})" if len(nees) > 1 else ""),
                f"{each.within} of {len(nees)}",
                f"{each.left:.2f}",
                _verdict(each),
            ]
            rows.append("| " + " | ".join(cells) + " |")
    head = "| recording | profile | block | runs | NEES (parameter by parameter) | within | of the prior is left | verdict |"
    return ["", head, "| --- | --- | --- | ---: | --- | ---: | ---: | --- |", *rows] if rows else []


def _others(fits: Sequence[tuple[Campaign, Sequence[BlockFit]]]) -> list[str]:
    rows = []
    for campaign, blocks in fits:
        if campaign.faults in PROFILES:
            continue
        cells = [
            _where(campaign),
            campaign.faults,
            f"{max(each.worst.runs for each in blocks)}",
            f"{sum(each.verdict == 'holds' for each in blocks)} of {len(blocks)}",
            *(_failing(blocks, verdict) for verdict in ("too narrow", "too wide")),
        ]
        rows.append("| " + " | ".join(cells) + " |")
    head = "| recording | faults | runs | blocks that hold | too narrow (NEES of the worst) | too wide |"
    return ["", head, "| --- | --- | ---: | ---: | --- | --- |", *rows] if rows else []


def _where(campaign: Campaign) -> str:
    settings = f" ({campaign.settings})" if campaign.settings else ""
    return f"{campaign.scenario}, {campaign.duration_s:g} s{settings}"


def _verdict(fit: BlockFit) -> str:
    if fit.verdict == "holds":
        return "holds"
    return f"**{fit.verdict}**" if fit.verdict == "too narrow" else fit.verdict


def _failing(blocks: Sequence[BlockFit], verdict: Verdict) -> str:
    return ", ".join(
        f"**{each.block}** ({each.worst.nees:.1f})" if verdict == "too narrow" else each.block
        for each in blocks
        if each.verdict == verdict
    )
