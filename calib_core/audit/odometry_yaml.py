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
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING

import numpy as np

from calib_core.audit.pose import GivenExtrinsic, inverse, transform_of, unfit
from calib_core.contradictions import poses_apart
from calib_core.settings import FARTHEST_S
from calib_core.types import FloatArray

if TYPE_CHECKING:
    from ruamel.yaml import YAML
    from ruamel.yaml.nodes import MappingNode, Node, ScalarNode

#: Subtracted from the IMU's stamps by the programs that know them.
_TAU_KEYS = ("time_offset_lidar_to_imu", "imu_time_offset")
#: Added to the lidar's stamps, but those of this type of lidar.
_LIDAR_TAU_KEY = "lidar_time_offset"
_LIVOX_MESSAGES = 1

_FAST_LIO = "FAST-LIO's settings, T_imu_lidar"
_LIO_SAM = "LIO-SAM's settings, T_lidar_imu"


def from_yaml(text: str) -> GivenExtrinsic:
    """The extrinsic of FAST-LIO's or LIO-SAM's settings."""
    found = _Found(text)
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


@dataclass(frozen=True, slots=True)
class _Key:
    """A section's or a value's key, and the section's that it stands in.

    Their names are joined only where somebody is told: the path of each may be as long as the text.
    """

    name: str
    above: _Key | None

    def __str__(self) -> str:
        names: list[str] = []
        at: _Key | None = self
        while at is not None:
            names.append(at.name)
            at = at.above
        return ".".join(reversed(names))


class _Found:
    """The values of a file's sections by their last name.

    What aliases repeat counts once, and nothing is made of a value before it is asked for: unfolded, a text of 600 bytes whose
    aliases name one another would take gigabytes.
    """

    def __init__(self, text: str) -> None:
        from ruamel.yaml import YAML

        self._yaml = YAML(typ="safe", pure=True)
        self._places: dict[str, dict[int, tuple[_Key, Node]]] = {}
        for key, value in _entries(_composed(self._yaml, text)):
            # ROS 1 has slashes within a key, and ROS 2 dots.
            self._places.setdefault(re.split(r"[./]", key.name)[-1], {}).setdefault(id(value), (key, value))

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def one(self, *keys: str) -> object:
        """The value of names that mean the same, None where none is there; refused where they have several."""
        there = [place for key in keys for place in self._places.get(key, {}).values()]
        places = [(key, value) for key, node in there if (value := self._value(node)) is not None]
        for key, value in places[1:]:
            if value != places[0][1]:
                raise unfit(f"{places[0][0]} and {key} have different values, of which one has to be left out")
        return places[0][1] if places else None

    def _value(self, node: Node) -> object:
        """A word or a number, or a list of these; whatever else it is, the node itself, which equals itself alone."""
        from ruamel.yaml.nodes import ScalarNode, SequenceNode

        if isinstance(node, SequenceNode):
            return [self._value(part) if isinstance(part, ScalarNode) else part for part in node.value]
        return self._scalar(node) if isinstance(node, ScalarNode) else node

    def _scalar(self, node: ScalarNode) -> object:
        from ruamel.yaml.error import YAMLError

        try:
            value: object = self._yaml.constructor.construct_object(node)
        except (YAMLError, ValueError, LookupError) as error:
            # The 99th of a month, 5000 digits, a tag that does not fit.
            line = node.start_mark.line + 1
            raise unfit(f"this YAML cannot be read (line {line} has no value that fits its kind)") from error
        return value

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


def _composed(yaml: YAML, text: str) -> Node | None:
    """The text's nodes; an alias is the very node that it names."""
    from ruamel.yaml.error import YAMLError

    plain = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE)  # OpenCV's first line is none of YAML's
    try:
        found: Node | None = yaml.compose(plain)
    except RecursionError as error:
        raise unfit("this YAML cannot be read (it is nested too deep)") from error
    except (YAMLError, ValueError) as error:
        raise unfit(f"this YAML cannot be read ({_problem(error)})") from error
    return found


def _problem(error: Exception) -> str:
    """What is wrong, and in which line."""
    problem, mark = getattr(error, "problem", None), getattr(error, "problem_mark", None)
    if not isinstance(problem, str) or mark is None:
        return str(error).splitlines()[0]
    return f"{problem.splitlines()[0]}, line {mark.line + 1}"


def _entries(root: Node | None) -> Iterator[tuple[_Key, Node]]:
    """What stands in sections within sections, each section once, however many aliases lead to it."""
    from ruamel.yaml.nodes import MappingNode

    waiting: list[tuple[_Key | None, Node | None]] = [(None, root)]
    seen: set[int] = set()
    while waiting:
        above, section = waiting.pop()
        if not isinstance(section, MappingNode) or id(section) in seen:
            continue
        seen.add(id(section))
        inside = [(_Key(name, above), value) for name, value in _named(section)]
        yield from inside
        waiting += reversed(inside)


def _named(section: MappingNode) -> list[tuple[str, Node]]:
    """A section's values by their names, none of which may stand twice. A key that is a list or a section is no name."""
    from ruamel.yaml.nodes import ScalarNode

    named: dict[str, Node] = {}
    for key, value in section.value:
        if isinstance(key, ScalarNode):
            if key.value in named:
                line = key.start_mark.line + 1
                raise unfit(f'this YAML cannot be read (found duplicate key "{key.value}", line {line})')
            named[key.value] = value
    return list(named.items())


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
