"""The committed bounds, one row a scenario: `python -m bench bound`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.campaign import spread
from bench.runs import PARAMETERS
from bench.store import RESULTS
from bench.tables import append_row, read_rows

BOUNDS = "bounds.csv"
#: With noise, and with every direction determined.
BOUNDED = (
    "paper-normal",
    "paper-fast",
    "handheld",
    "partial-views",
    "walking-person",
    "outliers",
    "outdoor",
    "attic",
    "ouster",
    "livox",
    "vehicle",
    "no-static-start",
)


@dataclass(frozen=True, slots=True)
class BoundRow:
    """The bound of a scenario. stds: (7,) SI.   rotation_deg, translation_mm, offset_ms: roots of the blocks' traces."""

    scenario: str
    seed: int
    rotation_deg: float
    translation_mm: float
    offset_ms: float
    stds: tuple[float, ...]
    planes: int
    points: int
    cpu_s: float


def compute(scenarios: Sequence[str], *, jobs: int, folder: Path = RESULTS) -> None:
    """The bounds of the scenarios, shown and written; rows of other scenarios stay."""
    rows = read_bounds(folder)
    for row in spread(_bound, list(scenarios), jobs):
        rows[row.scenario] = row
        print(
            f"{row.scenario:20}{row.rotation_deg:10.5f} deg{row.translation_mm:10.4f} mm{row.offset_ms:10.6f} ms"
            f"{row.planes:4} planes{row.points:10} points",
            flush=True,
        )
        _write(rows, folder / BOUNDS)


def read_bounds(folder: Path = RESULTS) -> dict[str, BoundRow]:
    """Bounds by scenario."""
    return {row.scenario: row for row in read_rows(folder / BOUNDS, BoundRow, PARAMETERS)}


def _write(rows: dict[str, BoundRow], path: Path) -> None:
    path.unlink(missing_ok=True)
    for name in sorted(rows):
        append_row(path, rows[name], PARAMETERS)


def _bound(scenario: str) -> BoundRow:
    from bench.bound import bound_of

    started = time.process_time()
    bound = bound_of(scenario, seed=1)
    stds = tuple(float(std) for std in np.asarray(bound.std))
    cpu_s = round(time.process_time() - started, 1)
    return BoundRow(
        scenario,
        1,
        bound.rotation_deg,
        bound.translation_mm,
        bound.offset_ms,
        stds,
        len(bound.planes),
        bound.points,
        cpu_s,
    )
