"""Extrinsics in the settings of lidar-inertial odometry, wherever in the file's tree their keys stand.

FAST-LIO2, Point-LIO and FAST-LIVO2 hold T_imu_lidar and subtract their time parameter tau from IMU stamps, so that
time_offset = -tau. FAST-LIVO2 may add a second one, lidar_time_offset, to the lidar's stamps, which is as if it were subtracted
from the IMU's, so that time_offset = -(imu_time_offset + lidar_time_offset). It adds it to PointCloud2 alone, not to Livox's own
messages (lidar_type 1). Point-LIO reads a parameter and does not use it. LIO-SAM holds T_lidar_imu, whatever its comment says
(its code turns accelerations into the lidar's axes with extrinsicRot), and has no time parameter.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from decimal import Decimal

import numpy as np

from calib_core.audit.pose import GivenExtrinsic, inverse, transform_of, unfit
from calib_core.contradictions import poses_apart
from calib_core.settings import FARTHEST_S
from calib_core.types import FloatArray

#: Subtracted from the IMU's stamps by the programs that know them.
_TAU_KEYS = ("time_offset_lidar_to_imu", "imu_time_offset")
#: Added to the lidar's stamps, but those of this type of lidar.
_LIDAR_TAU_KEY = "lidar_time_offset"
_LIVOX_MESSAGES = 1

_FAST_LIO = "FAST-LIO's settings, T_imu_lidar"
_LIO_SAM = "LIO-SAM's settings, T_lidar_imu"


def from_yaml(text: str) -> GivenExtrinsic:
    """The extrinsic of FAST-LIO's or LIO-SAM's settings."""
    found = _Found(_loaded(text))
    poses: dict[str, FloatArray] = {}
    if "extrinsic_T" in found:
        poses[_FAST_LIO] = transform_of(found.numbers("extrinsic_R", 9).reshape(3, 3), found.numbers("extrinsic_T", 3))
    if "extrinsicTrans" in found or not poses:
        back = transform_of(found.numbers("extrinsicRot", 9).reshape(3, 3), found.numbers("extrinsicTrans", 3))
        poses[_LIO_SAM] = inverse(back)
    form, matrix = next(iter(poses.items()))
    if poses_apart(matrix, poses.get(_LIO_SAM, matrix)):
        raise unfit(
            "it has both FAST-LIO's extrinsic_T and LIO-SAM's extrinsicTrans, which mean different mountings and of which "
            "one has to be left out"
        )
    return GivenExtrinsic(matrix, _time_offset_ns(found), form)


class _Found:
    """The values of a file's tree by their last name."""

    def __init__(self, tree: object) -> None:
        self._places: dict[str, list[tuple[str, object]]] = {}
        for path, value in _entries(tree):
            # ROS 1 has slashes within a key, and ROS 2 dots.
            self._places.setdefault(re.split(r"[./]", path)[-1], []).append((path, value))

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def one(self, *keys: str) -> object:
        """The value of names that mean the same, None where none is there; refused where they have several."""
        places = [place for key in keys for place in self._places.get(key, ()) if place[1] is not None]
        for path, value in places[1:]:
            if value != places[0][1]:
                raise unfit(f"{places[0][0]} and {path} have different values, of which one has to be left out")
        return places[0][1] if places else None

    def numbers(self, key: str, count: int) -> FloatArray:
        """So many numbers (count,) under a name."""
        values = self.one(key)
        if not isinstance(values, list) or len(values) != count or not all(_is_number(value) for value in values):
            raise unfit(f"{key} is not a list of {count} numbers")
        return np.array([float(value) for value in values], dtype=np.float64)

    def nanoseconds(self, *keys: str) -> int | None:
        """A time that is given in seconds, None where it is not there."""
        seconds = self.one(*keys)
        if seconds is None:
            return None
        if not isinstance(seconds, int | float) or not _is_number(seconds) or abs(seconds) > FARTHEST_S:
            raise unfit(
                f"{' or '.join(key for key in keys if key in self)} is no number of seconds below {FARTHEST_S:.0e}"
            )
        return int((Decimal(repr(seconds)) * 1_000_000_000).to_integral_value())


def _loaded(text: str) -> object:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    plain = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE)  # OpenCV's first line is none of YAML's
    try:
        return YAML(typ="safe", pure=True).load(plain)
    except RecursionError as error:
        raise unfit("this YAML cannot be read (it is nested too deep)") from error
    except YAMLError as error:
        raise unfit(f"this YAML cannot be read ({_problem(error)})") from error


def _problem(error: Exception) -> str:
    """What is wrong, and in which line; a key that stands twice in one section is found here."""
    problem, mark = getattr(error, "problem", None), getattr(error, "problem_mark", None)
    if not isinstance(problem, str) or mark is None:
        return str(error).splitlines()[0]
    return f"{problem.splitlines()[0]}, line {mark.line + 1}"


def _entries(tree: object, above: str = "") -> Iterator[tuple[str, object]]:
    if isinstance(tree, dict):
        for key, value in tree.items():
            path = f"{above}{key}"
            yield path, value
            yield from _entries(value, f"{path}.")


def _time_offset_ns(found: _Found) -> int | None:
    of_imu, of_lidar = found.nanoseconds(*_TAU_KEYS), found.nanoseconds(_LIDAR_TAU_KEY)
    if of_lidar is not None and found.one("lidar_type") == _LIVOX_MESSAGES:
        of_lidar = None
    if of_imu is None and of_lidar is None:
        return None
    return -(of_imu or 0) - (of_lidar or 0)


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # YAML's whole numbers have no end
        return False
