"""One simulated recording solved and compared with the truth: what every workload and campaign is made of."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_core.result import COVARIANCE_ORDER, CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth

FloatArray = NDArray[np.float64]

#: The calibration's parameters in the contract's order: turns about the lidar's axes [rad], shifts along the IMU's [m],
#: time offset [s].
PARAMETERS = COVARIANCE_ORDER


@dataclass(frozen=True, slots=True)
class Run:
    """One line of a campaign's table.

    label: which version of the program ran.   errors, stds: (7,) estimate minus truth and the stated sigma, NaN where
    refused.   nees: error^T covariance^-1 error; chi-square with 7 degrees of freedom if the covariance is honest.
    code: of the first error message, else empty.   cpu_s: of all threads.   kernel_s: of the reference kernel.
    """

    scenario: str
    seed: int
    label: str
    method: str
    status: str
    code: str
    errors: tuple[float, ...]
    stds: tuple[float, ...]
    nees: float
    scans_used: int
    scans_total: int
    points: int
    solve_s: float
    cpu_s: float
    kernel_s: float

    @property
    def is_solved(self) -> bool:
        """Whether there is an answer to compare."""
        return bool(np.isfinite(self.nees))

    @property
    def e_R_deg(self) -> float:
        """Norm of eq. (15), rotation."""
        return float(np.degrees(np.linalg.norm(self.errors[:3])))

    @property
    def e_p_mm(self) -> float:
        """Norm of eq. (15), translation."""
        return float(1e3 * np.linalg.norm(self.errors[3:6]))

    @property
    def e_dt_ms(self) -> float:
        """Of the time offset, signed."""
        return 1e3 * self.errors[6]


def solve_once(scenario: str, seed: int, *, method: str = "full", label: str = "", salt: str = "") -> Run:
    """Simulate and solve in memory; runs in a process of its own. salt: sets its random numbers apart."""
    from calib_core import api
    from calib_core.simulate import generate

    recording, truth = generate(scenario, seed=seed, salt=salt)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        result = api.calibrate(recording, settings_of(method)).result
    except Exception as error:  # noqa: BLE001  a campaign counts it as a failure of this seed and goes on
        return _crashed(scenario, seed, label, method, error)
    solve_s, cpu_s = time.perf_counter() - wall, time.process_time() - cpu
    return run_of(result, truth, scenario=scenario, seed=seed, label=label, method=method, solve_s=solve_s, cpu_s=cpu_s)


def _crashed(scenario: str, seed: int, label: str, method: str, error: Exception) -> Run:
    unknown = (np.nan,) * len(PARAMETERS)
    return Run(
        scenario, seed, label, method, "crashed", type(error).__name__, unknown, unknown, np.nan, 0, 0, 0, 0.0, 0.0, 1.0
    )


def settings_of(method: str) -> CalibrateSettings:
    """Of a method, for the ideal sensors that scenarios have; the published one with the paper's own cap and field of view.

    Runs are held against the bound for ideal sensors: what the sensors' own parameters cost is the campaigns' with faults.
    """
    if method == "paper":
        return CalibrateSettings(method="paper", points_per_plane_per_scan=100, field_of_view_deg=45.0)
    return CalibrateSettings(intrinsics="off")


def run_of(
    result: CalibrationResult,
    truth: Truth,
    *,
    scenario: str,
    seed: int,
    label: str,
    method: str,
    solve_s: float,
    cpu_s: float,
) -> Run:
    """The result held against the truth."""
    errors, stds, nees = compare(result, truth)
    wrong = [message.code for message in result.messages if message.level == "error"]
    return Run(
        scenario=scenario,
        seed=seed,
        label=label,
        method=method,
        status=result.status,
        code=wrong[0] if wrong else "",
        errors=errors,
        stds=stds,
        nees=nees,
        scans_used=result.quality.scans_used,
        scans_total=result.quality.scans_total,
        points=result.quality.points_used,
        solve_s=solve_s,
        cpu_s=cpu_s,
        kernel_s=reference_kernel_s(),
    )


def compare(result: CalibrationResult, truth: Truth) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """Errors (7,), stated sigmas (7,) and NEES; NaN where there is no answer."""
    if result.T_imu_lidar is None or result.time_offset_ns is None or result.uncertainty is None:
        return (np.nan,) * 7, (np.nan,) * 7, np.nan
    errors = difference(result, truth.T_imu_lidar, truth.time_offset_ns)
    covariance = np.array(result.uncertainty.covariance)
    stds = np.sqrt(np.diag(covariance))
    return tuple(errors.tolist()), tuple(stds.tolist()), float(errors @ np.linalg.solve(covariance, errors))


def difference(result: CalibrationResult, T_imu_lidar: FloatArray, time_offset_ns: int) -> FloatArray:
    """(7,) the result minus a reference: Log(R_ref^T R) [rad], translation [m], offset [s]. T_imu_lidar: (4, 4)."""
    from scipy.spatial.transform import Rotation

    if result.T_imu_lidar is None or result.time_offset_ns is None:
        return np.full(7, np.nan)
    T = np.array(result.T_imu_lidar.matrix)
    turn = Rotation.from_matrix(T_imu_lidar[:3, :3].T @ T[:3, :3]).as_rotvec()
    offset_s = (result.time_offset_ns - time_offset_ns) * 1e-9
    return np.concatenate([turn, T[:3, 3] - T_imu_lidar[:3, 3], [offset_s]])


def reference_kernel_s() -> float:
    """Seconds this machine, as busy as it is, takes for a fixed piece of the same kind of work: the unit of speed."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((200_000, 28))
    started = time.perf_counter()
    for _ in range(5):
        np.einsum("ni,nj->ij", rows, rows, optimize=True)
        np.sqrt(np.abs(rows)).sum()
    return time.perf_counter() - started


def rms(values: Sequence[float]) -> float:
    """Root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
