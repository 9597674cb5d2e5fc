"""An extrinsic that somebody has given, and what its readers share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.errors import InputError
from calib_core.geometry import rotation_meant
from calib_core.types import FloatArray

FORMS = (
    "a result of unsweep, a URDF, a FAST-LIO or LIO-SAM YAML, a matrix of 4 rows of 4 numbers, or x y z and a quaternion "
    "x y z w"
)


@dataclass(frozen=True, slots=True)
class Instant:
    """When a time offset holds: of the recording with this hash, at_s after its start; and how fast it grows from there."""

    sha256: str
    at_s: float
    rate_ppm: float


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


def unfit(reason: str) -> InputError:
    """What is said of a text that is no extrinsic."""
    return InputError(f"Expected {FORMS}, but {reason}; correct it.", code="extrinsic.unfit")


def transform_of(rotation: FloatArray, position_m: FloatArray) -> FloatArray:
    """(4, 4) of a matrix (3, 3) that is a rotation up to the digits it was written with, and a place (3,)."""
    if not (np.isfinite(rotation).all() and np.isfinite(position_m).all()):
        raise unfit("one of its numbers is too large for any program")
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
