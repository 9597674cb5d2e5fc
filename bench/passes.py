"""What a calibration costs, stage by stage, in honest passes over its recording: a measure that any machine agrees on.

One honest pass: read the bag with rosbags, x y z of every point to float64, one rigid transform, each point's time. Whatever
a calibration does, it has to do at least that; how many times over is what is shown and gated. The quickest of several
turns counts, of the pass too: what slows a turn is not ours.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from bench.metrics import CLOCK_SLACK, MEMORY_SLACK, RATIO, STAGE_SLACK, Metric
from calib_core import api
from calib_core.calibrate import Calibration
from calib_core.settings import CalibrateSettings
from calib_core.types import Recording

NAME = "passes"
SCENARIO = "handheld"
DURATION_S = 20.0
TURNS = 3
#: What drivers call a point's own time, and PointField's numbers of the types in question.
_TIMES = ("time", "t", "timestamp")
_FORMATS = {6: "<u4", 7: "<f4", 8: "<f8"}
#: Scans that the slider comes to.
_SLID = 20
#: Points of a cloud on the page.
_DRAWN = 60_000
#: A stage may always grow by so much: the time of a cheap one is mostly that of hearing about it.
_LEAST_PASSES = 0.5


@dataclass(frozen=True, slots=True)
class Cost:
    """One run of the command line: seconds by stage and in all, iterations heard of, the most memory, CPU of all threads."""

    stages: Mapping[str, float]
    whole_s: float
    iterations: int
    memory_mb: float
    cpu_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Spent:
    """Seconds by the clock, and of CPU."""

    clock_s: float
    cpu_s: float


def honest_pass(bag: Path) -> Spent:
    """What one pass takes, libraries loaded before."""
    from rosbags.highlevel import AnyReader

    R, p = np.linalg.qr(np.arange(9.0).reshape(3, 3) + np.eye(3))[0], np.array([0.1, 0.2, 0.3])
    started, cpu_s = time.perf_counter(), time.process_time()
    with AnyReader([bag]) as reader:
        clouds = [link for link in reader.connections if link.msgtype.endswith("PointCloud2")]
        for link, _, raw in reader.messages(connections=clouds):
            xyz, times = _columns(cast(_Cloud, reader.deserialize(raw, link.msgtype)))
            _ = xyz @ R.T + p
            _ = times.astype(np.float64)
    return Spent(time.perf_counter() - started, time.process_time() - cpu_s)


class _Field(Protocol):
    name: str
    offset: int
    datatype: int


class _Cloud(Protocol):
    """What a pass looks at in a PointCloud2."""

    fields: Sequence[_Field]
    data: NDArray[np.uint8]
    point_step: int


def _columns(cloud: _Cloud) -> tuple[NDArray[np.float64], NDArray[np.generic]]:
    """Points (N, 3) and the times of their own, whatever their name and unit are."""
    fields = {field.name: field for field in cloud.fields}
    time_name = next(name for name in _TIMES if name in fields)
    names = ["x", "y", "z", time_name]
    layout = np.dtype(
        {
            "names": names,
            "formats": [_FORMATS[fields[name].datatype] for name in names],
            "offsets": [fields[name].offset for name in names],
            "itemsize": cloud.point_step,
        }
    )
    points: NDArray[np.void] = np.frombuffer(cloud.data, layout)
    return np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64), points[time_name]


def cost_of(events: Iterable[tuple[float, str]], end_s: float, memory_mb: float) -> Cost:
    """Seconds of each stage.   events: when a line was heard [s after the start], and the line.

    Time belongs to the stage heard of last; before the first, the program was starting.
    """
    stages: dict[str, float] = defaultdict(float)
    stage, since_s, iterations = "start", 0.0, 0
    for at_s, line in events:
        stages[stage] += at_s - since_s
        since_s = at_s
        event = json.loads(line)
        stage = str(event["stage"]) if event["event"] == "stage" else stage
        iterations += event["event"] == "iteration"
    stages[stage] += end_s - since_s
    return Cost(dict(stages), end_s, iterations, memory_mb)


def run_command(words: Sequence[str], environment: Mapping[str, str] | None = None) -> Cost:
    """The cost of one run of the command line. Raises SystemExit where it fails.   environment: beside what there is."""
    started = time.monotonic()
    command = [sys.executable, "-m", "app.cli", *words, "--log-json"]
    around = os.environ | dict(environment or {})
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=around) as process:
        heard = [(time.monotonic() - started, line) for line in process.stderr or ()]
        _, status, used = os.wait4(process.pid, 0)
        end_s = time.monotonic() - started
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"unsweep {words[0]} ended with exit code {process.returncode}.")
    # What is asked of memory is said in units of ten.
    return replace(cost_of(heard, end_s, 1.024e-3 * used.ru_maxrss), cpu_s=used.ru_utime + used.ru_stime)


@dataclass(frozen=True, slots=True)
class Apart:
    """Seconds of what has no command of its own. load_s: of the library.   second_s: a solve with one plane less, when the first
    is kept.   slider_s: a scan drawn raw and straightened, as the page's slider comes to it.   scans: of the recording.
    """

    load_s: float
    second_s: float
    slider_s: float
    scans: int


def metrics_of(
    pass_s: float, apart: Apart, solve: Sequence[Cost], ideal: Sequence[Cost], inspect: Sequence[Cost], bag_mb: float
) -> list[Metric]:
    """The ratios, and the seconds of the pass to read them by. solve, ideal: default, and with ideal sensors."""
    stages = {name: min(cost.stages.get(name, 0.0) for cost in solve) for name in solve[0].stages}
    iteration_s = min(cost.stages.get("solve", 0.0) / max(cost.iterations, 1) for cost in solve)
    whole = [
        ("decode", apart.load_s / pass_s),
        ("iteration", iteration_s / pass_s),
        ("whole", min(cost.whole_s for cost in solve) / pass_s),
        ("whole_ideal", min(cost.whole_s for cost in ideal) / pass_s),
        ("second_solve", apart.second_s / pass_s),
        ("slider_over_scan", apart.slider_s / (pass_s / apart.scans)),
        ("inspect", min(cost.whole_s for cost in inspect) / pass_s),
    ]
    memory = min(cost.memory_mb for cost in solve) / bag_mb
    return [
        Metric(key=f"{NAME}.pass_s", value=pass_s, unit="s"),
        *(_ratio(f"stage_{name}", value_s / pass_s, STAGE_SLACK) for name, value_s in stages.items()),
        *(_ratio(name, value, CLOCK_SLACK) for name, value in whole),
        _ratio("memory_over_bag", memory, MEMORY_SLACK),
    ]


def _ratio(name: str, value: float, slack: float) -> Metric:
    least = _LEAST_PASSES if name.startswith("stage_") else 0.0
    return Metric(key=f"{NAME}.{name}", value=value, unit=RATIO, direction="lower", tolerance=slack, least=least)


def measure(duration_s: float = DURATION_S, turns: int = TURNS) -> list[Metric]:
    """Simulate a recording and measure: passes and runs take turns, so that both see the same machine."""
    with tempfile.TemporaryDirectory(prefix="unsweep-passes-") as folder:
        bag, result = Path(folder) / "room.bag", Path(folder) / "result.json"
        api.simulate(SCENARIO, bag, seed=0, duration_s=duration_s)
        honest_pass(bag)
        passes, loads, solve, ideal, inspect = [], [], [], [], []
        calibrate = ["calibrate", str(bag), "--output", str(result)]
        for _ in range(turns):
            passes.append(honest_pass(bag).clock_s)
            loads.append(_seconds(lambda: api.load(bag, fingerprint=False)))
            solve.append(run_command(calibrate))
            ideal.append(run_command([*calibrate, "--intrinsics", "off"]))
            inspect.append(run_command(["inspect", str(bag), "--json"]))
            passes.append(honest_pass(bag).clock_s)
        recording = api.load(bag, fingerprint=False)
        first, second_s = second_solve(recording, Path(folder) / "kept", turns, CalibrateSettings())
        apart = Apart(min(loads), second_s, _slider_s(recording, first), len(recording.scans))
        return metrics_of(min(passes), apart, solve, ideal, inspect, bag.stat().st_size / 1e6)


def second_solve(
    recording: Recording, cache_dir: Path, turns: int, settings: CalibrateSettings
) -> tuple[Calibration, float]:
    """The first solve, and the seconds of the quickest second one in the same process, without the last plane."""
    first = api.calibrate(recording, settings, cache_dir=cache_dir)
    fewer = [replace(patch.plane, suggested=True) for patch in api.propose_planes(recording).patches[:-1]]

    def again() -> None:
        done = api.calibrate(recording, settings, planes=fewer, cache_dir=cache_dir)
        if done.result.T_imu_lidar is None:
            raise SystemExit("The second solve was refused, which takes less time than an answer.")

    return first, min(_seconds(again) for _ in range(turns))


def _slider_s(recording: Recording, first: Calibration) -> float:
    """Seconds of a scan on the page, the quickest of some."""
    from app.scene.build import Solved, solved_stage
    from app.scene.inspect import Look, Motions, build_inspection

    if first.trajectory is None or first.result.T_imu_lidar is None:
        raise SystemExit(f"The {SCENARIO} of the passes was not calibrated.")
    planes = first.result.quality.planes
    T_imu_lidar = np.array(first.result.T_imu_lidar.matrix, dtype=np.float64)
    solved = Solved(first.trajectory, planes, list(range(len(planes))), T_imu_lidar)
    motions, stage = Motions(solved, first.trajectory, None), solved_stage(recording, solved)
    slid_s = []
    for place in range(0, len(recording.scans), max(1, len(recording.scans) // _SLID)):
        look = Look(place, "both", "raw", "scan", "plane", 0.5, _DRAWN, stage)
        slid_s.append(_seconds(partial(build_inspection, recording, look, motions, None)))
    return min(slid_s)


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started
