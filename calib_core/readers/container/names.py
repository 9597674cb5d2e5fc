"""What the files of recordings are called: the one place that knows, for every door through which they come.

    room.bag  room.mcap  room.db3               stored messages
    room.mcap.zst  room.mcap.zstd               compressed as a whole
    room.bag.active                             its recorder was ended
    room.zip  room.tar  room.tar.gz ...         an archive of these

Upper case counts as lower case: cards of cameras and old disks know no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from calib_core.phrasing import joined

STORAGE_SUFFIXES = (".bag", ".mcap", ".db3")
#: Of a file that is compressed, or was still being recorded.
_OUTER_SUFFIXES = (".zstd", ".zst", ".active")
ARCHIVE_SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
#: All that a recording's name may end in, as it is in lower case.
SUFFIXES = (
    *STORAGE_SUFFIXES,
    *(inner + outer for inner in STORAGE_SUFFIXES for outer in _OUTER_SUFFIXES),
    *ARCHIVE_SUFFIXES,
)
#: The same in words.
IN_WORDS = (
    f"{', '.join(STORAGE_SUFFIXES)}, also with {', '.join(_OUTER_SUFFIXES)} behind it, or {', '.join(ARCHIVE_SUFFIXES)}"
)

#: A sentence lists so many names, each no longer than this.
_LISTED, _LONGEST_NAME = 5, 80


def recording_suffix(name: str) -> str:
    """The one of SUFFIXES that the name ends in; "" where it is no recording's."""
    lowered = name.lower()
    return max((suffix for suffix in SUFFIXES if lowered.endswith(suffix)), key=len, default="")


def storage_suffix(file: PurePath) -> str:
    """The suffix that says how it is stored, under compression's and that of a bag still being recorded; lower case."""
    name = PurePath(file.name.lower())
    return PurePath(name.stem).suffix if name.suffix in _OUTER_SUFFIXES else name.suffix


def bare_name(file: PurePath) -> str:
    """The file's name without these suffixes, in its own letters."""
    return PurePath(file.stem).stem if file.suffix.lower() in _OUTER_SUFFIXES else file.stem


def is_compressed(file: PurePath) -> bool:
    """Whether it is compressed as a whole, and no archive."""
    return file.suffix.lower() in {".zst", ".zstd"}


def is_hidden(file: PurePath) -> bool:
    """Whether the file, or a folder that it is in, is one that systems put beside a person's: `._room.bag` of a Mac."""
    return any(part.startswith(".") and part.strip(".") for part in file.parts)


def plain_name(name: str) -> str:
    """The name without what breaks a line of a sentence or of a log, or turns its order around."""
    return "".join(character if character.isprintable() else "_" for character in name)


def some_of(names: Sequence[str]) -> str:
    """The first of the names, and how many there are beside them, in words."""
    shown = [plain_name(name)[-_LONGEST_NAME:] for name in names[:_LISTED]]
    return joined(shown if len(names) <= _LISTED else [*shown, f"{len(names) - _LISTED} more"])
