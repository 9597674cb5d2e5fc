"""What is possible with sensors as they are, and what campaigns found: `python -m bench report-faults` writes faults.md."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2, norm

from bench import fault_parameters
from bench.fault_bounds import FAULT_BOUNDS, UNTOLD, FaultBoundRow, beside
from bench.fault_runs import Campaign, FaultParameter, FaultRun, read_fault_parameters, read_fault_runs
from bench.statistics import BIAS_SIGMAS, FREEDOM, bias_text, mean_errors
from bench.store import RESULTS
from bench.tables import read_rows
from calib_core.simulate.faults import FAULTS, PROFILES

_HALF_95 = float(norm.ppf(0.975))
_HEAD = (
    "recording",
    "faults",
    "solved",
    "rotation [deg]",
    "translation [mm]",
    "time offset [ms]",
    "NEES",
    "99 % interval",
    "within 95 %",
    "worst [sigmas]",
    "bias",
    "over the bound",
    "holds",
    "parameters",
    "version",
)
#: What is asked of a campaign: rms errors over their bounds, and the largest error in its own sigmas.
OVER_BOUND, SIGMAS = 1.3, 5.0
_SEVEN = ("rotation", "translation", "time offset")


@dataclass(frozen=True, slots=True)
class Summary:
    """Of one campaign. rms, stated: rotation [deg], translation [mm], time offset [ms].   nees: mean, and low and high of
    the interval that it lies in 99 times of 100.   inside: share of the seven within their 95 % intervals.
    worst: largest error in sigmas.   bias: (7,) mean error in sigmas of a mean of so many."""

    campaign: Campaign
    runs: int
    solved: int
    rms: tuple[float, float, float]
    stated: tuple[float, float, float]
    nees: tuple[float, float, float]
    inside: float
    worst: float
    bias: tuple[float, ...]


def summary(runs: Sequence[FaultRun]) -> Summary:
    """Of the runs of one campaign, of which some have an answer."""
    solved = [run for run in runs if run.is_solved]
    n = len(solved)
    errors, stds = np.array([run.errors for run in solved]), np.array([run.stds for run in solved])
    scaled = errors / stds
    low, high = chi2.ppf([0.005, 0.995], FREEDOM * n) / n
    label = ", ".join(dict.fromkeys(run.label for run in runs))
    return Summary(
        replace(runs[0].campaign, label=label),
        len(runs),
        n,
        _norms(np.mean(errors**2, axis=0)),
        _norms(np.mean(stds**2, axis=0)),
        (float(np.mean([run.nees for run in solved])), float(low), float(high)),
        float(np.mean(np.abs(scaled) <= _HALF_95)),
        float(np.abs(scaled).max()),
        mean_errors(errors.tolist(), stds.tolist()),
    )


def over_bound(found: Summary, bound: FaultBoundRow | None) -> tuple[float, float, float] | None:
    """The rms errors over the bound's, rotation, translation, time offset; None where there is no bound."""
    if bound is None:
        return None
    rotation, translation, offset = found.rms
    return rotation / bound.rotation_deg, translation / bound.translation_mm, offset / bound.offset_ms


def misses(found: Summary, over: tuple[float, float, float] | None) -> list[str]:
    """What a campaign lacks of what is asked; that of few runs by chance is not told from a fault."""
    missed = [] if found.solved == found.runs else [f"{found.runs - found.solved} without an answer"]
    mean, low, high = found.nees
    if not low <= mean <= high:
        missed.append("sigmas too wide" if mean < low else "sigmas too narrow")
    if found.worst > SIGMAS:
        missed.append(f"{found.worst:.1f} sigmas")
    missed += [
        f"{name} {ratio:.2f} of the bound"
        for name, ratio in zip(_SEVEN, over or (), strict=False)
        if ratio > OVER_BOUND
    ]
    return missed


def together(runs: Sequence[FaultRun]) -> str:
    """A line on many campaigns as one: how many answers, mean NEES with its 99 % interval, coverage, the worst of all."""
    all_of = summary(runs)
    mean, low, high = all_of.nees
    return (
        f"{all_of.solved} of {all_of.runs} runs have an answer; mean NEES {mean:.2f} (99 % interval of honest ones {low:.2f} to "
        f"{high:.2f}); 95 % intervals cover {100 * all_of.inside:.1f} %; the worst error of all is {all_of.worst:.1f} sigmas."
    )


def _norms(variances: np.ndarray) -> tuple[float, float, float]:
    return (
        float(np.degrees(np.sqrt(variances[:3].sum()))),
        float(1e3 * np.sqrt(variances[3:6].sum())),
        float(1e3 * np.sqrt(variances[6])),
    )


def parameters_text(parameters: Sequence[FaultParameter]) -> str:
    """Per block the root mean square error over the stated sigma, and the part of the prior that is left."""
    blocks: dict[str, list[FaultParameter]] = {}
    for each in parameters:
        if each.state == "estimated":
            blocks.setdefault(each.block, []).append(each)
    parts = []
    for block, some in blocks.items():
        ratio = np.sqrt(np.mean([((each.value - each.truth) / each.std) ** 2 for each in some]))
        left = np.median([each.std / each.prior_std for each in some])
        parts.append(f"{block} {ratio:.2f} ({left:.2f})")
    return ", ".join(parts)


def latest(runs: Sequence[FaultRun]) -> dict[Campaign, list[FaultRun]]:
    """The last run of each seed of each recording's campaign, whose label then has every version that they are of."""
    groups: dict[tuple[str, str, float, str], dict[int, FaultRun]] = {}
    for run in runs:
        groups.setdefault((run.scenario, run.faults, run.duration_s, run.settings), {})[run.seed] = run
    found: dict[Campaign, list[FaultRun]] = {}
    for key, of_seeds in groups.items():
        some = [of_seeds[seed] for seed in sorted(of_seeds)]
        found[Campaign(*key, ", ".join(dict.fromkeys(run.label for run in some)))] = some
    return found


def write_report(folder: Path = RESULTS) -> Path:
    """Write faults.md: the bounds, and the campaigns with each seed as it was run last, one a row."""
    groups = latest(read_fault_runs(folder))
    parameters: dict[tuple[Campaign, int], list[FaultParameter]] = defaultdict(list)
    for each in read_fault_parameters(folder):
        of = Campaign(each.scenario, each.faults, each.duration_s, each.settings, each.label)
        parameters[of, each.seed].append(each)
    bounds = {
        (row.scenario, row.duration_s, row.faults): row for row in read_rows(folder / FAULT_BOUNDS, FaultBoundRow, ())
    }
    lines = [
        "# Sensors as they are",
        "",
        "Written by `python -m bench report-faults` from `fault_bounds.csv`, `fault_runs.csv` and `fault_parameters.csv`.",
        *_bounds_section(list(bounds.values())),
        "",
        "## Campaigns",
        "",
        "Each cell: rms error (what the stated sigmas let one expect; the bound for a recording of that length and somebody who",
        "is told of no sensor, to whom the faults of cheap ones are unknowns, with what the fault takes away of readings, points",
        "and stamps; of the faults that there are, where sensors are named). Bias: the",
        f"largest of the seven mean errors in its own sigmas; beyond {BIAS_SIGMAS:.1f} it is one. Parameters: rms error over",
        "stated sigma by block (part of the prior's sigma that is left). Holds: every run has an answer, mean NEES is within its",
        f"interval, no error is beyond {SIGMAS:g} sigmas, rms errors are at most {OVER_BOUND:g} of their bounds.",
        "Where no sensor is named, the priors allow for cheap ones: errors of good ones, as of `industrial`, are then smaller",
        "than stated, and their NEES below that of truths drawn from the priors.",
        "",
        *(_pooled(groups) if groups else []),
        "",
        *(
            ["| " + " | ".join(_HEAD) + " |", "| --- | --- |" + " ---: |" * 8 + " --- | ---: | --- | --- | --- |"]
            if groups
            else ["Not run yet."]
        ),
    ]
    found: list[tuple[Campaign, list[FaultParameter]]] = []
    for campaign, some in groups.items():
        if not any(run.is_solved for run in some):
            lines.append(f"| {campaign.scenario} | {campaign.faults} | 0 of {len(some)} |" + " |" * (len(_HEAD) - 3))
            continue
        mine = [each for run in some for each in parameters.get((run.campaign, run.seed), ())]
        found.append((campaign, mine))
        where = campaign.scenario, campaign.duration_s
        untold = bounds.get((*where, beside(campaign.faults)), bounds.get((*where, f"consumer{UNTOLD}")))
        bound = bounds.get((*where, campaign.faults)) if campaign.settings else untold
        lines.append(_row(summary(some), bound, parameters_text(mine)))
    lines += fault_parameters.section(found)
    path = folder / "faults.md"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def _pooled(groups: Mapping[Campaign, Sequence[FaultRun]]) -> list[str]:
    """Of both profiles, and of all campaigns with faults of one kind drawn from their priors, as one each."""
    pools: dict[str, list[FaultRun]] = {"Both profiles": [], "Single faults": []}
    for campaign, runs in groups.items():
        if campaign.faults in PROFILES:
            pools["Both profiles"] += runs
        elif campaign.faults in FAULTS:
            pools["Single faults"] += runs
    return [
        line
        for name, runs in pools.items()
        if any(r.is_solved for r in runs)
        for line in (f"{name}: {together(runs)}", "")
    ]


def _bounds_section(rows: Sequence[FaultBoundRow]) -> list[str]:
    """What is possible."""
    head = "| recording | faults | as unknowns | rotation, gyroscope's axes | ignored | of the prior's sigma is left |"
    return [
        "",
        "## What is possible",
        "",
        "Root traces of the Cramér-Rao bound, rotation [deg] / translation [mm] / time offset [ms]: with the faults as unknowns",
        "with priors of their size, and the root mean square error of the efficient estimator for ideal sensors that ignores",
        "them. The IMU's frame is that of the accelerometer's axes: where these are uncertain, so is the rotation; the",
        "rotation into the gyroscope's mean axes, which the lidar sees turn, has a column of its own.",
        "",
        head,
        "| --- | --- | ---: | ---: | ---: | --- |",
        *(
            f"| {row.scenario}, {row.duration_s:g} s | {row.faults} | {row.rotation_deg:.4f} / {row.translation_mm:.2f} / "
            f"{row.offset_ms:.4f} | "
            f"{row.gyroscope_rotation_deg:.4f} | "
            f"{row.ignoring_rotation_deg:.3f} / {row.ignoring_translation_mm:.1f} / {row.ignoring_offset_ms:.3f} | {row.left} |"
            for row in rows
        ),
    ]


def _row(found: Summary, bound: FaultBoundRow | None, parameters: str) -> str:
    limits = (None,) * 3 if bound is None else (bound.rotation_deg, bound.translation_mm, bound.offset_ms)
    cells = [
        f"{value:.4g} ({stated:.4g}" + (")" if limit is None else f"; {limit:.4g})")
        for value, stated, limit in zip(found.rms, found.stated, limits, strict=True)
    ]
    of, over = found.campaign, over_bound(found, bound)
    settings = f" ({of.settings})" if of.settings else ""
    return (
        "| "
        + " | ".join(
            [
                f"{of.scenario}, {of.duration_s:g} s{settings}",
                of.faults,
                f"{found.solved} of {found.runs}",
                *cells,
                f"{found.nees[0]:.2f}",
                f"{found.nees[1]:.2f} to {found.nees[2]:.2f}",
                f"{100 * found.inside:.1f} %",
                f"{found.worst:.1f}",
                bias_text(found.bias),
                "" if over is None else " / ".join(f"{ratio:.2f}" for ratio in over),
                "; ".join(misses(found, over)) or "yes",
                parameters,
                of.label,
            ]
        )
        + " |"
    )
