"""One thing said twice in a file that somebody hands over: a pose in two forms, a time in two units, a key in one object.

Whoever edits one of two forms means that one; a fixed order of precedence would take the other in silence. Each check
returns what is wrong as the middle of a sentence, or None.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from itertools import combinations

import numpy as np

from calib_core.geometry import log
from calib_core.result import RESULT_SCHEMA
from calib_core.types import FloatArray

#: Six printed decimals on either side: one in the last of them, and a half for binary fractions.
SAME_M = 1.5e-6
#: A quaternion or a matrix of six decimals turns by up to 2e-6.
SAME_RAD = 3e-6
SAME_NS = 1000
#: What to do about two forms of one thing, where neither has to be there.
LEAVE_ONE_OUT = ", of which one has to be left out"

#: Of a key that no program of ours knows, so much is told.
_LONGEST_KEY = 60

#: Keys that mean a mounting, of which a guess knows one.
_TRANSFORM = re.compile(
    r"[TRP]_\w*(?:imu|lidar)\w*|[TRP]_(?:IL|LI)|(?:extrinsic|transform|translation|rotation|quaternion|euler)\w*|matrix",
    re.IGNORECASE,
)


def places_apart(one: FloatArray, other: FloatArray) -> bool:
    """Whether two places (3,) [m] are not the same up to printed digits."""
    return bool(np.abs(one - other).max() > SAME_M)


def turns_apart(one: FloatArray, other: FloatArray) -> bool:
    """Whether two rotations (3, 3) are not the same up to printed digits."""
    return float(np.linalg.norm(log(one.T @ other))) > SAME_RAD


def poses_apart(one: FloatArray, other: FloatArray) -> bool:
    """Whether two mountings (4, 4) of the same direction are not the same up to printed digits."""
    return turns_apart(one[:3, :3], other[:3, :3]) or places_apart(one[:3, 3], other[:3, 3])


def forms_contradict(turns: Mapping[str, FloatArray], places: Mapping[str, FloatArray]) -> str | None:
    """What is wrong with one transform's forms. turns: (3, 3) by key.   places: (3,) [m] by key."""
    for forms, apart, what in ((turns, turns_apart, "rotations"), (places, places_apart, "translations")):
        for one, other in combinations(forms, 2):
            if apart(forms[one], forms[other]):
                return f"{one} and {other} of its T_imu_lidar are different {what}"
    return None


def times_contradict(offset_s: float | None, offset_ns: int | None) -> str | None:
    """What is wrong with a time offset in two units."""
    if offset_s is None or offset_ns is None or abs(round(offset_s * 1e9) - offset_ns) <= SAME_NS:
        return None
    return f"its time_offset_s of {offset_s} s and its time_offset_ns of {offset_ns} ns are different times"


def key_twice(text: str) -> str | None:
    """What is wrong with a JSON text of which an object has a key twice: JSON's readers take the last, whichever was meant.

    None, too, of what is no JSON: whoever reads it says so.
    """
    twice: list[str] = []

    def note(pairs: list[tuple[str, object]]) -> None:
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                twice.append(key)
            seen.add(key)

    with suppress(ValueError, RecursionError):
        json.loads(text, object_pairs_hook=note)
        if twice:
            return (
                f"the key {twice[0][:_LONGEST_KEY]!r} stands twice in one object of it, of which one has to be left out"
            )
    return None


def is_result(document: Mapping[str, object]) -> bool:
    """Whether a JSON document is a result: of what it has beside the known keys a later version knows the meaning."""
    return document.get("schema") == RESULT_SCHEMA and "T_imu_lidar" in document


def strange_transform(keys: Iterable[str]) -> str | None:
    """What is wrong with keys beside T_imu_lidar: a mounting under another name would be passed over."""
    strange = next((key for key in keys if key != "T_imu_lidar" and _TRANSFORM.fullmatch(key)), None)
    if strange is None:
        return None
    return (
        f"it has the key {strange}, where a mounting has to be T_imu_lidar, which takes lidar coordinates to the IMU's "
        "(T_lidar_imu is its inverse)"
    )
