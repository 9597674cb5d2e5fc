"""`python -m bench.subsets`: many choices of the suggested planes, each answered within its sigmas or refused in truth.

    python -m bench.subsets cluttered --count 20     rows go to bench/results/subsets.csv; what is there is not run again
    python -m bench.subsets --report                 subsets.md from the rows

Of each recording: no choice, all that is suggested, the building's own planes, and seeded subsets of the suggestion that fix
three directions: the others dropped, what is left as it was suggested. A choice says what counts, so that a bad one may
cost accuracy and never truth.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from bench.rigs import cluttered, draw, true_planes
from bench.room_rows import Row
from bench.rooms import Made, solve
from bench.runs import PARAMETERS
from bench.store import RESULTS
from bench.tables import append_row, read_rows
from calib_core import api
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Scenario, generate
from calib_core.simulate.patterns import Rosette, Spinning
from calib_core.types import Plane

ROWS = "subsets.csv"
TABLE = "subsets.md"
DURATION_S = 8.0
#: A recording for each kind of trouble, by the seed that draws it. cluttered: two persons walking, ten boxes.
SCENES: dict[str, int | None] = {
    "cluttered": None,
    "attic": 20,
    "rosette": 36,
    "small room": 12,
    "attic, rosette": 11,
    "hall": 28,
    "hall, OS1-64": 13,
    "hall, rosette": 9,
    "corner": 44,
    "corner, XT-32": 5,
    "room": 14,
    "room, XT-32": 16,
}
#: Smallest singular value of the normals of a subset that fixes three directions.
_FIXES = 0.5
#: How likely a suggested plane is to be in a subset.
_SHARE = 0.6
#: What may not be passed: an error in its own sigma, and the time of the suggestion.
WORST_SIGMAS, WORST_TIMES = 5.0, 3.0


@dataclass(frozen=True, slots=True)
class Choice(Row):
    """One choice. choice: what of the suggestion, by number, or `any`, `all`, `true`."""

    choice: str


def scene(name: str) -> tuple[str, Scenario]:
    """Lidar's name and scenario, with a quarter of the lidar's shots."""
    seed = SCENES[name]
    lidar, scenario = "VLP-16", cluttered(duration_s=DURATION_S)
    if seed is not None:
        _, lidar, scenario = draw(seed, duration_s=DURATION_S)
    pattern = scenario.lidar.pattern
    if isinstance(pattern, Spinning):
        thin = replace(scenario.lidar, pattern=replace(pattern, column_period_ns=2 * pattern.column_period_ns))
    else:
        assert isinstance(pattern, Rosette)
        thin = replace(scenario.lidar, pattern=replace(pattern, shots_per_s=pattern.shots_per_s / 2))
    return lidar, replace(scenario, lidar=thin)


def choices(made: Made, count: int) -> list[tuple[str, list[Plane] | None]]:
    """No choice, all, the true planes, and `count` subsets, each with its name."""
    recording, truth = made
    suggested = [patch.plane for patch in api.propose_planes(recording, CalibrateSettings()).patches]
    untouched = [replace(plane, suggested=True) for plane in suggested]
    named: list[tuple[str, list[Plane] | None]] = [("any", None), ("all", untouched), ("true", true_planes(truth))]
    rng = np.random.default_rng(1)
    seen: set[str] = set()
    for _ in range(50 * count):
        some = [plane for plane in untouched if rng.uniform() < _SHARE]
        normals = np.array([plane.normal for plane in some]).reshape(-1, 3)
        name = "-".join(plane.name.split()[-1] for plane in some)
        if len(some) >= 3 and name not in seen and np.linalg.svd(normals)[1][-1] > _FIXES and len(seen) < count:
            seen.add(name)
            named.append((name, some))
    return named


def read(folder: Path = RESULTS) -> list[Choice]:
    """All rows; the last run of a choice counts."""
    return list({(row.place, row.choice): row for row in read_rows(folder / ROWS, Choice, PARAMETERS)}.values())


def report(folder: Path = RESULTS) -> str:
    """subsets.md."""
    rows = read(folder)
    lines = [
        "# Choices of planes",
        "",
        "Made by `python -m bench.subsets --report`. Recordings of 8 s with a quarter of the lidar's shots or less; of each:",
        "no choice (any), all that is suggested (all), the building's own planes (true), and seeded subsets that",
        (
            f"fix three directions. Every choice has to be answered within {WORST_SIGMAS:.0f} of its sigmas or refused in truth,"
            f" in at most {WORST_TIMES:.0f} times the time of all."
        ),
        "",
    ]
    for name in dict.fromkeys(row.place for row in rows):
        some = [row for row in rows if row.place == name]
        base_s = next((row.solve_s for row in some if row.choice == "all"), np.nan)
        solved = [row for row in some if row.is_solved]
        beyond = [row for row in solved if row.worst_sigmas > WORST_SIGMAS]
        slowest = max(row.solve_s for row in some) / base_s
        lines += [
            f"## {name}",
            "",
            (
                f"{len(some)} choices: {len(solved)} answered, {len(beyond)} beyond {WORST_SIGMAS:.0f} sigmas,"
                f" {len(some) - len(solved)} refused. Slowest: {slowest:.1f} times the time of all."
                f" Version {', '.join(dict.fromkeys(row.version for row in some))}."
            ),
            "",
            "| choice | status | planes | mm | sigma, mm | worst, sigmas | NEES | time | refused because |",
            "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | --- |",
        ]
        for row in some:
            error, std = (1e3 * float(np.linalg.norm(v[3:6])) for v in (row.errors, row.stds))
            numbers = f"{error:.2f} | {std:.2f} | {row.worst_sigmas:.1f} | {row.nees:.1f}" if row.is_solved else "| | |"
            lines.append(
                f"| {row.choice} | {row.status} | {row.planes} | {numbers} | {row.solve_s / base_s:.1f} | {row.text} |"
            )
        lines.append("")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, one choice after the other."""
    parser = argparse.ArgumentParser(prog="python -m bench.subsets", description="Choices of suggested planes.")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--count", type=int, default=20, help="subsets of each (%(default)s)")
    parser.add_argument("--report", action="store_true", help=f"write {TABLE} from the rows")
    parser.add_argument("--folder", type=Path, default=RESULTS, help="of the results (bench/results)")
    chosen = parser.parse_args(arguments)
    done = {(row.place, row.choice) for row in read(chosen.folder)}
    for name in chosen.scenes:
        lidar, scenario = scene(name)
        made = generate(scenario, seed=1)
        for choice, planes in choices(made, chosen.count):
            if (name, choice) in done:
                continue
            row = solve(name, 1, lidar, scenario, planes=planes, made=made)
            kept = {field.name: getattr(row, field.name) for field in fields(Row)}
            append_row(chosen.folder / ROWS, Choice(**kept, choice=choice), PARAMETERS)
            print(f"{choice:20s} {row.line()}", flush=True)
    if chosen.report:
        (chosen.folder / TABLE).write_text(report(chosen.folder), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
