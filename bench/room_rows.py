"""Rows of the random rooms: one for each seed, as they lie in rooms.csv."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.extremes import EXTREMES
from bench.runs import PARAMETERS
from bench.store import RESULTS
from bench.tables import read_rows

ROWS = "rooms.csv"


@dataclass(frozen=True, slots=True)
class Row:
    """One seed. errors, stds: (7,) SI, contract's order, NaN where refused.   code: of the first error message.

    left_out: planes named as left out, -1 where that was not counted.
    """

    place: str
    seed: int
    lidar: str
    boxes: int
    walkers: int
    rate_deg_s: float
    faults: str
    status: str
    code: str
    text: str
    errors: tuple[float, ...]
    stds: tuple[float, ...]
    nees: float
    scans_used: int
    scans_total: int
    planes: int
    left_out: int
    solve_s: float
    version: str

    @property
    def kind(self) -> str:
        """Where it comes from: drawn, extreme, clutter, or bare: that room without what is not of the building."""
        return self.place if self.place in ("clutter", "bare") else "extreme" if self.place in EXTREMES else "drawn"

    @property
    def is_solved(self) -> bool:
        """Whether there is an answer to compare."""
        return bool(np.isfinite(self.nees))

    @property
    def worst_sigmas(self) -> float:
        """The largest error in its own stated sigma."""
        return float(np.max(np.abs(np.array(self.errors)) / np.array(self.stds)))

    def line(self) -> str:
        """For the terminal."""
        mm = 1e3 * float(np.linalg.norm(self.errors[3:6]))
        mm_std = 1e3 * float(np.linalg.norm(self.stds[3:6]))
        head = (
            f"{self.seed:4d} {self.place:6s} {self.lidar:8s} b{self.boxes:<2d} w{self.walkers} {self.rate_deg_s:4.0f} deg/s"
            f" {self.faults:10s} {self.status:10s} {self.scans_used:3d}/{self.scans_total} {self.planes:2d} planes"
            f" {self.solve_s:5.1f} s"
        )
        if self.is_solved:
            return f"{head} nees {self.nees:7.1f} worst {self.worst_sigmas:5.1f} sigma {mm:7.2f} ({mm_std:.2f}) mm"
        return f"{head} {self.code}: {self.text}"


def key_of(kind: str, place: str, seed: int) -> tuple[str, int]:
    """What tells rows apart: the place of a drawn one is the seed's."""
    return (place if kind == "extreme" else kind), seed


def read(folder: Path = RESULTS) -> list[Row]:
    """All rows; the last run of a seed counts."""
    rows = {key_of(row.kind, row.place, row.seed): row for row in read_rows(folder / ROWS, Row, PARAMETERS)}
    return list(rows.values())
