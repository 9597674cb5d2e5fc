"""The files of a recording: one file, or those of a folder, as far as names and the folder's list tell; none is opened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.listed import METADATA, ListedFile, listed_files
from calib_core.readers.container.names import (
    STORAGE_SUFFIXES,
    bare_name,
    is_hidden,
    recording_suffix,
    storage_suffix,
)
from calib_core.readers.container.one_recording import is_same_recording, require_one_recording, split_number

ACCEPTED = "a ROS 1 .bag, a ROS 2 folder, .mcap or .db3, or a .zip or .tar.gz of a bag folder"


@dataclass(frozen=True, slots=True)
class RecordingFiles:
    """The storage files of a recording in the order of their numbers.

    listed: how many the folder's list has, 0 where it has none that are there.   missing: of these the ones that are not there.
    beside: files in the folder that the list does not have, and that are no part of the recording.
    """

    files: list[Path]
    listed: int = 0
    missing: tuple[ListedFile, ...] = ()
    beside: tuple[Path, ...] = ()


def is_recording_file(path: Path) -> bool:
    """Whether it is a file that is called as recordings are."""
    return path.is_file() and recording_suffix(path.name) != ""


def is_recording_folder(path: Path) -> bool:
    """Whether the folder is one recording, and not one of recordings: with its list, or with the names that recorders give.

    They call splits by their folder: room/room_0.mcap, room/room_1.mcap. Other files without a list are offered one by one:
    room_1.mcap and room_2.mcap may be two days' recordings.
    """
    if not path.is_dir():
        return False
    files = _storage_files_in(path)
    if (path / METADATA).is_file():
        return bool(files)
    named_so = [f for f in files if storage_suffix(f) != ".bag" and bare_name(f) == f"{path.name}_{split_number(f)}"]
    return bool(files) and named_so == files


def recording_files(path: Path) -> RecordingFiles:
    """The files of the recording at `path`: the file itself, or those of a folder.

    Recorders that were killed leave no list; splits are named in order, which is the order of the files with a list, too.
    Raises UnreadableRecording where there is none, or where there are several recordings'.
    """
    if not path.exists():
        raise UnreadableRecording(f"There is no file or folder {path}; give the path of {ACCEPTED}.")
    if path.is_file():
        if storage_suffix(path) not in STORAGE_SUFFIXES:
            raise UnreadableRecording(f"The file {path.name} is no recording; expected {ACCEPTED}.")
        return RecordingFiles([path])
    found = _found(path)
    chosen = _as_listed(found)
    if not chosen.listed:
        require_one_recording([f.relative_to(path) for f in found], f"The folder {path.name}", "give one of them")
    for suffix in STORAGE_SUFFIXES:
        files = [f for f in chosen.files if storage_suffix(f) == suffix]
        if files:
            ordered = sorted(files, key=_split_order)
            return RecordingFiles(ordered, chosen.listed, chosen.missing, chosen.beside)
    raise UnreadableRecording(f"The folder {path.name} holds no .mcap, .db3 or .bag file; expected {ACCEPTED}.")


def _storage_files_in(folder: Path) -> list[Path]:
    inside = sorted(folder.iterdir())
    return [f for f in inside if storage_suffix(f) in STORAGE_SUFFIXES and not f.name.startswith(".") and f.is_file()]


def _found(path: Path) -> list[Path]:
    """The storage files in a folder; where it has none, those in the folders in it: what lies below a recording was made of it.

    A folder that is closed to this user counts where no other has any.
    """
    found: list[Path] = []
    closed: PermissionError | None = None
    for folder in (path, *sorted(p for p in path.iterdir() if p.is_dir() and not is_hidden(p.relative_to(path)))):
        if found and found[0].parent == path:
            break
        try:
            found += _storage_files_in(folder)
        except PermissionError as error:
            closed = error
    if closed is not None and not found:
        raise closed
    return found


def _as_listed(found: Sequence[Path]) -> RecordingFiles:
    """The files as the metadata.yaml beside all of them has them, whatever they are called: then they are one recording.

    A split that is not listed belongs to it by its name: recorders that are killed have not listed the last one. So does a file
    under its name without compression, or with it. A list that has none of the files is another recording's.
    """
    folders = {file.parent for file in found}
    listed = listed_files(folders.pop()) if len(folders) == 1 else ()
    there = {one.name: file for one in listed if (file := _file_of(one, found)) is not None}
    if not there:
        return RecordingFiles(list(found))
    files = list(there.values())
    for file in found:
        if file not in files and _goes_on(file, files):
            files.append(file)
    missing = tuple(one for one in listed if one.name not in there)
    return RecordingFiles(files, len(listed), missing, tuple(file for file in found if file not in files))


def _file_of(listed: ListedFile, found: Sequence[Path]) -> Path | None:
    """The file of that name, else the one that differs from it by compression."""
    wanted = Path(listed.name)
    alike = (f for f in found if (bare_name(f), storage_suffix(f)) == (bare_name(wanted), storage_suffix(wanted)))
    return next((f for f in found if f.name == listed.name), None) or next(alike, None)


def _goes_on(file: Path, files: Sequence[Path]) -> bool:
    """Whether it is a split of the recording of these files, behind all of them."""
    number = split_number(file)
    return all(
        is_same_recording(file, one) and storage_suffix(file) == storage_suffix(one) and number > split_number(one)
        for one in files
    )


def _split_order(file: Path) -> tuple[str, int, str]:
    """bag_2 before bag_10: the recorder numbers splits without leading zeros."""
    stem = file.name.split(".")[0]
    head, _, number = stem.rpartition("_")
    return (head, int(number), file.name) if number.isdigit() else (stem, -1, file.name)
