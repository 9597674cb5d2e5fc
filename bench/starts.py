"""From any start the same answer: random mountings, lever arms and offsets, each solved twice.

Once without any guess, once from the truth. Both must end at the same cost, and the first within 5 of its own sigmas.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.campaign import spread
from bench.runs import PARAMETERS, FloatArray, compare, difference
from bench.store import RESULTS
from bench.tables import append_row, read_rows
from calib_core.simulate import Mounting

STARTS = "starts.csv"
KINDS = ("any", "minutes", "epochs")
_STREAM = 7_301
#: Clocks minutes apart; and clocks that count from different days (an IMU that counts from its power-up).
MINUTES_S = (75.3, -214.9, 341.7, -598.2)
EPOCHS_S = (1_599_999_000.25, 86_400.5, -31_536_000.75, 1_234_567_890.125)


@dataclass(frozen=True, slots=True)
class StartTask:
    """One recording to solve twice."""

    scenario: str
    seed: int
    kind: str
    label: str

    @property
    def key(self) -> tuple[str, int, str, str]:
        """What makes it the same row."""
        return self.scenario, self.seed, self.kind, self.label


@dataclass(frozen=True, slots=True)
class StartRun:
    """How both solves ended.

    turn_deg, lever_m, offset_s: of the mounting drawn.   errors, stds: (7,).   worst_sigmas: the largest |error| / std.
    cost, cost_from_truth: at the ends; NaN where nothing was solved.   apart_sigmas: the largest difference of the two
    answers over std.   cpu_s: of the solve without a guess.
    """

    scenario: str
    seed: int
    kind: str
    label: str
    turn_deg: float
    lever_m: float
    offset_s: float
    status: str
    status_from_truth: str
    code: str
    errors: tuple[float, ...]
    stds: tuple[float, ...]
    worst_sigmas: float
    cost: float
    cost_from_truth: float
    apart_sigmas: float
    cpu_s: float

    @property
    def key(self) -> tuple[str, int, str, str]:
        """What makes it the same row."""
        return self.scenario, self.seed, self.kind, self.label

    @property
    def cost_excess(self) -> float:
        """Relative to the start from the truth; positive: worse. NaN where one was not solved."""
        return self.cost / self.cost_from_truth - 1.0


def drawn(seed: int, kind: str) -> tuple[Mounting, float]:
    """A mounting from all of SO(3) with a lever arm to 1 m, and a time offset [s]."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng([_STREAM, seed])
    qx, qy, qz, qw = (float(q) for q in Rotation.random(rng=rng).as_quat())
    lever = rng.standard_normal(3)
    lever *= rng.uniform() / np.linalg.norm(lever)
    x, y, z = (float(v) for v in lever)
    offset_s = float(rng.uniform(-0.5, 0.5))
    if kind == "minutes":
        offset_s += MINUTES_S[seed % len(MINUTES_S)]
    elif kind == "epochs":
        offset_s += EPOCHS_S[seed % len(EPOCHS_S)]
    return (x, y, z, qx, qy, qz, qw), offset_s


def solve_start(task: StartTask) -> StartRun:
    """Simulate, solve without and with the truth as a guess; runs in a process of its own."""
    from calib_core import api
    from calib_core.events import IterationEvent
    from calib_core.simulate import generate
    from calib_core.types import InitialGuess

    mounting, offset_s = drawn(task.seed, task.kind)
    recording, truth = generate(task.scenario, seed=task.seed, mounting=mounting, time_offset_s=offset_s)
    costs = [np.nan, np.nan]
    ends = []
    cpu_s = 0.0
    for number, guess in enumerate((None, InitialGuess(truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns))):

        def listen(event: object, number: int = number) -> None:
            if isinstance(event, IterationEvent):
                costs[number] = event.cost

        started = time.process_time()
        ends.append(api.calibrate(recording, initial_guess=guess, on_event=listen).result)
        if guess is None:
            cpu_s = time.process_time() - started
    result, from_truth = ends
    errors, stds, _ = compare(result, truth)
    apart = np.full(7, np.nan)
    if from_truth.T_imu_lidar is not None and from_truth.time_offset_ns is not None:
        apart = difference(result, np.array(from_truth.T_imu_lidar.matrix), from_truth.time_offset_ns)
    wrong = [message.code for message in result.messages if message.level == "error"]
    R = truth.R_imu_lidar
    return StartRun(
        scenario=task.scenario,
        seed=task.seed,
        kind=task.kind,
        label=task.label,
        turn_deg=float(np.degrees(np.arccos(np.clip((np.trace(R) - 1.0) / 2.0, -1.0, 1.0)))),
        lever_m=float(np.linalg.norm(truth.p_imu_lidar)),
        offset_s=offset_s,
        status=result.status,
        status_from_truth=from_truth.status,
        code=wrong[0] if wrong else "",
        errors=errors,
        stds=stds,
        worst_sigmas=_worst(np.array(errors), np.array(stds)),
        cost=costs[0],
        cost_from_truth=costs[1],
        apart_sigmas=_worst(apart, np.array(stds)),
        cpu_s=cpu_s,
    )


def _worst(values: FloatArray, stds: FloatArray) -> float:
    return float(np.max(np.abs(values) / stds))


def campaign(
    seeds: Sequence[int],
    *,
    scenario: str,
    kinds: Sequence[str],
    jobs: int,
    label: str,
    folder: Path = RESULTS,
    scheduler: str | None = None,
) -> None:
    """Everything that is not in starts.csv yet."""
    done = {run.key for run in read_starts(folder)}
    tasks = [StartTask(scenario, seed, kind, label) for kind in kinds for seed in seeds]
    tasks = [task for task in tasks if task.key not in done]
    for number, run in enumerate(spread(solve_start, tasks, jobs, scheduler), start=1):
        append_row(folder / STARTS, run, PARAMETERS)
        sys.stderr.write(
            f"{number} of {len(tasks)}: {run.kind} seed {run.seed}, {run.turn_deg:.0f} deg, {run.lever_m:.2f} m, "
            f"{run.offset_s:.3f} s: {run.status} {run.code} worst {run.worst_sigmas:.1f} sigmas, "
            f"cost {run.cost:.1f} ({run.cost_excess:+.1e}), {run.apart_sigmas:.1e} sigmas from the other\n"
        )


def read_starts(folder: Path = RESULTS) -> list[StartRun]:
    """All rows, in the file's order."""
    return list(read_rows(folder / STARTS, StartRun, PARAMETERS))
