"""Campaigns on sensors as they are: `python -m bench monte-carlo SCENARIO... --faults FAULTS`.

Each run has a row in fault_runs.csv, and one in fault_parameters.csv for each parameter of a sensor that the result states.
Random numbers are those of the scenario and its faults alone, so that no two campaigns share any.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter

from bench.campaign import spread
from bench.runs import PARAMETERS, difference
from bench.store import RESULTS
from bench.tables import append_row, read_rows
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth, generate, parse_faults
from calib_core.simulate.scenarios import named

FAULT_RUNS, FAULT_PARAMETERS = "fault_runs.csv", "fault_parameters.csv"
#: What was measured before sensors' own errors were looked for, each with its scenario: `python -m bench fault-table`.
TABLE = (
    ("handheld", "none"),
    ("handheld", "laser-offsets=8mm"),
    ("handheld", "laser-angles=0.05deg"),
    # As large as in OA-LICalib's published VLP-16.
    ("paper-normal", "laser-offsets=10mm,laser-elevation=0.1deg,laser-scale=0.3%"),
    ("paper-fast", "laser-offsets=10mm,laser-elevation=0.1deg,laser-scale=0.3%"),
    ("paper-normal", "accel-scale=0.5%"),
    ("livox", "gyro-scale=0.5%"),
    ("handheld", "imu-axes=0.3deg"),
    ("paper-normal", "gyro-rotation=0.2deg"),
    ("handheld", "accel-delay=2.5ms,low-pass=40"),
    ("handheld", "clock-rate=40"),
    ("paper-normal", "clock-rate=58"),
    ("handheld", "bent-walls=4mm"),
    ("handheld", "bent-walls=5mm,glass,door-ajar,skirting"),
    ("handheld", "stamp-latency"),
    ("handheld", "stamp-bundles"),
    ("handheld", "imu-repeats"),
    ("handheld", "scan-latency"),
    ("handheld", "vibration=0.5"),
    ("no-static-start", "vibration=3"),
    ("handheld", "industrial"),
    ("handheld", "industrial,bent-walls=3mm,incidence"),
    ("handheld", "consumer"),
)
#: The word for ideal sensors where faults are asked for.
NONE = "none"


@dataclass(frozen=True, slots=True)
class Campaign:
    """What all runs of a campaign share. settings: of the solve, `name=value` with commas between; empty: the defaults."""

    scenario: str
    faults: str
    duration_s: float
    settings: str
    label: str


@dataclass(frozen=True, slots=True)
class FaultRun:
    """One run. errors, stds: (7,), NaN where there is no answer.   nees: of the seven."""

    scenario: str
    faults: str
    duration_s: float
    settings: str
    label: str
    seed: int
    status: str
    code: str
    errors: tuple[float, ...]
    stds: tuple[float, ...]
    nees: float
    solve_s: float

    @property
    def campaign(self) -> Campaign:
        """The one it belongs to."""
        return Campaign(self.scenario, self.faults, self.duration_s, self.settings, self.label)

    @property
    def is_solved(self) -> bool:
        """Whether there is an answer to compare."""
        return bool(np.isfinite(self.nees))


@dataclass(frozen=True, slots=True)
class FaultParameter:
    """One parameter of a sensor in one run: what it was, what was found."""

    scenario: str
    faults: str
    duration_s: float
    settings: str
    label: str
    seed: int
    block: str
    name: str
    state: str
    truth: float
    value: float
    std: float
    prior_std: float


class Stated(BaseModel):
    """A parameter as the result document has it."""

    model_config = ConfigDict(extra="ignore")
    block: str
    name: str
    value: float
    std: float
    prior_std: float
    state: str


def monte_carlo(
    campaigns: Sequence[Campaign],
    seeds: Sequence[int],
    *,
    jobs: int,
    folder: Path = RESULTS,
    scheduler: str | None = None,
) -> None:
    """Every campaign with every seed, appended to the two tables; what is there is not run again."""
    done = {(run.campaign, run.seed) for run in read_fault_runs(folder)}
    tasks = [(each, seed) for seed in seeds for each in campaigns if (each, seed) not in done]
    for number, (run, parameters) in enumerate(spread(_solve, tasks, jobs, scheduler), start=1):
        for parameter in parameters:
            append_row(folder / FAULT_PARAMETERS, parameter, ())
        append_row(folder / FAULT_RUNS, run, PARAMETERS)
        e = np.array(run.errors)
        sys.stderr.write(
            f"{number} of {len(tasks)}: {run.scenario} {run.faults} seed {run.seed}: {run.status} {run.code} "
            f"{np.degrees(np.linalg.norm(e[:3])):.4f} deg {1e3 * np.linalg.norm(e[3:6]):.3f} mm {1e3 * e[6]:.4f} ms "
            f"NEES {run.nees:.1f}, {len(parameters)} parameters in {run.solve_s:.0f} s\n"
        )


def read_fault_runs(folder: Path = RESULTS) -> list[FaultRun]:
    """All runs, in the table's order."""
    return list(read_rows(folder / FAULT_RUNS, FaultRun, PARAMETERS))


def read_fault_parameters(folder: Path = RESULTS) -> list[FaultParameter]:
    """All parameters, in the table's order."""
    return list(read_rows(folder / FAULT_PARAMETERS, FaultParameter, ()))


def settings_from(text: str) -> CalibrateSettings:
    """Settings of a solve from `name=value,name=value`."""
    pairs = (word.split("=", 1) for word in text.split(",") if word)
    return CalibrateSettings.model_validate(dict(pairs))


def _solve(task: tuple[Campaign, int]) -> tuple[FaultRun, list[FaultParameter]]:
    from calib_core import api

    campaign, seed = task
    recording, truth = generate(
        named(campaign.scenario),
        seed=seed,
        duration_s=campaign.duration_s,
        faults=() if campaign.faults == NONE else parse_faults(campaign.faults),
        salt=f"{campaign.scenario} {campaign.faults}",
    )
    started = time.perf_counter()
    try:
        result = api.calibrate(recording, settings_from(campaign.settings)).result
    except Exception as error:  # noqa: BLE001  a campaign counts it as a failure of this seed and goes on
        return _without_answer(campaign, seed, "crashed", type(error).__name__, time.perf_counter() - started), []
    solve_s = time.perf_counter() - started
    return run_of(campaign, seed, result, truth, solve_s), parameters_of(campaign, seed, result, truth)


def _without_answer(campaign: Campaign, seed: int, status: str, code: str, solve_s: float) -> FaultRun:
    unknown = (np.nan,) * len(PARAMETERS)
    return _run(campaign, seed, status, code, unknown, unknown, np.nan, solve_s)


def _run(
    of: Campaign,
    seed: int,
    status: str,
    code: str,
    errors: tuple[float, ...],
    stds: tuple[float, ...],
    nees: float,
    solve_s: float,
) -> FaultRun:
    return FaultRun(
        of.scenario, of.faults, of.duration_s, of.settings, of.label, seed, status, code, errors, stds, nees, solve_s
    )


def run_of(campaign: Campaign, seed: int, result: CalibrationResult, truth: Truth, solve_s: float) -> FaultRun:
    """The seven held against the truth; the time offset at the instant that the result names, else in the middle."""
    wrong = [message.code for message in result.messages if message.level == "error"]
    code = wrong[0] if wrong else ""
    if result.T_imu_lidar is None or result.uncertainty is None:
        return _without_answer(campaign, seed, result.status, code, solve_s)
    at_s = json.loads(result.to_json()).get("time_offset_at_s")
    offset_ns = truth.time_offset_ns if at_s is None else truth.time_offset_ns_at(float(at_s))
    errors = difference(result, truth.T_imu_lidar, offset_ns)
    covariance = np.array(result.uncertainty.covariance)
    return _run(
        campaign,
        seed,
        result.status,
        code,
        tuple(errors.tolist()),
        tuple(np.sqrt(np.diag(covariance)).tolist()),
        float(errors @ np.linalg.solve(covariance, errors)),
        solve_s,
    )


def parameters_of(campaign: Campaign, seed: int, result: CalibrationResult, truth: Truth) -> list[FaultParameter]:
    """What the result states of the sensors beside what they are; nothing where it states nothing."""
    stated = json.loads(result.to_json()).get("intrinsics") or []
    real = {(each.block, each.name): each.value for each in truth.intrinsics}
    return [
        FaultParameter(
            campaign.scenario,
            campaign.faults,
            campaign.duration_s,
            campaign.settings,
            campaign.label,
            seed,
            each.block,
            each.name,
            each.state,
            real.get((each.block, each.name), 0.0),
            each.value,
            each.std,
            each.prior_std,
        )
        for each in TypeAdapter(list[Stated]).validate_python(stated)
    ]
