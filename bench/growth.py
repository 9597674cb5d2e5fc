"""`python -m bench.growth`: what a calibration costs as recordings grow in length, in lasers and in planes.

    python -m bench.growth [--lengths 10 60 600 1800] [--lasers 16 32 64 128] [--planes 3 6 12 30]

writes bench/results/growth.md. The gate (`python -m bench gate growth`) looks at the shorter ones. One recording after the
other is simulated, read once by one honest pass (passes.py), calibrated by `unsweep calibrate --intrinsics off` in a process of
its own, and removed: an hour of them would fill a disk. Judged is how much more CPU a longer recording takes, or one of more
lasers or planes, than its points are more; and how many megabytes the process had at its height.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.lasers import LIDARS
from bench.metrics import RATIO, SINGLE_SLACK, Metric
from bench.passes import Cost, honest_pass, run_command
from bench.speed import processor
from bench.store import RESULTS
from calib_core.simulate import SCENARIOS, Scenario, simulate
from calib_core.simulate.motion import Sway, Wave
from calib_core.simulate.scene import Face, Scene
from calib_core.simulate.sensors import XT_32
from calib_core.threads import usable_cores

NAME = "growth"
#: What the gate looks at: minutes of work. The page has all of it.
GATED_LENGTHS_S = (10.0, 60.0)
LENGTHS_S = (10.0, 60.0, 600.0, 1800.0)
LASERS = (16, 32, 64, 128)
PLANES = (3, 6, 12, 30)
#: Of the recordings that grow in lasers or planes.
SHORT_S = 20.0
_COLUMNS = (
    "planes used",
    "points on them [million]",
    "pass [s]",
    "whole [s]",
    "in passes",
    "CPU [s]",
    "CPU in passes",
    "memory [MB]",
)
PAGE = RESULTS / "growth.md"
_LIDARS = {**LIDARS, len(XT_32.pattern.ring): XT_32}
#: Where the rig of `handheld` moves, and how far from there the walls of a room of many stand.
_MIDDLE_M, _NEAR_M, _FAR_M, _HIGH_M = (1.3, 1.28), 2.7, 4.2, 2.7


@dataclass(frozen=True)
class Grown:
    """One recording and its run. of: what grew, "length", "lasers" or "planes".   size: seconds, lasers or planes that there are.

    used: planes that the answer counts.   points: that lie on these.
    """

    of: str
    size: float
    used: int
    points: int
    pass_s: float
    cost: Cost

    @property
    def passes(self) -> float:
        """CPU of all threads in honest passes over the same recording."""
        return self.cost.cpu_s / self.pass_s


def grown(lengths_s: Sequence[float], lasers: Sequence[int], planes: Sequence[int]) -> Iterator[Grown]:
    """Each recording's run, as it is done."""
    with tempfile.TemporaryDirectory(prefix="unsweep-growth-") as name:
        folder = Path(name)
        plain = SCENARIOS["handheld"]
        assert isinstance(plain.motion, Sway)
        plain = replace(plain, motion=never_again(plain.motion))
        for length_s in lengths_s:
            yield _measured("length", length_s, plain, length_s, folder)
        for count in lasers:
            yield _measured("lasers", count, replace(plain, lidar=_LIDARS[count]), SHORT_S, folder)
        for count in planes:
            yield _measured("planes", count, replace(plain, scene=room_of(count)), SHORT_S, folder)


def never_again(motion: Sway) -> Sway:
    """The motion at tempos of which none goes into another: hundredths of a Hertz come again together after 100 s."""
    tempo = (hz for hz in np.sqrt(np.arange(2.0, 1000.0)) % 1.0 if hz > 0.0)

    def at_tempo(wave: Wave) -> Wave:
        return replace(wave, frequency_hz=wave.frequency_hz + 0.01 * next(tempo))

    x, y, z = (tuple(at_tempo(wave) for wave in axis) for axis in motion.position)
    turns = tuple(replace(turn, waves=tuple(at_tempo(wave) for wave in turn.waves)) for turn in motion.turns)
    return replace(motion, position=(x, y, z), turns=turns)


def room_of(planes: int) -> Scene:
    """A floor and a ceiling, and so many upright walls about the rig that there are as many planes: each faces it, no two alike.

    Of three planes there is no ceiling: two walls that meet.
    """
    floor = Face("floor", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), reflectivity=0.3)
    if planes == len("xyz"):
        west, south = (
            Face("wall west", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            Face("wall south", (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)),
        )
        return Scene((floor, west, south))
    walls = planes - 2
    turn = 2.0 * np.pi * (np.arange(walls) + 0.3) / walls
    # In and out by turns: walls of a regular polygon of many corners would be a cylinder's.
    out_m = np.where(np.arange(walls) % 2, _FAR_M, _NEAR_M)
    x, y = _MIDDLE_M[0] + out_m * np.cos(turn), _MIDDLE_M[1] + out_m * np.sin(turn)
    faces = [floor, Face("ceiling", (0.0, 0.0, -1.0), (0.0, 0.0, _HIGH_M))]
    for k in range(walls):
        n = (k + 1) % walls
        corners = ((x[k], y[k], 0.0), (x[n], y[n], 0.0), (x[n], y[n], _HIGH_M), (x[k], y[k], _HIGH_M))
        along = np.array([x[n] - x[k], y[n] - y[k]])
        outline_m = tuple((float(a), float(b), float(c)) for a, b, c in corners)
        faces.append(Face(f"wall {k}", (float(-along[1]), float(along[0]), 0.0), outline_m[0], outline_m))
    return Scene(tuple(faces))


def _measured(of: str, size: float, scenario: Scenario, duration_s: float, folder: Path) -> Grown:
    bag, result = folder / "room.bag", folder / "result.json"
    simulate(scenario, bag, seed=1, duration_s=duration_s)
    honest_pass(bag)
    pass_s = honest_pass(bag)
    cost = run_command(["calibrate", str(bag), "--output", str(result), "--intrinsics", "off"])
    quality = json.loads(result.read_text(encoding="utf-8"))["quality"]
    for path in folder.iterdir():
        path.unlink()
    return Grown(of, size, len(quality["planes"]), int(quality["points_used"]), pass_s, cost)


def metrics_of(runs: Sequence[Grown]) -> list[Metric]:
    """By how much the passes of the largest are more than those of the smallest, and the most memory, kind by kind."""
    found = []
    for of in dict.fromkeys(run.of for run in runs):
        mine = [run for run in runs if run.of == of]
        small, large = mine[0], mine[-1]
        key = f"{NAME}.{of}_{large.size:g}_over_{small.size:g}"
        found += [
            Metric(key=key, value=large.passes / small.passes, unit=RATIO, direction="lower", tolerance=SINGLE_SLACK),
            Metric(key=f"{NAME}.{of}_{large.size:g}_mb", value=large.cost.memory_mb, unit="MB"),
        ]
    return found


def measure() -> list[Metric]:
    """What the gate looks at."""
    return metrics_of(list(grown(GATED_LENGTHS_S, (LASERS[0], LASERS[-1]), (PLANES[0], PLANES[-1]))))


def page(runs: Sequence[Grown]) -> str:
    """The tables."""
    lines = [
        "# What a calibration costs as recordings grow",
        "",
        (
            "Written by `python -m bench.growth`: `unsweep calibrate --intrinsics off` in processes of its own. One honest pass "
            "reads the same bag, its points to double precision, one transform and the times (`bench/passes.py`); memory is the "
            f"most that the process had. Lasers and planes: {SHORT_S:.0f} s each."
        ),
        "",
        f"Python {platform.python_version()}, {usable_cores()} cores, {processor()}.",
    ]
    units = {"length": "s", "lasers": "lasers", "planes": "planes"}
    for of in dict.fromkeys(run.of for run in runs):
        lines += [
            "",
            f"| {units[of]} | {' | '.join(_COLUMNS)} |",
            "| ---: " * 9 + "|",
        ]
        for run in (each for each in runs if each.of == of):
            cost = run.cost
            lines.append(
                f"| {run.size:g} | {run.used} | {1e-6 * run.points:.1f} | {run.pass_s:.2f} | {cost.whole_s:.1f} | "
                f"{cost.whole_s / run.pass_s:.0f} | {cost.cpu_s:.1f} | {run.passes:.0f} | {cost.memory_mb:.0f} |"
            )
    return "\n".join([*lines, ""])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", nargs="*", type=float, default=LENGTHS_S, metavar="S", help="(%(default)s)")
    parser.add_argument("--lasers", nargs="*", type=int, choices=LASERS, default=LASERS, help="(%(default)s)")
    parser.add_argument("--planes", nargs="*", type=int, default=PLANES, metavar="N", help="(%(default)s)")
    chosen = parser.parse_args(arguments)
    runs = []
    for run in grown(chosen.lengths, chosen.lasers, chosen.planes):
        runs.append(run)
        sys.stderr.write(f"{run.of} {run.size:g}: {run.cost.whole_s:.1f} s, {run.cost.memory_mb:.0f} MB\n")
        PAGE.write_text(page(runs), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
