"""`python -m bench.speed`: from a bag to the result's JSON, as its user would wait for it, into bench/results/speed.md.

A minute carried by hand (17 million points, all of them used) through `unsweep calibrate` in a process of its own: wall
clock, CPU, the most memory, and when each stage began. Several turns, the quickest counts: what slows a turn is not ours.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.store import RESULTS
from calib_core import api

SCENARIO = "handheld"
LIMIT_S = 30.0
LIMIT_MB = 2000.0


@dataclass(frozen=True, slots=True)
class Turn:
    """One run of the command line. stages: their names and the seconds after the start at which each was first heard of."""

    wall_s: float
    cpu_s: float
    memory_mb: float
    stages: tuple[tuple[str, float], ...]


def timed(bag: Path, result: Path) -> Turn:
    """One turn. Raises SystemExit where it gives no calibration."""
    command = [sys.executable, "-m", "app.cli", "calibrate", str(bag), "--output", str(result), "--log-json"]
    start_s = time.monotonic()
    stages: dict[str, float] = {}
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        for line in process.stderr or ():
            event = json.loads(line)
            if event.get("event") == "stage":
                stages.setdefault(str(event["stage"]), time.monotonic() - start_s)
        _, status, used = os.wait4(process.pid, 0)
        wall_s = time.monotonic() - start_s
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"unsweep calibrate ended with exit code {process.returncode}.")
    return Turn(wall_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, tuple(stages.items()))


def report(turns: Sequence[Turn], bag_mb: float, load: float) -> str:
    """The page."""
    best = min(turns, key=lambda turn: turn.wall_s)
    rows = [
        ("wall clock", f"{best.wall_s:.1f} s", f"<= {LIMIT_S:.0f} s", best.wall_s <= LIMIT_S),
        ("memory", f"{best.memory_mb:.0f} MB", f"<= {LIMIT_MB:.0f} MB", best.memory_mb <= LIMIT_MB),
    ]
    lines = [
        "# From a bag to its calibration",
        "",
        (
            "Written by `python -m bench.speed`: `unsweep calibrate` on 60 s of a VLP-16 carried by hand, "
            f"{bag_mb:.0f} MB, all of its points."
        ),
        "",
        "| | best of " + f"{len(turns)} | asked | holds |",
        "| --- | ---: | ---: | ---: |",
        *(f"| {name} | {value} | {asked} | {'yes' if holds else '**no**'} |" for name, value, asked, holds in rows),
        f"| CPU, all threads | {best.cpu_s:.1f} s | | |",
        "",
        "| stage | heard of after |",
        "| --- | ---: |",
        *(f"| {name} | {at_s:.1f} s |" for name, at_s in best.stages),
        f"| end | {best.wall_s:.1f} s |",
        "",
        (
            f"All turns: {', '.join(f'{turn.wall_s:.1f} s' for turn in turns)}. Python {platform.python_version()}, "
            f"{os.cpu_count()} cores, {processor()}; load average before {load:.1f}."
        ),
        "",
    ]
    return "\n".join(lines)


def processor() -> str:
    """The processor's name, where the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.machine()


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write; 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bag", type=Path, help=f"a recording to use; default: the scenario `{SCENARIO}`, simulated")
    parser.add_argument("--turns", type=int, default=3, help="(%(default)s)")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="unsweep-speed-") as folder:
        bag = chosen.bag
        if bag is None:
            bag = Path(folder) / f"{SCENARIO}.bag"
            api.simulate(SCENARIO, bag, seed=0)
        load = os.getloadavg()[0]
        turns = [timed(bag, Path(folder) / "result.json") for _ in range(chosen.turns)]
        text = report(turns, bag.stat().st_size / 1e6, load)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "speed.md").write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    best = min(turns, key=lambda turn: turn.wall_s)
    return 0 if best.wall_s <= LIMIT_S and best.memory_mb <= LIMIT_MB else 1


if __name__ == "__main__":
    sys.exit(main())
