"""`python -m bench.pictures`: the pictures of docs/how-it-works.md, each from one simulated recording whose truth is known.

Six seconds of the paper's room at its fastest, a VLP-16 with a quarter of its columns: some seconds of work.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.lidar_motion import begin as follow_planes
from calib_core.full.initialise.lidar_motion import lidar_track
from calib_core.full.initialise.settings import LAGS
from calib_core.full.initialise.time_offset import GyroTurns, masked_correlation, turns_of
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.first_estimate import begin
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.solve import estimate_jointly
from calib_core.full.odometry.reference import Followed
from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.full.prepare.prepare import prepare
from calib_core.full.run import Run
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Truth, generate
from calib_core.simulate.motions import PAPER_FAST
from calib_core.simulate.patterns import Spinning
from calib_core.simulate.sensors import VLP_16

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "images"
_BLUE, _RED = "#0072b2", "#d55e00"


def main() -> int:
    """All of them."""
    FOLDER.mkdir(exist_ok=True)
    pattern = VLP_16.pattern
    assert isinstance(pattern, Spinning)
    lidar = replace(VLP_16, pattern=replace(pattern, column_period_ns=4 * pattern.column_period_ns))
    scenario = replace(SCENARIOS["paper-normal"], motion=PAPER_FAST, lidar=lidar, duration_s=6.0, time_offset_s=-0.0173)
    recording, truth = generate(scenario, seed=7)
    run = prepare(recording, CalibrateSettings(intrinsics="off"), ignore_event, never_cancel)
    _draw("planes", lambda axes: _planes(axes, run))
    followed = follow_planes(run, None)
    _draw("odometry", lambda axes: _odometry(axes, run, followed, truth))
    _draw("time-offset", lambda axes: _lags(axes, run, followed, truth))
    known = _states(run, followed)
    _draw("steps", lambda axes: _steps(axes, run, known, truth))
    return 0


def _draw(name: str, draw: Callable[[Axes], None]) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    draw(figure.subplots())
    figure.savefig(FOLDER / f"{name}.png", dpi=110, metadata={"Software": None})


def _planes(axes: Axes, run: Run) -> None:
    """The reference cloud from above, each plane's points in a colour of their own."""
    found = propose_planes(run.recording, run.settings)
    cloud, patch = found.cloud_m, found.cloud_patch
    axes.plot(*cloud[patch < 0, :2].T, ",", color="0.6")
    for j, each in enumerate(found.patches):
        axes.plot(*cloud[patch == j, :2].T, ",", color=f"C{j % 10}")
        axes.plot([], [], "s", color=f"C{j % 10}", label=f"{each.plane.name}, {each.area_m2:.0f} m2")
    axes.set_aspect("equal")
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.02, 0.5), frameon=False)
    axes.set_xlabel("x [m], map", fontsize=8)
    axes.set_ylabel("y [m], map", fontsize=8)


def _odometry(axes: Axes, run: Run, followed: Followed, truth: Truth) -> None:
    """How far each followed scan is from the truth."""
    at_s = run.clocks.scan_s[[m.position for m in followed.motions]]
    R, p = truth.map_lidar(at_s + (run.clocks.lidar_epoch_ns - truth.epoch_ns) * 1e-9)
    away_mm = [1e3 * float(np.linalg.norm(m.p - place)) for m, place in zip(followed.motions, p, strict=True)]
    turn_deg = [np.degrees(float(np.linalg.norm(log(S.T @ m.R)))) for m, S in zip(followed.motions, R, strict=True)]
    axes.plot(at_s - at_s[0], away_mm, ".-", color=_BLUE, label="place [mm]")
    axes.plot(at_s - at_s[0], 100 * np.array(turn_deg), ".-", color=_RED, label="turn [0.01 deg]")
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8, frameon=False)
    axes.set_xlabel("time of the scan [s]", fontsize=8)
    axes.set_ylabel("error of the odometry", fontsize=8)


def _lags(axes: Axes, run: Run, followed: Followed, truth: Truth) -> None:
    """How well sizes of turns go together at each lag."""
    turns, imu_s = turns_of(lidar_track(run, followed))[0], run.clocks.imu_s
    gyro = GyroTurns(imu_s, run.recording.imu.gyro_rad_s)
    lidar_t = np.arange(turns.start_s[0], turns.end_s[-1], 1 / LAGS.grid_hz)
    imu_t = np.arange(imu_s[0], imu_s[-1], 1 / LAGS.grid_hz)
    half = 0.5 * float(np.median(turns.end_s - turns.start_s))
    rate = np.linalg.norm(gyro.over(imu_t - half, imu_t + half), axis=1)
    valid = np.isfinite(rate)
    sizes = np.linalg.norm(turns.rate_rad_s, axis=1)
    lidar = np.interp(lidar_t, 0.5 * (turns.start_s + turns.end_s), sizes)
    found, _ = masked_correlation(lidar, np.where(valid, rate, 0.0), valid.astype(float))
    lag_s = turns.start_s[0] - imu_t[0] + (np.arange(len(found)) - (len(imu_t) - 1)) / LAGS.grid_hz
    near = np.abs(lag_s) < 2.0
    axes.plot(lag_s[near], found[near], color=_BLUE)
    axes.axvline(run.clocks.offset_s(truth.time_offset_ns), color=_RED, linewidth=1, label="true time offset")
    axes.legend(fontsize=8, frameon=False)
    axes.set_xlabel("lag [s]", fontsize=8)
    axes.set_ylabel("correlation of |turn|", fontsize=8)


def _states(run: Run, followed: Followed) -> list[tuple[str, Estimation]]:
    """What was known before each step, and at the end."""
    lidar, start = initialise(run, followed.motions, followed.planes, None)
    data, first, _ = begin(run, followed, lidar, start, None, FULL)
    known: list[tuple[str, Estimation]] = []
    solved = estimate_jointly(replace(data, on_state=lambda name, state: known.append((name, state))), first, FULL)
    return [*known, ("end", replace(known[-1][1], estimate=solved.estimate))]


def _steps(axes: Axes, run: Run, known: list[tuple[str, Estimation]], truth: Truth) -> None:
    """Errors of the calibration as it goes from step to step."""
    estimates = [state.estimate for _, state in known]
    turn_deg = [np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ e.R_imu_lidar))) for e in estimates]
    shift_mm = [1e3 * np.linalg.norm(e.p_imu_lidar - truth.p_imu_lidar) for e in estimates]
    late_ms = [1e3 * abs(e.time_offset_s - run.clocks.offset_s(truth.time_offset_ns)) for e in estimates]
    for values, label in ((turn_deg, "rotation [deg]"), (shift_mm, "lever arm [mm]"), (late_ms, "time offset [ms]")):
        axes.semilogy(range(len(known)), values, "o-", label=label)
    names = ["start values", *(f"after {name}" for name, _ in known[:-2]), "all points"]
    axes.set_xticks(range(len(known)), names, fontsize=7)
    axes.legend(fontsize=8, frameon=False)
    axes.set_ylabel("error", fontsize=8)


if __name__ == "__main__":
    sys.exit(main())
