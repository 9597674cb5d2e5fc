"""Which recordings: those of a folder, or those of a list with a path a line; and a name for each document."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from calib_core import api
from calib_core.errors import InputError
from calib_core.phrasing import counted


def find_recordings(source: Path) -> list[Path]:
    """Whole paths, each recording once, in order.   source: a folder, searched to its bottom, or a list with a path a line.

    Links are followed; one that leads nowhere is a recording that is not there, and whoever reads it says so.
    A list's paths are taken from the list's own folder, those of one that comes through a pipe (a shell's <(...)) from the
    present one; empty lines and those that start with # are left out. A text of which no line leads to anything, or is called
    as recordings are, is no list.
    """
    if source.is_dir():
        found = [source] if api.is_recording_folder(source) else list(_below(source))
    elif source.exists() and not api.is_recording_file(source):
        found = list(_listed(source, source.parent if source.is_file() else Path.cwd()))
        if found and not any(os.path.lexists(path) or api.recording_suffix(path.name) for path in found):
            raise InputError(
                f"Expected a list with a path a line in {source}, but none of its {counted(len(found), 'line')} leads "
                f"anywhere or is called as recordings are, the first to {found[0]}; correct the paths, or the name of the list."
            )
    else:
        what = "one recording" if source.exists() else "nothing"
        raise InputError(
            f"Expected a folder of recordings or a list with a path a line at {source}, but found {what}; "
            f"{'use `unsweep calibrate` for it' if source.exists() else 'correct the name'}."
        )
    if not found:
        raise InputError(
            f"Expected recordings in {source}, but found none: looked for were ROS 2 folders and names that end in "
            f"{api.recording_names()}."
        )
    return _each_once(path.absolute() for path in found)


def _each_once(paths: Iterable[Path]) -> list[Path]:
    """Of each recording its own path where that is among them, else one that is no link, else the first: links and `..` lead to
    the same recording.
    """
    spelled: dict[str, list[Path]] = {}
    for path in paths:
        spelled.setdefault(os.path.realpath(path), []).append(path)  # of a link that leads round in a circle too
    return [min(ways, key=lambda way: (str(way) != real, way.is_symlink())) for real, ways in spelled.items()]


def _below(folder: Path) -> Iterator[Path]:
    """What is in the folder first, then what links in it lead to; each folder is entered once, wherever links lead."""
    entered: set[str] = set()
    ahead = [folder]
    while ahead:
        yield from _walked(ahead.pop(0), entered, ahead)


def _walked(folder: Path, entered: set[str], links: list[Path]) -> Iterator[Path]:
    """The recordings in a folder, to its bottom.   entered: real paths of folders, added to.   links: to others, added to."""
    real = os.path.realpath(folder)
    if real in entered:
        return
    entered.add(real)
    for child in sorted(folder.iterdir()):
        if child.name.startswith("."):
            continue
        if api.is_recording_file(child) or api.is_recording_folder(child) or _leads_nowhere(child):
            yield child
        elif child.is_symlink() and child.is_dir():
            links.append(child)
        elif child.is_dir():
            yield from _walked(child, entered, links)


def _leads_nowhere(child: Path) -> bool:
    """Whether it is a link of a recording's name to what is not there."""
    return child.is_symlink() and not child.exists() and api.recording_suffix(child.name) != ""


def _listed(source: Path, folder: Path) -> Iterator[Path]:
    try:
        # Some editors begin a file with a mark. Not splitlines: a file's name may hold U+0085 or U+2028.
        lines = source.read_text(encoding="utf-8-sig").split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"Expected a text file with a path a line, but {source} is none; correct it.") from error
    for line in lines:
        words = line.strip()
        if words and not words.startswith("#"):
            yield folder / Path(words).expanduser()


def document_names(recordings: Iterable[Path], kept: Mapping[Path, str]) -> dict[Path, str]:
    """A document name for each recording, no two alike.   kept: names that recordings have from an earlier run.

    The file's name without suffixes; with its folder's before it where that is taken; then with a number behind.
    """
    names = dict(kept)
    taken = {name.casefold() for name in kept.values()} | {"summary"}
    for path in recordings:
        if path in names:
            continue
        stem = _stem(path)
        numbered = (f"{stem}-{number}" for number in itertools.count(2))
        choices = itertools.chain([stem, f"{path.parent.name}-{stem}"], numbered)
        names[path] = next(name for name in choices if name.casefold() not in taken)
        taken.add(names[path].casefold())
    return names


def _stem(path: Path) -> str:
    suffix = api.recording_suffix(path.name)
    return (path.name[: -len(suffix)] if suffix else path.stem) or path.name
