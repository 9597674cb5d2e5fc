"""Which files a ROS 2 folder's metadata.yaml says are its recording's, and what each holds in time.

    rosbag2_bagfile_information:
      relative_file_paths:
        - room_0.db3
      files:
        - path: room_0.db3
          starting_time:
            nanoseconds_since_epoch: 1700000000000000000
          duration:
            nanoseconds: 30000000000

Read line by line: the file may come from anybody, and a library for all of YAML can be made to work without end.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from calib_core.readers.container.limits import LIMITS

METADATA = "metadata.yaml"
_PATHS = re.compile(r"^[ \t]*relative_file_paths:[ \t]*(?P<rest>\S.*)?$", re.MULTILINE)
_FILES = re.compile(r"^(?P<indent>[ \t]*)files:[ \t]*$", re.MULTILINE)
_ITEM = re.compile(r"^(?P<indent>[ \t]*)-[ \t]+(?P<value>\S.*)$")
_PATH = re.compile(r"^(?:[ \t]*-)?[ \t]*path:[ \t]*(\S.*)$", re.MULTILINE)
_DURATION = re.compile(r"duration:\s*nanoseconds:[ \t]*(\d{1,19})\b")


@dataclass(frozen=True, slots=True)
class ListedFile:
    """One file of the list. duration_s: from its first message to its last; None where the list does not tell."""

    name: str
    duration_s: float | None = None


def listed_files(folder: Path) -> tuple[ListedFile, ...]:
    """The files that the folder's metadata.yaml lists, in order; none where there is no such list."""
    try:
        with (folder / METADATA).open(encoding="utf-8") as file:
            text = file.read(LIMITS.archive_list_bytes)
    except (OSError, UnicodeDecodeError):
        return ()
    return files_of(text)


def files_of(text: str) -> tuple[ListedFile, ...]:
    """The files that the text of a metadata.yaml lists."""
    found = _PATHS.search(text)
    if found is None:
        return ()
    rest, after = found["rest"] or "", text[found.end() + 1 :]
    in_one_line = (rest + after).partition("]")[0].lstrip("[").split(",")
    values = in_one_line if rest.startswith("[") else _items(after)
    durations_s = _durations_s(text)
    names = [name for value in values[: LIMITS.archive_entries] if (name := _name(value))]
    return tuple(ListedFile(name, durations_s.get(name)) for name in dict.fromkeys(names))


def _items(text: str) -> list[str]:
    """The values of the list that the text begins with."""
    values: list[str] = []
    for line in text.splitlines():
        item = _ITEM.match(line)
        if item is None:
            break
        values.append(item["value"])
    return values


def _durations_s(text: str) -> dict[str, float]:
    found = _FILES.search(text)
    if found is None:
        return {}
    items: list[list[str]] = []
    for line in text[found.end() + 1 :].splitlines():
        item = _ITEM.match(line)
        if item is not None:
            items.append([])
        elif not items or len(line) - len(line.lstrip()) <= len(found["indent"]):
            break
        items[-1].append(line)
    durations_s: dict[str, float] = {}
    for lines in items:
        block = "\n".join(lines)
        path, duration = _PATH.search(block), _DURATION.search(block)
        if path is not None and duration is not None:
            durations_s[_name(path[1])] = int(duration[1]) * 1e-9
    return durations_s


def _name(value: str) -> str:
    """The file's own name: early recorders list it with its folder's before it."""
    return PurePosixPath(value.strip().strip("'\"")).name
