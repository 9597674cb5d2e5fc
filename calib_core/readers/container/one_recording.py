"""Which files are one recording's: those of one folder whose names are alike but for the number of the split.

    room_0.mcap, room_1.mcap                                    ROS 2, and ROS 1 under a name of one's own
    name_2024-01-01-10-00-00_0.bag, name_2024-01-01-10-05-00_1.bag   ROS 1: each split has the date at which it began

All others are several recordings. Read as one, there would be an hour between two scans, or a rig that was mounted anew.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePath
from typing import NamedTuple

from calib_core.errors import UnreadableRecording
from calib_core.phrasing import counted
from calib_core.readers.container.names import STORAGE_SUFFIXES, bare_name, some_of, storage_suffix

_DATE = r"(?<!\d)\d{4}([-_]\d\d){5}"
_DATED = re.compile(rf"{_DATE}$")
_DATED_SPLIT = re.compile(rf"{_DATE}_(?=\d+$)")
_SPLIT = re.compile(r"_(\d+)$")


class _Split(NamedTuple):
    """What a file's name says. number: of the split, -1 where it has none."""

    folder: str
    recording: str
    number: int


def is_same_recording(one: PurePath, other: PurePath) -> bool:
    """Whether their names are those of splits of one recording; two of one number are not told from these alone."""
    return _split(one)[:2] == _split(other)[:2]


def split_number(file: PurePath) -> int:
    """Which split of its recording it is by its name; -1 where it has no number."""
    return _split(file).number


def require_one_recording(files: Iterable[PurePath], what: str, cure: str) -> None:
    """Raises UnreadableRecording where these are several recordings'. files: under the folder or archive, which is `what`."""
    groups: dict[tuple[str, str], list[PurePath]] = {}
    for file in sorted(files):
        if storage_suffix(file) in STORAGE_SUFFIXES:
            groups.setdefault(_split(file)[:2], []).append(file)
    recordings = [recording for group in groups.values() for recording in _begun(group)]
    if len(recordings) > 1:
        names = some_of([recording[0].as_posix() for recording in recordings])
        raise UnreadableRecording(
            f"{what} holds {counted(len(recordings), 'recording')}, {names}; {cure}.", code="recording.several"
        )


def _split(file: PurePath) -> _Split:
    stem = bare_name(file)
    found = None if _DATED.search(stem) else _SPLIT.search(stem)
    if found is None:
        return _Split(file.parent.as_posix(), stem, -1)
    undated = _DATED_SPLIT.sub("", stem)
    return _Split(file.parent.as_posix(), undated[: undated.rfind(found[1])], int(found[1]))


def _begun(group: list[PurePath]) -> list[list[PurePath]]:
    """The recordings of files that are alike but for date and number: a number that comes again begins another.

    One stored in two ways, a bag and what it was converted to, is one.
    """
    begun: list[list[PurePath]] = [[]]
    numbers: set[tuple[int, str]] = set()
    for file in group:
        key = _split(file).number, storage_suffix(file)
        if key in numbers:
            begun.append([])
            numbers.clear()
        numbers.add(key)
        begun[-1].append(file)
    return begun
