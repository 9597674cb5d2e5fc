"""What can be measured: one entry for each workload, found by its name.

A workload simulates recordings with listed seeds, solves them, and compares with the truth. e_R and e_p are the norms
of the paper's eq. 15; their root mean square over the runs is what is shown.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from bench.metrics import RATIO, Metric

FloatArray = NDArray[np.float64]

#: Rotation 3, translation 3, time offset 1.
NEES_FREEDOM = 7


@dataclass(frozen=True, slots=True)
class Run:
    """One simulated recording solved.

    error_rad: (3,) Log(R_true^T R_est), lidar axes.   error_m: (3,) IMU axes.   covariance: (7, 7), result's order.
    """

    seed: int
    status: str
    error_rad: FloatArray
    error_m: FloatArray
    error_s: float
    covariance: FloatArray
    solve_s: float
    kernel_s: float

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of the 7 parameters; chi-square with 7 degrees of freedom if honest."""
        error = np.concatenate([self.error_rad, self.error_m, [self.error_s]])
        return float(error @ np.linalg.solve(self.covariance, error))


@dataclass(frozen=True, slots=True)
class Workload:
    """A scenario solved with many seeds."""

    name: str
    scenario: str
    text: str
    seeds: tuple[int, ...] = field(default=tuple(range(1, 11)))
    method: str = "full"
    is_gated: bool = True


def solve_once(workload: Workload, seed: int) -> Run:
    """Simulate and solve; runs in a process of its own."""
    from scipy.spatial.transform import Rotation

    from calib_core import api
    from calib_core.settings import CalibrateSettings
    from calib_core.simulate import generate

    recording, truth = generate(workload.scenario, seed=seed)
    started = time.perf_counter()
    options: dict[str, object] = {"method": workload.method}
    if workload.method == "paper":
        options |= {"points_per_plane_per_scan": 100, "field_of_view_deg": 45.0}
    result = api.calibrate(recording, CalibrateSettings.model_validate(options)).result
    solve_s = time.perf_counter() - started
    if result.T_imu_lidar is None or result.time_offset_ns is None or result.uncertainty is None:
        unknown = np.full(3, np.nan)
        return Run(seed, result.status, unknown, unknown, np.nan, np.eye(7), solve_s, reference_kernel_s())
    T = np.array(result.T_imu_lidar.matrix)
    return Run(
        seed=seed,
        status=result.status,
        error_rad=Rotation.from_matrix(truth.R_imu_lidar.T @ T[:3, :3]).as_rotvec(),
        error_m=T[:3, 3] - truth.p_imu_lidar,
        error_s=(result.time_offset_ns - truth.time_offset_ns) * 1e-9,
        covariance=np.array(result.uncertainty.covariance),
        solve_s=solve_s,
        kernel_s=reference_kernel_s(),
    )


def reference_kernel_s() -> float:
    """Seconds this machine, as busy as it is, takes for a fixed piece of the same kind of work: the unit of speed."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((200_000, 28))
    started = time.perf_counter()
    for _ in range(5):
        np.einsum("ni,nj->ij", rows, rows, optimize=True)
        np.sqrt(np.abs(rows)).sum()
    return time.perf_counter() - started


def runs_of(workload: Workload, n_processes: int) -> Iterator[Run]:
    """All runs of a workload, in the order of its seeds."""
    if n_processes == 1:
        yield from (solve_once(workload, seed) for seed in workload.seeds)
        return
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with ProcessPoolExecutor(n_processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(solve_once, [workload] * len(workload.seeds), workload.seeds)


def metrics_of(workload: Workload, runs: list[Run]) -> list[Metric]:
    """What the runs amount to."""
    solved = [run for run in runs if np.isfinite(run.error_s)]
    if not solved:
        return [Metric(key=f"{workload.name}.solved", value=0.0, unit=RATIO, direction="higher", tolerance=0.0)]
    e_R_deg = rms([float(np.rad2deg(np.linalg.norm(run.error_rad))) for run in solved])
    e_p_m = rms([float(np.linalg.norm(run.error_m)) for run in solved])
    e_dt_s = rms([run.error_s for run in solved])
    predicted = np.mean([np.diag(run.covariance) for run in solved], axis=0)
    sigma_R_deg = float(np.rad2deg(np.sqrt(predicted[:3].sum())))
    sigma_p_m, sigma_dt_s = float(np.sqrt(predicted[3:6].sum())), float(np.sqrt(predicted[6]))
    # The spread of a root mean square over n runs of about 3 components; the gate is no sharper than that.
    slack = 3.0 / np.sqrt(6.0 * len(solved))
    shown = [
        ("e_R_rms_deg", e_R_deg, "deg"),
        ("e_p_rms_mm", 1e3 * e_p_m, "mm"),
        ("e_dt_rms_ms", 1e3 * e_dt_s, "ms"),
        ("sigma_R_deg", sigma_R_deg, "deg"),
        ("sigma_p_mm", 1e3 * sigma_p_m, "mm"),
        ("sigma_dt_ms", 1e3 * sigma_dt_s, "ms"),
        ("solve_median_s", float(np.median([run.solve_s for run in solved])), "s"),
        ("runs", float(len(runs)), ""),
    ]
    judged = [
        ("solved", len(solved) / len(runs), "higher", 0.0),
        ("e_R_over_sigma", e_R_deg / sigma_R_deg, "near-one", slack),
        ("e_p_over_sigma", e_p_m / sigma_p_m, "near-one", slack),
        ("e_dt_over_sigma", e_dt_s / sigma_dt_s, "near-one", slack),
        ("nees_over_freedom", float(np.mean([run.nees for run in solved])) / NEES_FREEDOM, "near-one", slack),
        ("time_over_kernel", float(np.median([run.solve_s / run.kernel_s for run in solved])), "lower", 0.5),
    ]
    metrics = [Metric(key=f"{workload.name}.{key}", value=value, unit=unit) for key, value, unit in shown]
    metrics += [
        Metric.model_validate(
            {"key": f"{workload.name}.{key}", "value": value, "unit": RATIO, "direction": way, "tolerance": tolerance}
        )
        for key, value, way, tolerance in judged
    ]
    return metrics


def rms(values: list[float]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


WORKLOADS: dict[str, Workload] = {
    workload.name: workload
    for workload in (
        Workload("paper-normal", "paper-normal", "The paper's simulation, normal motion."),
        Workload("paper-fast", "paper-fast", "The paper's simulation, fast motion.", is_gated=False),
        Workload(
            "paper-normal-paper", "paper-normal", "The same by the published algorithm.", method="paper", is_gated=False
        ),
        Workload(
            "paper-fast-paper", "paper-fast", "Fast motion by the published algorithm.", method="paper", is_gated=False
        ),
        Workload("handheld", "handheld", "A minute carried by hand.", seeds=(1, 2, 3), is_gated=False),
    )
}
