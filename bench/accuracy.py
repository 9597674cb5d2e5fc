"""accuracy.md and its plots from the committed runs, bounds and starts: `python -m bench report`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from bench import draw
from bench.accuracy_plots import plot_nees, plot_scaled_errors
from bench.bounds import BoundRow, read_bounds
from bench.campaign import INDEPENDENT, MONTE_CARLO, read_runs
from bench.figures import ASKED, RUNS, START_COST, START_SIGMAS, STARTS_ASKED, TWIN_AT_MOST, TWINS, Asked
from bench.runs import PARAMETERS, Run
from bench.starts import STARTS, StartRun, read_starts
from bench.statistics import (
    BIAS_SIGMAS,
    Accuracy,
    accuracy,
    bound_accuracy,
    consistency,
    paired,
    seeds_text,
    stated,
    those_solved,
)
from bench.store import RESULTS

L = TypeVar("L", Run, StartRun)


def write_report(folder: Path = RESULTS, label: str | None = None) -> Path:
    """Write accuracy.md. label: of the version to show; None: each scenario's latest."""
    runs = by_scenario(read_runs(folder), label)
    bounds = read_bounds(folder)
    lines = [
        "# Accuracy, consistency, robustness",
        "",
        f"Written by `python -m bench report` from `{MONTE_CARLO}`, `bounds.csv`, `{draw.DRAWS}` and",
        f"`{STARTS}`, where every run has its row.",
        "Errors are root mean squares over the runs of the norms of eq. (15). The bound is the Cramér-Rao bound of that",
        "block (`bench/bound`): all returns from planes; planes, gravity and biases unknown, gravity's magnitude with the prior",
        "9.807 +- 0.02 m/s2 that the estimator has by default. Efficiency is rms / bound.",
        *_accuracy_section(runs, bounds),
        *draw.section({name: some for name, some in runs.items() if not _has_own_noise(some)}, draw.read_draws(folder)),
        *_consistency_section(runs),
        *_twin_section(runs),
        *_starts_section([start for start in read_starts(folder) if label in (None, start.label)]),
        *_failures_section(runs),
        *_seeds_section(runs),
        "",
    ]
    shown = {name: some for name, some in runs.items() if len([r for r in some if r.is_solved]) > 1 and _is_noisy(some)}
    if shown:
        plot_nees(shown, folder / "accuracy_nees.png")
        plot_scaled_errors(shown, folder / "accuracy_errors.png")
        lines += ["![NEES against its law](accuracy_nees.png)", "", "![Errors over sigma](accuracy_errors.png)", ""]
    path = folder / "accuracy.md"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def by_scenario(runs: Iterable[Run], label: str | None = None) -> dict[str, list[Run]]:
    """The runs of every scenario in the order of the seeds: of one version, or of each scenario's latest."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.scenario, []).append(run)
    chosen = {name: latest(some, label) for name, some in groups.items()}
    return {name: chosen[name] for name in [*ASKED, *sorted(chosen.keys() - ASKED.keys())] if chosen.get(name)}


def latest(rows: Sequence[L], label: str | None = None) -> list[L]:
    """The rows of one version, else of the version of the last row, by seed; a seed that was run twice counts once."""
    if not rows:
        return []
    wanted = label if label is not None else rows[-1].label
    mine = {_row_key(row): row for row in rows if row.label == wanted}
    return [mine[key] for key in sorted(mine)]


def _row_key(row: Run | StartRun) -> tuple[str, int]:
    return (row.kind if isinstance(row, StartRun) else ""), row.seed


def _is_noisy(runs: Sequence[Run]) -> bool:
    return not runs[0].scenario.startswith("noise-free")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table whose first column is text, the rest numbers; empty without rows."""
    body = ["| " + " | ".join(row) + " |" for row in rows]
    if not body:
        return ["Not run yet."]
    return ["| " + " | ".join(head) + " |", "| --- |" + " ---: |" * (len(head) - 1), *body]


def _has_own_noise(runs: Sequence[Run]) -> bool:
    """Whether no other scenario shares these recordings' random numbers."""
    return runs[0].label.endswith(INDEPENDENT)


def _verdict(holds: bool | None, runs: int, asked: int) -> str:
    """What is asked is asked of so many runs; of fewer it is a first impression."""
    if holds is None:
        return ""
    return ("yes" if holds else "**no**") + ("" if runs >= asked else f", {runs} of {asked} runs")


def _accuracy_section(runs: Mapping[str, list[Run]], bounds: Mapping[str, BoundRow]) -> list[str]:
    rows = []
    for name, some in runs.items():
        if name in TWINS or not any(run.is_solved for run in some):
            continue
        found, expected = accuracy(some), stated(some)
        limit = bound_accuracy(bounds[name]) if name in bounds and _is_noisy(some) else None
        asked = ASKED.get(name)
        ratio = found.over(limit) if limit is not None else None
        used = np.mean([run.scans_used / max(run.scans_total, 1) for run in some if run.is_solved])
        rows.append(
            [
                name,
                f"{sum(run.is_solved for run in some)} of {len(some)}",
                *(
                    _value(found, expected, limit, key, digits)
                    for key, digits in (("rotation_deg", 4), ("translation_mm", 3), ("offset_ms", 4))
                ),
                " / ".join(f"{value:.2f}" for value in _parts(ratio)) if ratio is not None else "",
                _asked_text(asked),
                _verdict(_holds(asked, found, ratio), len(some), RUNS if _is_noisy(some) else 1),
                f"{100 * used:.0f} %",
            ]
        )
    head = (
        "recording",
        "solved",
        "rotation [deg]",
        "translation [mm]",
        "time offset [ms]",
        "efficiency",
        "asked",
        "holds",
        "scans used",
    )
    landmarks = [
        f"{name}: {asked.like_bound.rotation_deg:g} deg, {asked.like_bound.translation_mm:g} mm, "
        f"{asked.like_bound.offset_ms:g} ms"
        for name, asked in ASKED.items()
        if asked.like_bound is not None
    ]
    return [
        "",
        "## Accuracy",
        "",
        "Each cell: rms error (what the stated sigmas let one expect; bound). Ratios: rotation / translation / time offset.",
        "",
        *_table(head, rows),
        "",
        f"Bounds in a like room, as landmarks: {'; '.join(landmarks)}.",
    ]


def _value(found: Accuracy, expected: Accuracy, limit: Accuracy | None, key: str, digits: int) -> str:
    values = [getattr(each, key) for each in (found, expected, limit) if each is not None]
    texts = [f"{value:.{digits}f}" if value >= 10.0 ** (1 - digits) else f"{value:.1e}" for value in values]
    return f"{texts[0]} ({'; '.join(texts[1:])})"


def _parts(value: Accuracy) -> tuple[float, float, float]:
    return value.rotation_deg, value.translation_mm, value.offset_ms


def _asked_text(asked: Asked | None) -> str:
    if asked is None:
        return ""
    if asked.over_bound is not None:
        return "<= " + " / ".join(f"{value:g}" for value in _parts(asked.over_bound))
    assert asked.at_most is not None
    return f"<= {asked.at_most.rotation_deg:g} deg, {asked.at_most.translation_mm:g} mm"


def _holds(asked: Asked | None, found: Accuracy, ratio: Accuracy | None) -> bool | None:
    if asked is None or (asked.over_bound is not None and ratio is None):
        return None
    limit, value = (asked.over_bound, ratio) if asked.over_bound is not None else (asked.at_most, found)
    assert limit is not None
    assert value is not None
    return all(a <= b for a, b in zip(_parts(value), _parts(limit), strict=True))


def _consistency_section(runs: Mapping[str, list[Run]]) -> list[str]:
    rows = []
    for name, some in runs.items():
        if not _is_noisy(some) or not any(run.is_solved for run in some):
            continue
        found = consistency(some)
        asked = name in ASKED and ASKED[name].is_consistent
        rows.append(
            [
                name,
                str(sum(run.is_solved for run in some)),
                f"{found.mean_nees:.2f}",
                f"{found.low:.2f} to {found.high:.2f}",
                f"{100 * found.pooled:.1f} %",
                *(f"{100 * share:.0f}" for share in found.coverage),
                found.bias_text,
                _verdict(found.nees_holds and found.coverage_holds if asked else None, len(some), RUNS),
            ]
        )
    head = ("recording", "runs", "mean NEES", "99 % interval", "pooled", *PARAMETERS, "bias", "holds")
    return [
        "",
        "## Consistency",
        "",
        "NEES of the 7 parameters is chi-square with 7 degrees of freedom where the stated covariance is true; the interval",
        "is its mean's over as many runs. Coverage: how often the 95 % interval holds the truth, pooled (asked: 92 to 98 %)",
        "and by parameter [%] (asked: at least 87). Bias: the largest of the seven mean errors, in its own sigmas: beyond",
        f"{BIAS_SIGMAS:.1f} it is one.",
        "",
        *_table(head, rows),
    ]


def _twin_section(runs: Mapping[str, list[Run]]) -> list[str]:
    rows, independent = [], False
    for name, twin in TWINS.items():
        if name not in runs or twin not in runs:
            continue
        apart = _has_own_noise(runs[name])
        spoiled, clean = those_solved(runs[name], runs[twin]) if apart else paired(runs[name], runs[twin])
        if not spoiled or not clean:
            continue
        independent = independent or apart
        ratio = accuracy(spoiled).over(accuracy(clean))
        unsolved = [run.seed for run in runs[name] if not run.is_solved]
        holds = max(_parts(ratio)) <= TWIN_AT_MOST and not unsolved
        rows.append(
            [
                name,
                twin,
                str(len(spoiled)),
                " / ".join(f"{value:.2f}" for value in _parts(ratio)),
                f"<= {TWIN_AT_MOST:g}",
                seeds_text(unsolved),
                _verdict(holds, len(spoiled) + len(unsolved), RUNS),
            ]
        )
    head = ("recording", "clean twin", "runs", "rms over the twin's", "asked", "not solved", "holds")
    noise = (
        "Each recording has noise of its own: a ratio is known to 1 / sqrt(3 N), the time offset's to 1 / sqrt(N)."
        if independent
        else "Pairs share the seed, and with it every range's and reading's noise."
    )
    return [
        "",
        "## Wrong data",
        "",
        f"{noise} Ratios: rotation / translation / time offset.",
        "",
        *_table(head, rows),
    ]


def _starts_section(starts: Sequence[StartRun]) -> list[str]:
    rows = []
    for kind, version in dict.fromkeys((run.kind, run.label) for run in starts):
        some = latest([run for run in starts if run.kind == kind], version)
        solved = [run for run in some if np.isfinite(run.worst_sigmas)]
        outside = [run.seed for run in some if not run.worst_sigmas <= START_SIGMAS]
        dearer = [run.seed for run in some if not abs(run.cost_excess) <= START_COST]
        excess = [abs(run.cost_excess) for run in solved if np.isfinite(run.cost_excess)]
        rows.append(
            [
                kind,
                version,
                some[0].scenario,
                f"{len(solved)} of {len(some)}",
                f"{max((run.worst_sigmas for run in solved), default=np.nan):.2f}",
                f"{max(excess, default=np.nan):.1e}",
                f"{max((run.apart_sigmas for run in solved), default=np.nan):.1e}",
                seeds_text(outside),
                seeds_text(dearer),
                _verdict(not outside and not dearer, len(some), STARTS_ASKED.get(kind, 1)),
            ]
        )
    head = (
        "start",
        "version",
        "recording",
        "solved",
        "worst error [sigmas]",
        "worst cost difference",
        "worst distance [sigmas]",
        f"seeds beyond {START_SIGMAS:g} sigmas",
        f"seeds beyond {START_COST:g} of the cost",
        "holds",
    )
    return [
        "",
        "## Starts",
        "",
        "Random mountings over all of SO(3), lever arms to 1 m, offsets to 0.5 s (`any`); the same with clocks minutes apart",
        "or of different epochs. Each is solved without a guess and again from the truth; cost and distance compare the two.",
        "A later version that some seeds were run again with has a row of its own.",
        "",
        *_table(head, rows),
    ]


def _failures_section(runs: Mapping[str, list[Run]]) -> list[str]:
    rows = []
    for name, some in runs.items():
        reasons = Counter((run.status, run.code) for run in some if not run.is_solved)
        for (status, code), _ in sorted(reasons.items()):
            seeds = [run.seed for run in some if (run.status, run.code) == (status, code)]
            rows.append([name, status, code, seeds_text(seeds)])
    body = _table(("recording", "status", "reason", "seeds"), rows) if rows else ["None."]
    return ["", "## Runs without an answer", "", *body]


def _seeds_section(runs: Mapping[str, list[Run]]) -> list[str]:
    rows = [
        [
            name,
            seeds_text([run.seed for run in some]),
            some[0].label,
            f"{np.median([run.solve_s for run in some]):.1f}",
            f"{np.median([run.cpu_s for run in some]):.1f}",
        ]
        for name, some in runs.items()
    ]
    head = ("recording", "seeds", "version", "median time [s]", "median CPU [s]")
    return ["", "## Seeds", "", "Times are of a busy machine, several runs at once.", "", *_table(head, rows), ""]
