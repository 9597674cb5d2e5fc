"""What the first calibration after an installation takes over the second: `make run` compiles the program's loops, once.

`unsweep compile-kernels`, as the Makefile has it, into an empty folder for compiled loops; then each turn begins with that folder
as it was and calibrates one recording twice, in processes of their own. It is not the recording by which loops are compiled. The
quickest first run counts and the quickest second one, and how many loops a first one still had to compile, which no other work
on the machine changes. Python's own bytecode is there before, as an installation leaves it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.metrics import CLOCK_SLACK, CPU_SLACK, RATIO, Metric
from bench.passes import Cost, run_command
from calib_core import api

NAME = "first_run"
SCENARIO = "handheld"
DURATION_S = 20.0
TURNS = 3
#: What a first run may take over a second one.
AIM = 1.1
#: Words of `calibrate`: loops for the sensors' own parameters are others than without.
MODES: Mapping[str, tuple[str, ...]] = {"default": (), "ideal": ("--intrinsics", "off")}
#: Where Numba keeps what it compiles, and what such a file is called.
_CACHE, _COMPILED = "NUMBA_CACHE_DIR", "*.nbc"

Run = Callable[[Sequence[str], Mapping[str, str]], Cost]


@dataclass(frozen=True, slots=True)
class Pair:
    """A first run and a second one, and how many loops the first compiled."""

    first: Cost
    second: Cost
    loops: int


def install(cache: Path) -> None:
    """Compile as `make run` does, into a folder. Raises SystemExit where that fails."""
    command = [sys.executable, "-m", "app.cli", "compile-kernels"]
    done = subprocess.run(command, env=os.environ | {_CACHE: str(cache)}, check=False)
    if done.returncode != 0:
        raise SystemExit(f"unsweep compile-kernels ended with exit code {done.returncode}.")
    if not compiled(cache):
        raise SystemExit(f"unsweep compile-kernels left no compiled loop in {cache}.")


def compiled(cache: Path) -> dict[Path, int]:
    """Files of compiled loops below a folder, and when each was written [ns]: one compiled again takes another's name."""
    return {path.relative_to(cache): path.stat().st_mtime_ns for path in cache.rglob(_COMPILED)}


def pairs(installed: Path, words: Sequence[str], turns: int, run: Run = run_command) -> Iterator[Pair]:
    """Pairs of runs of `unsweep WORDS`, each beginning with the loops as they were installed."""
    before = compiled(installed)
    for _ in range(turns):
        with tempfile.TemporaryDirectory(prefix="unsweep-first-run-") as made:
            cache = Path(made) / installed.name
            shutil.copytree(installed, cache)
            around = {_CACHE: str(cache)}
            first = run(words, around)
            new = compiled(cache).items() - before.items()
            yield Pair(first, run(words, around), len(new))


def metrics_of(found: Mapping[str, Sequence[Pair]]) -> list[Metric]:
    """First over second, by the clock and by CPU, and the loops compiled in between, of each mode."""
    return [metric for mode, turns in found.items() for metric in _of_mode(mode, turns)]


def _of_mode(mode: str, turns: Sequence[Pair]) -> Iterator[Metric]:
    clock = min(each.first.whole_s for each in turns) / min(each.second.whole_s for each in turns)
    cpu = min(each.first.cpu_s for each in turns) / min(each.second.cpu_s for each in turns)
    yield Metric(key=f"{NAME}.{mode}", value=clock, unit=RATIO, direction="lower", tolerance=CLOCK_SLACK, aim=AIM)
    yield Metric(
        key=f"{NAME}.{mode}_cpu",
        value=cpu,
        unit=RATIO,
        direction="lower",
        tolerance=CPU_SLACK,
        aim=AIM,
        is_bound=True,
    )
    loops = max(each.loops for each in turns)
    yield Metric(key=f"{NAME}.{mode}_loops", value=loops, unit="loops", direction="lower", aim=0.0, is_bound=True)


def measure(duration_s: float = DURATION_S, turns: int = TURNS) -> list[Metric]:
    """Install once, and calibrate one recording after it: the modes apart, as each compiles for the other."""
    with tempfile.TemporaryDirectory(prefix="unsweep-first-run-") as made:
        bag, cache = Path(made) / "room.bag", Path(made) / "loops"
        api.simulate(SCENARIO, bag, seed=0, duration_s=duration_s)
        install(cache)
        calibrate = ["calibrate", str(bag), "--output", str(Path(made) / "result.json")]
        return metrics_of({mode: list(pairs(cache, [*calibrate, *words], turns)) for mode, words in MODES.items()})
