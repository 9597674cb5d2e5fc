"""One stamp in two fields: whole seconds, and the nanoseconds or microseconds of the second that has begun.

The second of them alone looks like a clock that jumps back once a second. Which two belong together is told by their names: the
same beginning, then "sec" and "nsec", "tv_sec" and "tv_usec", "timeSecond" and "timeNanosecond" (SICK: lidar_sec, lidar_nsec).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calib_core.readers.clouds.cloud import StructArray
from calib_core.types import IntArray

#: Between the two names, where they are named as one field.
_AND = "+"
_SECOND_NS = 1_000_000_000
_WHOLE = re.compile(r"(?P<of>.*?)(s|secs?|seconds?)", re.IGNORECASE)
_PART = re.compile(
    r"(?P<of>.*?)((?P<nano>ns|nsecs?|nanos|nanosecs?|nanoseconds?)|us|usecs?|micros|microsecs?|microseconds?)",
    re.IGNORECASE,
)


def split_times(points: StructArray) -> list[str]:
    """The stamps in two fields that a cloud has, each named "SECONDS+PART"; only whole numbers are such.

    Nanoseconds that go on past a second are a stamp of their own, whatever is beside them.
    """
    whole = [
        name for name in points.dtype.names or () if points.dtype[name].kind in "iu" and points.dtype[name].shape == ()
    ]
    found = []
    for name in whole:
        part = _PART.fullmatch(name)
        for other in whole if part else ():
            seconds = _WHOLE.fullmatch(other)
            alike = part and seconds and other != name and seconds["of"].lower() == part["of"].lower()
            if alike and np.median(points[name]) * _ns_of(name) < _SECOND_NS:
                found.append(f"{other}{_AND}{name}")
    return found


def is_split(field: str, points: StructArray) -> bool:
    """Whether that names two fields of a cloud as one."""
    names = field.split(_AND)
    return len(names) == 2 and field not in (points.dtype.names or ()) and set(names) <= set(points.dtype.names or ())


def parts(field: str) -> Sequence[str]:
    """The two fields that it names."""
    return field.split(_AND)


def joined_ns(points: StructArray, field: str) -> IntArray:
    """(N,) nanoseconds of a stamp in two fields."""
    whole, part = parts(field)
    seconds, rest = points[whole].astype(np.int64), points[part].astype(np.int64)
    return np.asarray(seconds * _SECOND_NS + rest * _ns_of(part), np.int64)


def _ns_of(part: str) -> int:
    """Nanoseconds of one unit of a field of that name."""
    match = _PART.fullmatch(part)
    return 1 if match is None or match["nano"] else 1000
