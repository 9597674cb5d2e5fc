"""`python -m bench.draw`: the very noise of some seeds through the efficient estimate, beside what the estimator made of it.

    python -m bench.draw partial-views --seeds 1-20 --jobs 2

Hundred runs leave a ratio of rms and bound unsure by 7 % for one parameter: an estimator may be within its sigma of the
bound and the draw may not. The efficient estimate (`bench/bound`: linear, from the truth, all returns) makes the draw's own
error; what the estimator errs beyond it is the estimator's. Rows go to bench/results/draws.csv, the table to accuracy.md.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.campaign import seeds_of, spread
from bench.runs import PARAMETERS, Run
from bench.store import RESULTS
from bench.tables import append_row, read_rows

DRAWS = "draws.csv"


@dataclass(frozen=True, slots=True)
class Draw:
    """The efficient estimate of one seed. errors: (7,) estimate minus truth, stds: (7,) the bound; SI, contract's order."""

    scenario: str
    seed: int
    errors: tuple[float, ...]
    stds: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Shares:
    """Rms over the seeds that both have, over the bound; rotation, translation, time offset.

    efficient: of the efficient estimate.   estimator: of the estimator.   beyond: of the difference of the two.
    """

    seeds: tuple[int, ...]
    efficient: tuple[float, float, float]
    estimator: tuple[float, float, float]
    beyond: tuple[float, float, float]


def shares(runs: Sequence[Run], draws: Sequence[Draw]) -> Shares | None:
    """The two side by side; None where they have no seed in common."""
    solved = {run.seed: run for run in runs if run.is_solved}
    both = sorted((draw for draw in draws if draw.seed in solved), key=lambda draw: draw.seed)
    if not both:
        return None
    efficient = np.array([draw.errors for draw in both])
    estimator = np.array([solved[draw.seed].errors for draw in both])
    bound = np.array([draw.stds for draw in both])
    return Shares(
        tuple(draw.seed for draw in both),
        _over(efficient, bound),
        _over(estimator, bound),
        _over(estimator - efficient, bound),
    )


def _over(errors: NDArray[np.float64], bound: NDArray[np.float64]) -> tuple[float, float, float]:
    blocks = (slice(0, 3), slice(3, 6), slice(6, 7))
    rotation, translation, offset = (
        float(np.sqrt(np.sum(errors[:, block] ** 2) / np.sum(bound[:, block] ** 2))) for block in blocks
    )
    return rotation, translation, offset


def read_draws(folder: Path = RESULTS) -> dict[str, list[Draw]]:
    """The draws of every scenario."""
    found: dict[str, list[Draw]] = {}
    for draw in read_rows(folder / DRAWS, Draw, PARAMETERS):
        found.setdefault(draw.scenario, []).append(draw)
    return found


def section(runs: Mapping[str, Sequence[Run]], draws: Mapping[str, Sequence[Draw]]) -> list[str]:
    """The part of accuracy.md; nothing where nothing was drawn."""
    rows = []
    for name in runs:
        found = shares(runs[name], draws.get(name, []))
        if found is not None:
            parts = (found.efficient, found.estimator, found.beyond)
            rows.append(
                f"| {name} | {len(found.seeds)} | "
                + " | ".join(" / ".join(f"{value:.2f}" for value in part) for part in parts)
                + " |"
            )
    if not rows:
        return []
    return [
        "",
        "## The draw",
        "",
        "The efficient estimate from the same noise (`python -m bench.draw`): linear, about the truth, from every return. Rms",
        "over the bound, rotation / translation / time offset. What it errs is the draw's; the last column is the estimator's.",
        "",
        "| recording | seeds | efficient estimate | this program | the difference |",
        "| --- | ---: | ---: | ---: | ---: |",
        *rows,
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw what is missing."""
    parser = argparse.ArgumentParser(prog="python -m bench.draw", description="The draw's own error.")
    parser.add_argument("scenarios", nargs="+", metavar="SCENARIO")
    parser.add_argument("--seeds", type=seeds_of, default=seeds_of("1-20"), help="such as 1-5,8 (1-20)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (%(default)s)")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="of the results (bench/results)")
    chosen = parser.parse_args(arguments)
    done = {(draw.scenario, draw.seed) for some in read_draws(chosen.folder).values() for draw in some}
    tasks = [(name, seed) for name in chosen.scenarios for seed in chosen.seeds if (name, seed) not in done]
    for draw in spread(_drawn, tasks, chosen.jobs):
        append_row(chosen.folder / DRAWS, draw, PARAMETERS)
        sys.stderr.write(f"{draw.scenario} seed {draw.seed}\n")
    return 0


def _drawn(task: tuple[str, int]) -> Draw:
    from bench.bound import bound_of

    scenario, seed = task
    bound = bound_of(scenario, seed=seed)
    return Draw(scenario, seed, tuple(bound.efficient_error.tolist()), tuple(bound.std.tolist()))


if __name__ == "__main__":
    sys.exit(main())
