"""Where a recording written again goes: found fit before the long work, and put in place after it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from calib_core.errors import SettingsError
from calib_core.maps.files import SUFFIXES as CLOUD_SUFFIXES
from calib_core.readers.container.opening import RecordingKind, kind_of, open_recording
from calib_core.readers.container.storage import TopicSummary

_BAG_SUFFIXES: dict[RecordingKind, tuple[str, ...]] = {"ros1": (".bag",), "ros2": (".mcap", ".db3")}


def check_output(path: Path, out: Path, map_out: Path | None = None) -> None:
    """Raise SettingsError where the recording at `path` could not be written to `out`, or its map to `map_out`.

    Of the recording no more is read than how it is stored, and for a bag its topics: this is asked before a solve of minutes, not
    after it.
    """
    check_fits(out, kind_of(path), path.name)
    if out.suffix != "":
        with open_recording(path) as recording:
            check_types(recording.topics, recording.name)
    # Folders that are missing are made, so what counts is the lowest one that is there.
    _check_folder(next(folder for folder in (out.absolute(), *out.absolute().parents) if folder.exists()))
    if map_out is not None:
        _check_map(map_out, out)


def check_fits(out: Path, kind: RecordingKind, name: str) -> None:
    """Raise SettingsError where `out` exists, or its suffix says another kind than the recording called `name` is of."""
    if out.suffix not in ("", *_BAG_SUFFIXES[kind]):
        bags = " or ".join(_BAG_SUFFIXES[kind])
        raise SettingsError(
            f"The output {out.name} does not fit {name}: give a folder (no suffix) for .ply or .pcd files, or a {bags} file."
        )
    if out.is_dir() and out.suffix != "":
        raise SettingsError(f"Expected a name for a bag, but {out} is a folder; choose another name.")
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise SettingsError(f"The output {out} exists already; remove it or choose another name.")


def check_types(topics: Sequence[TopicSummary], name: str) -> None:
    """Raise SettingsError where a topic of the recording called `name` holds messages of two types, which only it tells apart."""
    types: dict[str, str] = {}
    for topic in topics:
        if topic.count and types.setdefault(topic.name, topic.type) != topic.type:
            raise SettingsError(
                f"The topic {topic.name} of {name} holds messages of two types, {types[topic.name]} and {topic.type}, which a "
                "bag made of it would mix up; give a folder (no suffix) for --output, or take one of them out of the recording."
            )


@contextmanager
def placed_last(out: Path) -> Iterator[Path]:
    """Where to write a file that appears at `out` when the context is left well; where it is left otherwise, none does."""
    with tempfile.TemporaryDirectory(prefix=".unsweep-", dir=out.absolute().parent) as folder:
        made = Path(folder) / out.name
        yield made
        shutil.move(made, out)


@contextmanager
def filled_last(out: Path) -> Iterator[Path]:
    """Where to write a folder or a file that becomes `out` when the context is left well.

    A folder that is there, empty, is filled and not replaced: it may be the one that a shell is in, a link to one, or a place
    where a disk is mounted.
    """
    is_there = out.is_dir()
    with tempfile.TemporaryDirectory(prefix=".unsweep-", dir=out if is_there else out.parent) as folder:
        made = Path(folder) / (out.name or "clouds")
        yield made
        if is_there:
            for file in sorted(made.iterdir()):
                file.replace(out / file.name)
        else:
            shutil.move(made, out)


def _check_map(map_out: Path, out: Path) -> None:
    if map_out.suffix not in CLOUD_SUFFIXES:
        raise SettingsError(
            f"Expected a name that ends in .ply or .pcd for the map, but found {map_out.name}; change the name."
        )
    if map_out.is_dir():
        raise SettingsError(f"Expected a file name for the map, but {map_out} is a folder; add a name to it.")
    if out.absolute() in map_out.absolute().parents:
        raise SettingsError(
            f"Expected the map outside of {out}, which holds nothing but the scans, but found {map_out}; choose another place."
        )
    if not map_out.absolute().parent.is_dir():
        raise SettingsError(
            f"Expected a folder for the map at {map_out.absolute().parent}, but there is none; make it, or correct the name."
        )
    _check_folder(map_out.absolute().parent)


def _check_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise SettingsError(f"Expected a folder for the output at {folder}, but that is a file; choose another place.")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise SettingsError(f"Nothing may be written in {folder}; choose another place for the output.")
