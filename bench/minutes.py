"""What a server held minute by minute, whether it is flat, and a table of it (bench/soak.py)."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

#: Caches fill and pools grow in the first minutes; what grows afterwards is not given back.
WARM_MINUTES = 10
#: What may lie between the middle and the last third, as a share and as a number: pools breathe by that much, and two jobs run.
GROWTH = {"memory_bytes": (0.05, 8 << 20), "descriptors": (0.0, 4), "threads": (0.0, 4), "children": (0.0, 2)}
#: What the table has of each, and in which units.
TOLD = {"memory_bytes": 1e6, "descriptors": 1.0, "store_descriptors": 1.0, "threads": 1.0, "children": 1.0}


@dataclass(frozen=True, slots=True)
class Minute:
    """What the server held at the end of a minute, and what it was asked in it."""

    minute: int
    memory_bytes: int
    descriptors: int
    store_descriptors: int
    threads: int
    children: int
    disk_bytes: int
    requests: int
    slowest_s: float
    over_1_s: int
    machine_load: float


def grown(minutes: Sequence[Minute], *, warm_minutes: int = WARM_MINUTES) -> list[str]:
    """What is not flat, a sentence each: medians of the middle and the last third, after the first minutes."""
    warm = minutes[warm_minutes:]
    third = len(warm) // 3
    if third == 0:
        return ["too short to say"]
    found = []
    for name, (share, number) in GROWTH.items():
        middle, last = (
            statistics.median(getattr(one, name) for one in part) for part in (warm[third : 2 * third], warm[-third:])
        )
        if last > middle * (1.0 + share) + number:
            found.append(f"{name} grew from {middle:.0f} to {last:.0f}")
    return found


def table(minutes: Sequence[Minute], *, every: int = 10) -> list[str]:
    """Every so many minutes in one row: medians, and the most in brackets."""
    lines = [
        "| minutes | memory [MB] | descriptors | of the store | threads | children | requests, over 1 s, slowest [s] | load |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for start in range(0, len(minutes), every):
        part = minutes[start : start + every]
        cells = [f"{part[0].minute} to {part[-1].minute}" if len(part) > 1 else f"{part[0].minute} (at rest)"]
        for name, unit in TOLD.items():
            values = [getattr(one, name) / unit for one in part]
            cells.append(f"{statistics.median(values):.0f} ({max(values):.0f})")
        asked = sum(one.requests for one in part)
        cells.append(f"{asked:,}, {sum(one.over_1_s for one in part)}, {max(one.slowest_s for one in part):.2f}")
        cells.append(f"{statistics.median(one.machine_load for one in part):.1f}")
        lines.append("| " + " | ".join(cells) + " |")
    return lines
