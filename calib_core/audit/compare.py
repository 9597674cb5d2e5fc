"""Two extrinsics compared, axis by axis, in the calibration's own perturbation.

    r = Log(R_found' R_given)  [rad, lidar's axes]      t = p_given - p_found  [m, IMU's axes]      dt  [s]

Their covariance is the found one's alone: the given numbers are judged as they are in use, however well their file says they are
known. A difference shows when it is beyond both its limit and three sigmas; where three sigmas are beyond the limit, smaller
ones decide nothing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from calib_core.audit.limits import Limits
from calib_core.audit.pose import GivenExtrinsic, gained_s, instant_of, inverse
from calib_core.audit.report import AxisAudit, Verdict, in_si
from calib_core.geometry import log
from calib_core.result import AXIS_WORDS, COVARIANCE_ORDER, CalibrationResult
from calib_core.sigmas import std_text
from calib_core.types import FloatArray

#: What is told from nothing: one difference in 370 is beyond by chance.
SIGMAS = 3.0
_UNITS: tuple[Literal["deg", "mm", "ms"], ...] = ("deg", "deg", "deg", "mm", "mm", "mm", "ms")
_SCALES = np.array([180.0 / np.pi] * 3 + [1e3] * 4)
#: An inverse that lies nearer by as much is what was meant.
_INVERSE_TIMES_NEARER = 10.0


def carried(given: GivenExtrinsic, found: CalibrationResult) -> GivenExtrinsic:
    """What is given with its time offset as it is when the found one holds, where both are of one recording."""
    if given.time_offset_ns is None:
        return given
    gain_s, std_s = gained_s(given.instant, instant_of(found))
    covariance = given.covariance
    if covariance is not None:
        covariance = covariance + np.diag([0.0] * 6 + [std_s**2])
    return replace(given, time_offset_ns=given.time_offset_ns + round(1e9 * gain_s), covariance=covariance)


def offset_apart_s(first: CalibrationResult, second: CalibrationResult) -> float:
    """The second's time offset less the first's, both as they are when the second holds; 0 where either has none."""
    if first.time_offset_ns is None or second.time_offset_ns is None:
        return 0.0
    gain_s, _ = gained_s(instant_of(first), instant_of(second))
    return (second.time_offset_ns - first.time_offset_ns) * 1e-9 - gain_s


def axes_of(given: GivenExtrinsic, found: CalibrationResult, limits: Limits) -> list[AxisAudit]:
    """One for each axis; none where the recording gave no answer."""
    if found.T_imu_lidar is None or found.uncertainty is None or found.time_offset_ns is None:
        return []
    difference = _difference(given.T_imu_lidar, np.array(found.T_imu_lidar.matrix))
    offset_s = None if given.time_offset_ns is None else (given.time_offset_ns - found.time_offset_ns) * 1e-9
    stds = np.sqrt(np.diag(found.uncertainty.covariance)) * _SCALES
    values = [float(value) for value in difference * _SCALES[:6]]
    values_or_none = [*values, None if offset_s is None else offset_s * _SCALES[6]]
    return [
        _axis(k, value, float(std), limit)
        for k, (value, std, limit) in enumerate(zip(values_or_none, stds, limits.per_axis(), strict=True))
    ]


def _axis(k: int, value: float | None, std: float, limit: float | None) -> AxisAudit:
    reach = SIGMAS * std
    verdict: Verdict | None = None
    if value is not None and limit is not None:
        within: Verdict = "passed" if reach <= limit else "unknown"
        verdict = "failed" if abs(value) > max(limit, reach) else within
    return AxisAudit.model_validate(
        {
            "axis": COVARIANCE_ORDER[k],
            "unit": _UNITS[k],
            "difference": value,
            "difference_std": std,
            "limit": limit,
            "smallest_error": reach if limit is None else max(limit, reach),
            "verdict": verdict,
        }
    )


def verdict_of(axes: list[AxisAudit]) -> Verdict:
    """Failed where any axis is; passed where every judged one is."""
    verdicts = [axis.verdict for axis in axes if axis.verdict is not None]
    if "failed" in verdicts:
        return "failed"
    return "passed" if verdicts and "unknown" not in verdicts else "unknown"


def distances(given: GivenExtrinsic, found: CalibrationResult) -> tuple[float, float] | None:
    """Angle [deg] and distance [mm] between the two."""
    if found.T_imu_lidar is None:
        return None
    return _distances(given.T_imu_lidar, np.array(found.T_imu_lidar.matrix))


def hints(given: GivenExtrinsic, found: CalibrationResult) -> list[str]:
    """Slips that explain a difference: the other direction, the other sign of time."""
    if found.T_imu_lidar is None or found.time_offset_ns is None:
        return []
    said: list[str] = []
    right = np.array(found.T_imu_lidar.matrix)
    here, there = _distances(given.T_imu_lidar, right), _distances(inverse(given.T_imu_lidar), right)
    # A degree weighs as much as 20 mm: the limits' own proportion, roughly.
    if _INVERSE_TIMES_NEARER * (there[0] + there[1] / 20.0) < here[0] + here[1] / 20.0:
        said.append(
            f"The inverse of the given extrinsic is only {there[0]:.2f} deg and {there[1]:.1f} mm from what this recording says: "
            "the file seems to state T_lidar_imu where T_imu_lidar is expected; invert it."
        )
    if given.time_offset_ns is not None:
        off_ns, turned_ns = (abs(sign * given.time_offset_ns - found.time_offset_ns) for sign in (1, -1))
        if _INVERSE_TIMES_NEARER * turned_ns < off_ns and off_ns > 1e6:
            said.append(
                "The given time offset would fit with the other sign: here it is the number to ADD to IMU stamps, while some "
                "programs subtract it."
            )
    return said


def own_sigmas(given: GivenExtrinsic, limits: Limits) -> list[str]:
    """What the given file states of itself, where that is wider than a limit: a weak result's numbers are no surprise then."""
    if given.covariance is None:
        return []
    stds = np.sqrt(np.diag(given.covariance)) * _SCALES
    shares = [0.0 if limit is None else float(std) / limit for std, limit in zip(stds, limits.per_axis(), strict=True)]
    worst = int(np.argmax(shares))
    if shares[worst] <= 1.0:
        return []
    said = std_text(*in_si(float(stds[worst]), _UNITS[worst]))
    text = f"By the given file, its own {AXIS_WORDS[COVARIANCE_ORDER[worst]]} is known only to {said} (1 sigma)"
    return [f"{text}; this is not counted: its numbers are judged as they stand, by this recording's sigmas alone."]


def _distances(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    difference = _difference(one, other)
    return float(np.degrees(np.linalg.norm(difference[:3]))), float(1e3 * np.linalg.norm(difference[3:]))


def _difference(given: FloatArray, found: FloatArray) -> FloatArray:
    """(6,): r [rad] and t [m]."""
    turn = log((found[:3, :3].T @ given[:3, :3])[None])[0]
    return np.concatenate([turn, given[:3, 3] - found[:3, 3]])
