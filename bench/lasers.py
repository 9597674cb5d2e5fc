"""What the sensors' own parameters cost behind lidars of 16, 64 and 128 lasers: CPU of a default run over one with ideal sensors.

The same seconds by hand behind each lidar, `unsweep calibrate` in processes of their own, default and `--intrinsics off` in
turns, so that both see the same machine. CPU of all threads: on a busy machine it varies by less than the time waited.
Of each the cheapest turn counts: what slows a turn is not ours.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from bench.metrics import CPU_SLACK, RATIO, Metric
from calib_core.simulate import SCENARIOS, sensors, simulate
from calib_core.simulate.patterns import Spinning

NAME = "lasers"
DURATION_S = 20.0
TURNS = 2
#: What is asked of every lidar.
LIMIT = 1.5
_MODES = ("off", "auto")
assert isinstance(sensors.OS1_64.pattern, Spinning)
_OS_64 = sensors.OS1_64.pattern
#: As an OS0 or OS1 of 128 lasers, which looks 45 degrees far up and down together.
OS_128 = replace(
    sensors.OS1_64,
    pattern=replace(
        _OS_64,
        elevations_deg=tuple(22.5 - 45.0 / 127.0 * beam for beam in range(128)),
        azimuths_deg=2 * _OS_64.azimuths_deg,
        channel_ns=2 * _OS_64.channel_ns,
    ),
)
LIDARS: Mapping[int, sensors.Lidar] = {16: sensors.VLP_16, 64: sensors.OS1_64, 128: OS_128}


def cpu_s(bag: Path, result: Path, mode: str) -> float:
    """CPU [s] of one run, all threads, user and system. Raises SystemExit where it gives no calibration."""
    command = [sys.executable, "-m", "app.cli", "calibrate", str(bag), "--output", str(result), "--intrinsics", mode]
    with subprocess.Popen([*command, "--quiet"], stdout=subprocess.DEVNULL) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"unsweep calibrate ended with exit code {process.returncode}.")
    return used.ru_utime + used.ru_stime


def metrics_of(turns: Mapping[int, Mapping[str, Sequence[float]]]) -> list[Metric]:
    """The ratios of each number of lasers, held against the baseline, and what they are to be.

    turns: CPU [s] of the turns of each mode.
    """
    ratios = {lasers: min(modes["auto"]) / min(modes["off"]) for lasers, modes in turns.items()}
    judged = [
        Metric(
            key=f"{NAME}.auto_over_off_{lasers}",
            value=ratio,
            unit=RATIO,
            direction="lower",
            tolerance=CPU_SLACK,
            aim=LIMIT,
        )
        for lasers, ratio in ratios.items()
    ]
    seconds = [
        Metric(key=f"{NAME}.{mode}_{lasers}_s", value=min(modes[mode]), unit="s")
        for lasers, modes in turns.items()
        for mode in _MODES
    ]
    return [*judged, *seconds]


def measure(duration_s: float = DURATION_S, turns: int = TURNS) -> list[Metric]:
    """Simulate behind each lidar and measure, one recording after the other: those of many lasers are a gigabyte."""
    found: dict[int, dict[str, list[float]]] = {}
    with tempfile.TemporaryDirectory(prefix="unsweep-lasers-") as folder:
        for lasers, lidar in LIDARS.items():
            bag, result = Path(folder) / f"{lasers}.bag", Path(folder) / "result.json"
            scenario = replace(SCENARIOS["handheld"], slug=f"handheld-{lasers}", lidar=lidar)
            simulate(scenario, bag, seed=1, duration_s=duration_s)
            if not found:  # loops that are not compiled yet would count as one mode's
                for mode in _MODES:
                    cpu_s(bag, result, mode)
            found[lasers] = {mode: [] for mode in _MODES}
            for _ in range(turns):
                for mode in _MODES:
                    found[lasers][mode].append(cpu_s(bag, result, mode))
            bag.unlink()
    return metrics_of(found)
