"""Extrinsics in the settings of lidar-inertial odometry, wherever in the file's tree their keys stand.

FAST-LIO2, Point-LIO and FAST-LIVO2 hold T_imu_lidar and subtract their time parameter tau from IMU stamps, so that
time_offset = -tau. Point-LIO reads a parameter and does not use it. LIO-SAM holds T_lidar_imu, whatever its comment says
(its code turns accelerations into the lidar's axes with extrinsicRot), and has no time parameter.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from decimal import Decimal

import numpy as np

from calib_core.audit.pose import GivenExtrinsic, inverse, transform_of, unfit
from calib_core.types import FloatArray

#: Subtracted from the IMU's stamps by the programs that know them.
_TAU_KEYS = ("time_offset_lidar_to_imu", "imu_time_offset")


def from_yaml(text: str) -> GivenExtrinsic:
    """The extrinsic of FAST-LIO's or LIO-SAM's settings."""
    found = dict(_entries(_loaded(text)))
    if "extrinsic_T" in found:
        form, turn, place, back = "FAST-LIO's settings, T_imu_lidar", "extrinsic_R", "extrinsic_T", False
    else:
        form, turn, place, back = "LIO-SAM's settings, T_lidar_imu", "extrinsicRot", "extrinsicTrans", True
    matrix = transform_of(_numbers(found, turn, 9).reshape(3, 3), _numbers(found, place, 3))
    return GivenExtrinsic(inverse(matrix) if back else matrix, _time_offset_ns(found), form)


def _loaded(text: str) -> object:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    plain = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE)  # OpenCV's first line is none of YAML's
    try:
        return YAML(typ="safe", pure=True).load(plain)
    except YAMLError as error:
        raise unfit(f"this YAML cannot be read ({str(error).splitlines()[0]})") from error


def _entries(tree: object) -> Iterator[tuple[str, object]]:
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield str(key).rpartition("/")[2], value
            yield from _entries(value)


def _numbers(found: dict[str, object], key: str, count: int) -> FloatArray:
    values = found.get(key)
    if not isinstance(values, list) or len(values) != count or not all(_is_number(value) for value in values):
        raise unfit(f"{key} is not a list of {count} numbers")
    return np.array([float(value) for value in values], dtype=np.float64)


def _time_offset_ns(found: dict[str, object]) -> int | None:
    for key in _TAU_KEYS:
        tau_s = found.get(key)
        if isinstance(tau_s, int | float) and _is_number(tau_s):
            return -int((Decimal(repr(tau_s)) * 1_000_000_000).to_integral_value())
    return None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
