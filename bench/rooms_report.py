"""rooms.md: what came of random rigs in random rooms, of extremes, and of the cluttered room, from the rows of rooms.csv."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from bench import room_bounds
from bench.room_bounds import RoomBound, norms
from bench.room_rows import Row, read
from bench.statistics import FREEDOM
from bench.store import RESULTS

TABLE = "rooms.md"
#: So many times what is possible may be stated.
_CLOSE = 1.5


def report(folder: Path = RESULTS) -> str:
    """The page."""
    rows = read(folder)
    bounds = room_bounds.read(folder)
    lines = [
        "# Rooms",
        "",
        "Made by `python -m bench.rooms --report`. Random rigs in random rooms (`bench/rigs.py`; lidars at half their rate or",
        "less). Sigmas: the worst of the seven errors in its own stated sigma; NEES: 7 on average where a covariance is honest.",
        "Bound: that of the rig, with the faults of cheap sensors as unknowns, as they are to the estimator, which is told of no",
        "sensor here.",
        "",
    ]
    drawn = [row for row in rows if row.kind == "drawn"]
    for title, some in (
        ("Random rooms, ideal sensors", [row for row in drawn if row.faults == "ideal"]),
        ("Random rooms, sensors with faults", [row for row in drawn if row.faults != "ideal"]),
        ("Extremes", [row for row in rows if row.kind == "extreme"]),
        ("Two persons and ten boxes", [row for row in rows if row.kind == "clutter"]),
    ):
        lines += section(title, some, bounds)
    lines += beside_bare([row for row in rows if row.kind == "clutter"], [row for row in rows if row.kind == "bare"])
    return "\n".join(lines)


def beside_bare(cluttered: Sequence[Row], bare: Sequence[Row]) -> list[str]:
    """What clutter costs in time: each seed beside itself in the room without it; nothing where no seed has both."""
    alone = {row.seed: row for row in bare}
    times = [row.solve_s / alone[row.seed].solve_s for row in cluttered if row.seed in alone]
    if not times:
        return []
    versions = ", ".join(dict.fromkeys(row.version for row in bare))
    return [
        "## What the persons and boxes cost in time",
        "",
        (
            f"{len(times)} of these recordings beside the same without persons and boxes ({versions}): {np.mean(times):.2f} times"
            f" the processor time on average, {np.median(times):.2f} in the middle, {np.max(times):.2f} at the most."
        ),
        "",
    ]


def section(title: str, rows: Sequence[Row], bounds: Mapping[tuple[str, int], RoomBound] | None = None) -> list[str]:
    """One table with its summary; nothing where there are no rows."""
    if not rows:
        return []
    solved = [row for row in rows if row.is_solved]
    worst = max((row.worst_sigmas for row in solved), default=float("nan"))
    nees = float(np.mean([row.nees for row in solved])) if solved else float("nan")
    count = max(len(solved), 1)
    times = [
        max(s / b for s, b in zip(norms(row.stds), bound.cheap, strict=True)) for row, bound in _bounded(solved, bounds)
    ]
    low, high = (float(chi2.ppf(tail, FREEDOM * count)) / count for tail in (0.025, 0.975))
    lines = [
        f"## {title}",
        "",
        (
            f"{len(solved)} of {len(rows)} calibrated, the worst error {worst:.1f} of its sigmas, mean NEES {nees:.1f} (95 % of"
            f" honest ones between {low:.1f} and {high:.1f}). Versions: {', '.join(dict.fromkeys(row.version for row in rows))}."
        ),
        *_held_against_bounds(times),
        "",
        (
            "| place | seed | lidar | boxes | persons | deg/s | sensors | status | planes | left out | scans | mm | sigma, mm |"
            " sigmas | NEES |"
        ),
        "| --- | ---: | --- | ---: | ---: | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in sorted(rows, key=lambda row: (row.seed, row.place)):
        error, std = (1e3 * float(np.linalg.norm(v[3:6])) for v in (row.errors, row.stds))
        left_out = str(row.left_out) if row.left_out >= 0 else ""
        numbers = f"{error:.2f} | {std:.2f} | {row.worst_sigmas:.1f} | {row.nees:.1f}" if row.is_solved else "| | |"
        lines.append(
            f"| {row.place} | {row.seed} | {row.lidar} | {row.boxes} | {row.walkers} | {row.rate_deg_s:.0f} | {row.faults} | "
            f"{row.code or row.status} | {row.planes} | {left_out} | {row.scans_used}/{row.scans_total} | {numbers} |"
        )
    refused = [f"* {row.place} {row.seed}: {row.text}" for row in rows if not row.is_solved]
    return [*lines, "", *refused, *([""] if refused else [])]


def _bounded(rows: Sequence[Row], bounds: Mapping[tuple[str, int], RoomBound] | None) -> list[tuple[Row, RoomBound]]:
    """Those whose bound is known."""
    of = bounds or {}
    return [(row, of[row.place, row.seed]) for row in rows if (row.place, row.seed) in of]


def _held_against_bounds(times: Sequence[float]) -> list[str]:
    """One line of what is stated over what is possible; none where no bound is known. times: the largest of three, by row."""
    if not times:
        return []
    share = float(np.mean(np.array(times) <= _CLOSE))
    return [
        (
            f"Stated sigmas of rotation, translation and offset over their bounds, the largest of the three: median"
            f" {np.median(times):.2f}, at most {_CLOSE} in {100 * share:.0f} % of {len(times)}, {max(times):.2f} at most."
        )
    ]
