"""worlds.md: what came of the independent simulator's recordings, from the rows of worlds.csv."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from bench.runs import PARAMETERS
from bench.statistics import FREEDOM
from bench.store import RESULTS
from bench.tables import read_rows

ROWS, TABLE = "worlds.csv", "worlds.md"


@dataclass(frozen=True, slots=True)
class Row:
    """One recording. errors, stds: (7,) SI, contract's order, NaN where refused.   code: of the first error message."""

    seed: int
    faults: str
    place: str
    motion: str
    lidar: str
    duration_s: float
    status: str
    code: str
    errors: tuple[float, ...]
    stds: tuple[float, ...]
    nees: float
    solve_s: float
    version: str

    @property
    def worst_sigmas(self) -> float:
        """The largest error in its own stated sigma; NaN where refused."""
        return float(np.max(np.abs(np.array(self.errors)) / np.array(self.stds)))

    def line(self) -> str:
        """For the terminal."""
        head = f"{self.seed:4d} {self.faults:10s} {self.place}/{self.motion}/{self.lidar} {self.status} {self.code}"
        if not np.isfinite(self.nees):
            return head
        turn, arm = (
            (unit * float(np.linalg.norm(self.errors[part])), unit * float(np.linalg.norm(self.stds[part])))
            for unit, part in ((180 / np.pi, slice(3)), (1e3, slice(3, 6)))
        )
        return (
            f"{head} worst {self.worst_sigmas:.1f} sigma nees {self.nees:.1f} | {turn[0]:.3f} ({turn[1]:.3f}) deg"
            f" {arm[0]:.2f} ({arm[1]:.2f}) mm"
        )


def read(folder: Path = RESULTS) -> list[Row]:
    """All rows; the last run of a seed with a kind of faults counts."""
    rows = {(row.seed, row.faults): row for row in read_rows(folder / ROWS, Row, PARAMETERS)}
    return list(rows.values())


def report(rows: Sequence[Row]) -> str:
    """The page."""
    lines = [
        "# Worlds",
        "",
        "Made by `python -m bench.worlds --report`. Recordings of a second simulator (`bench/worlds/`) that shares nothing with",
        "the estimator's own: places, motions, lidars, mountings, faults and bags drawn by seed. NEES of those calibrated: 7 on",
        "average where a covariance is honest. Wrong: an error beyond 5 of its own sigmas. Weak and refused ones have their",
        "reasons: walks turn about one axis mostly, a narrow view sees too little.",
        "",
        "| of | recordings | calibrated | weak | refused | mean NEES | 99 % of its law | worst sigma | wrong |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    kinds: tuple[Callable[[Row], str], ...] = (
        lambda row: f"faults: {row.faults}",
        lambda row: row.place,
        lambda row: row.motion,
        lambda row: row.lidar,
    )
    lines.append(_line("all", rows))
    for kind in kinds:
        for name in sorted({kind(row) for row in rows}):
            lines += [_line(name, [row for row in rows if kind(row) == name])]
    versions = ", ".join(dict.fromkeys(row.version for row in rows))
    return "\n".join([*lines, "", f"Versions: {versions}.", ""])


def _line(name: str, rows: Sequence[Row]) -> str:
    good = [row for row in rows if row.status == "calibrated"]
    weak, refused = (sum(row.status == status for row in rows) for status in ("weak", "refused"))
    cells = [name, str(len(rows)), str(len(good)), str(weak), str(refused)]
    if not good:
        return f"| {' | '.join([*cells, '', '', '', ''])} |"
    low, high = chi2.ppf([0.005, 0.995], FREEDOM * len(good)) / len(good)
    worst = max(row.worst_sigmas for row in good)
    wrong = sum(row.worst_sigmas > 5.0 for row in good)
    mean = float(np.mean([row.nees for row in good]))
    return f"| {' | '.join([*cells, f'{mean:.1f}', f'{low:.1f} to {high:.1f}', f'{worst:.1f}', str(wrong)])} |"
