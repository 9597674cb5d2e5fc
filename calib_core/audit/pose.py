"""An extrinsic that somebody has given, and what its readers share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calib_core.errors import InputError
from calib_core.geometry import rotation_meant
from calib_core.result import CalibrationResult
from calib_core.settings import FARTHEST_M
from calib_core.types import FloatArray

FORMS = (
    "a result of unsweep, a URDF, a FAST-LIO or LIO-SAM YAML, a matrix of 4 rows of 4 numbers, or x y z and a quaternion "
    "x y z w"
)


@dataclass(frozen=True, slots=True)
class Instant:
    """When a time offset holds: of the recording with this hash, at_s after its start; and how fast it grows from there.

    rate_ppm, rate_std_ppm: None where nobody has said.
    """

    sha256: str
    at_s: float
    rate_ppm: float | None
    rate_std_ppm: float | None


@dataclass(frozen=True, slots=True)
class GivenExtrinsic:
    """T_imu_lidar: (4, 4).   time_offset_ns: added to IMU stamps; None where the file has none.

    form: what it was read as.   covariance: (7, 7) of a result, in the contract's order and units; None where unknown.
    instant: of a result's time offset; None where nobody knows.
    """

    T_imu_lidar: FloatArray
    time_offset_ns: int | None
    form: str
    covariance: FloatArray | None = None
    instant: Instant | None = None


def instant_of(result: CalibrationResult) -> Instant | None:
    """When a result's time offset holds; None where it does not tell."""
    sha256, at_s = result.provenance.recording.sha256, result.time_offset_at_s
    return None if at_s is None else Instant(sha256, at_s, result.clock_rate_ppm, result.clock_rate_ppm_std)


def gained_s(since: Instant | None, until: Instant | None) -> tuple[float, float]:
    """What a time offset gains from one instant to another of the same recording, and its standard deviation [s].

    Clocks that run apart by 50 ppm are 3 ms further apart after a minute: what was found of the whole differs from what a part of
    it says, and neither is wrong. Both tell the rate of the same clocks, and who knows it best is believed. Of another recording
    nobody knows since when they have.
    """
    if since is None or until is None or not since.sha256 or since.sha256 != until.sha256:
        return 0.0, 0.0
    known = [one for one in (since, until) if one.rate_ppm is not None]
    if not known:
        return 0.0, 0.0
    best = min(known, key=lambda one: math.inf if one.rate_std_ppm is None else one.rate_std_ppm)
    apart_s = until.at_s - since.at_s
    return 1e-6 * (best.rate_ppm or 0.0) * apart_s, 1e-6 * (best.rate_std_ppm or 0.0) * abs(apart_s)


def unfit(reason: str) -> InputError:
    """What is said of a text that is no extrinsic."""
    return InputError(f"Expected {FORMS}, but {reason}; correct it.", code="extrinsic.unfit")


def transform_of(rotation: FloatArray, position_m: FloatArray) -> FloatArray:
    """(4, 4) of a matrix (3, 3) that is a rotation up to the digits it was written with, and a place (3,)."""
    if not (np.isfinite(rotation).all() and np.isfinite(position_m).all()):
        raise unfit("one of its numbers is too large for any program")
    if np.abs(position_m).max() > FARTHEST_M:
        raise unfit(f"its translation is beyond {FARTHEST_M:.0e} m")
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = _rotation(rotation), position_m
    return matrix


def inverse(matrix: FloatArray) -> FloatArray:
    """(4, 4): the same mounting in the other direction."""
    back = np.eye(4)
    back[:3, :3] = matrix[:3, :3].T
    back[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return back


def _rotation(matrix: FloatArray) -> FloatArray:
    rotation = rotation_meant(matrix)
    if rotation is None:
        raise unfit("the matrix's columns are not orthonormal and right-handed")
    return rotation
