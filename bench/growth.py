"""`python -m bench.growth`: what a calibration costs as recordings grow in length, in lasers and in planes.

    python -m bench.growth [--lengths 10 60 600 1800] [--lasers 16 32 64 128] [--planes 3 6 12 30] [--modes ideal default]

writes bench/results/growth.md, and says what is over its aim. The gate (`python -m bench gate growth`) goes as far as ten
minutes; half an hour is measured here alone. One recording after the other is simulated, read once by one honest pass
(passes.py), calibrated in processes of their own with ideal sensors (`--intrinsics off`) and, where it is about length, by
default, and removed: an hour of them would fill a disk, of which half an hour takes 25 GB. Judged is how much more CPU a
longer recording takes, or one of more lasers or planes, than its points are more; and of ten minutes and half an hour, by
what is asked of them, how many times as long they take as the minute and how many megabytes the process had at its height.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.lasers import LIDARS
from bench.machine import measured
from bench.metrics import CLOCK_SLACK, MEMORY, MEMORY_SLACK, RATIO, SINGLE_SLACK, Metric
from bench.passes import Cost, Spent, honest_pass, run_command
from bench.store import RESULTS
from calib_core.simulate import SCENARIOS, Scenario, simulate
from calib_core.simulate.motion import Sway, Wave
from calib_core.simulate.scene import Face, Scene
from calib_core.simulate.sensors import XT_32

NAME = "growth"
#: What the gate looks at: a quarter of an hour of work. The page has all of it.
GATED_LENGTHS_S = (10.0, 60.0, 600.0)
LENGTHS_S = (10.0, 60.0, 600.0, 1800.0)
LASERS = (16, 32, 64, 128)
PLANES = (3, 6, 12, 30)
#: Words of the command line by what they are called here and in the keys of metrics.
MODES: Mapping[str, tuple[str, ...]] = {"ideal": ("--intrinsics", "off"), "default": ()}
MINUTE_S = 60.0
#: Of a recording of so many seconds: how many times the minute's time, and how many MB.
_AIMS: Mapping[float, tuple[float | None, float]] = {
    MINUTE_S: (None, 800.0),
    600.0: (11.0, 1200.0),
    1800.0: (33.0, 1600.0),
}
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

    used: planes that the answer counts.   points: that lie on these.   mode: "ideal" or "default".
    """

    of: str
    size: float
    used: int
    points: int
    passed: Spent
    cost: Cost
    mode: str = "ideal"

    @property
    def passes(self) -> float:
        """CPU of all threads over that of the honest pass over the same recording."""
        return self.cost.cpu_s / self.passed.cpu_s


def grown(
    lengths_s: Sequence[float], lasers: Sequence[int], planes: Sequence[int], modes: Collection[str] = tuple(MODES)
) -> Iterator[Grown]:
    """Each recording's runs, as they are done: of lengths in the modes, of what is short with ideal sensors."""
    with tempfile.TemporaryDirectory(prefix="unsweep-growth-") as name:
        folder = Path(name)
        plain = SCENARIOS["handheld"]
        assert isinstance(plain.motion, Sway)
        plain = replace(plain, motion=never_again(plain.motion))
        for length_s in lengths_s:
            yield from _measured("length", length_s, plain, length_s, folder, modes)
        for count in lasers:
            yield from _measured("lasers", count, replace(plain, lidar=_LIDARS[count]), SHORT_S, folder)
        for count in planes:
            yield from _measured("planes", count, replace(plain, scene=room_of(count)), SHORT_S, folder)


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


def _measured(
    of: str, size: float, scenario: Scenario, duration_s: float, folder: Path, modes: Collection[str] = ("ideal",)
) -> Iterator[Grown]:
    bag, result = folder / "room.bag", folder / "result.json"
    simulate(scenario, bag, seed=1, duration_s=duration_s)
    honest_pass(bag)
    passed = honest_pass(bag)
    for mode in modes:
        cost = run_command(["calibrate", str(bag), "--output", str(result), *MODES[mode]])
        quality = json.loads(result.read_text(encoding="utf-8"))["quality"]
        yield Grown(of, size, len(quality["planes"]), int(quality["points_used"]), passed, cost, mode)
    for path in folder.iterdir():
        path.unlink()


def metrics_of(runs: Sequence[Grown]) -> list[Metric]:
    """By how much the passes of the largest are more than those of the smallest, and the most memory, kind by kind.

    Of lengths the minute is held against what is shorter; and what is asked of longer ones is held against the minute.
    """
    found = []
    for of in dict.fromkeys(run.of for run in runs):
        mine = [
            run for run in runs if run.of == of and run.mode == "ideal" and (of != "length" or run.size <= MINUTE_S)
        ]
        if not mine:
            continue
        small, large = mine[0], mine[-1]
        key = f"{NAME}.{of}_{large.size:g}_over_{small.size:g}"
        found += [
            Metric(key=key, value=large.passes / small.passes, unit=RATIO, direction="lower", tolerance=SINGLE_SLACK)
        ]
        if of != "length":
            found += [Metric(key=f"{NAME}.{of}_{large.size:g}_mb", value=large.cost.memory_mb, unit=MEMORY)]
    for mode in MODES:
        found += _over_the_minute(mode, [run for run in runs if run.of == "length" and run.mode == mode])
    return found


def _over_the_minute(mode: str, runs: Sequence[Grown]) -> Iterator[Metric]:
    """Of one mode: times as long as the minute by the clock, as is asked, and the memory."""
    minute_s = next((run.cost.whole_s for run in runs if run.size == MINUTE_S), None)
    for run in runs:
        times, most_mb = _AIMS.get(run.size, (None, None))
        if minute_s is not None and times is not None:
            yield Metric(
                key=f"{NAME}.{mode}_{run.size:g}_over_60",
                value=run.cost.whole_s / minute_s,
                unit=RATIO,
                direction="lower",
                tolerance=CLOCK_SLACK,
                aim=times,
            )
        if most_mb is not None:
            yield Metric(
                key=f"{NAME}.{mode}_{run.size:g}_mb",
                value=run.cost.memory_mb,
                unit=MEMORY,
                direction="lower",
                tolerance=MEMORY_SLACK,
                aim=most_mb,
            )


def measure() -> list[Metric]:
    """What the gate looks at."""
    return metrics_of(list(grown(GATED_LENGTHS_S, (LASERS[0], LASERS[-1]), (PLANES[0], PLANES[-1]))))


def page(runs: Sequence[Grown], where: str) -> str:
    """The tables. where: when and on what they were measured."""
    lines = [
        "# What a calibration costs as recordings grow",
        "",
        (
            "Written by `python -m bench.growth`: `unsweep calibrate` in processes of its own, with ideal sensors (`--intrinsics "
            "off`) unless it says default. One honest pass reads the same bag, its points to double precision, one transform and "
            "the times (`bench/passes.py`); memory is the most that the process had. Lasers and planes: "
            f"{SHORT_S:.0f} s each."
        ),
        "",
        where,
    ]
    units = {"length": "s", "lasers": "lasers", "planes": "planes"}
    for of, mode in sorted(
        {(run.of, run.mode) for run in runs}, key=lambda kind: (list(units).index(kind[0]), kind[1] != "ideal")
    ):
        head = units[of] if mode == "ideal" else f"{units[of]}, {mode}"
        lines += [
            "",
            f"| {head} | {' | '.join(_COLUMNS)} |",
            "| ---: " * 9 + "|",
        ]
        for run in (each for each in runs if (each.of, each.mode) == (of, mode)):
            cost, pass_s = run.cost, run.passed.clock_s
            lines.append(
                f"| {run.size:g} | {run.used} | {1e-6 * run.points:.1f} | {pass_s:.2f} | {cost.whole_s:.1f} | "
                f"{cost.whole_s / pass_s:.0f} | {cost.cpu_s:.1f} | {run.passes:.0f} | {cost.memory_mb:.0f} |"
            )
    asked = [metric for metric in metrics_of(runs) if metric.aim is not None]
    if asked:
        lines += ["", "| asked | found | aim | holds |", "| --- | ---: | ---: | --- |"]
        lines += [
            f"| {metric.key.partition('.')[2]} | {metric.value:.4g} {metric.unit} | {metric.aim:g} | "
            f"{'**no**' if metric.is_over() else 'yes'} |"
            for metric in asked
        ]
    return "\n".join([*lines, ""])


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", nargs="*", type=float, default=LENGTHS_S, metavar="S", help="(%(default)s)")
    parser.add_argument("--lasers", nargs="*", type=int, choices=LASERS, default=LASERS, help="(%(default)s)")
    parser.add_argument("--planes", nargs="*", type=int, default=PLANES, metavar="N", help="(%(default)s)")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES), help="of lengths (%(default)s)")
    chosen = parser.parse_args(arguments)
    runs, where = [], measured()
    for run in grown(chosen.lengths, chosen.lasers, chosen.planes, chosen.modes):
        runs.append(run)
        sys.stderr.write(f"{run.of} {run.size:g} {run.mode}: {run.cost.whole_s:.1f} s, {run.cost.memory_mb:.0f} MB\n")
        PAGE.write_text(page(runs, where), encoding="utf-8")
    for metric in metrics_of(runs):
        if metric.is_over():
            sys.stderr.write(f"OVER ITS AIM: {metric.key} = {metric.told()}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
