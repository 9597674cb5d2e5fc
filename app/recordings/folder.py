"""The server's own folder of recordings: looked at and opened in place, never left."""

from __future__ import annotations

import os
from pathlib import Path

from app.errors import NotFound, Refused
from app.schemas.recordings import FolderEntry, FolderListing
from app.storage.sizes import tree_size
from calib_core import api
from calib_core.errors import UnreadableRecording


class RecordingsFolder:
    """A folder of recordings; `root` None where the server offers none."""

    def __init__(self, root: Path | None) -> None:
        self._root = None if root is None else root.resolve()

    @property
    def offered(self) -> bool:
        """Whether there is one."""
        return self._root is not None

    def listing(self, path: str) -> FolderListing:
        """What is in the folder at `path` below the root; '' is the root."""
        root, folder = self._within(path)
        try:
            there = folder.is_dir()
        except OSError:  # a name longer than the file system knows
            there = False
        if not there:
            raise NotFound(
                "folder.not_found", f"The recordings folder has no folder {path[:80]!r}; go up and choose again."
            )
        try:
            shown = [child for child in sorted(folder.iterdir()) if not child.name.startswith(".")]
        except PermissionError:
            raise NotFound(
                "folder.not_readable",
                f"The server may not look into {path[:80]!r}; give its user the right to read it.",
            ) from None
        inside = [child for child in shown if _stays(child, root)]
        entries = [entry for child in inside if (entry := _entry_or_closed(child, root)) is not None]
        parent = None if folder == root else _below(folder.parent, root)
        links_out = len(shown) - len(inside)
        return FolderListing(path=_below(folder, root), parent=parent, entries=entries, links_out=links_out)

    def recording(self, path: str) -> Path:
        """The recording at `path` below the root: a file, or a folder whose files are one recording's and stay below the root."""
        root, found = self._within(path)
        try:
            files = api.recording_files(found) if found.is_dir() else [found] if api.is_recording_file(found) else []
        except UnreadableRecording as error:
            raise NotFound("folder.no_recording", str(error)) from error
        except OSError:
            files = []
        if not files:
            raise NotFound(
                "folder.no_recording",
                f"Expected a recording at {path[:80]!r} in the recordings folder, a bag's folder or a file that ends in "
                f"{api.recording_names()}, found none; choose an entry marked as a recording.",
            )
        for file in files:
            if not _stays(file, root):
                raise Refused(
                    "folder.outside",
                    f"{file.name[:80]!r} in {path[:80]!r} is a link that leads out of the recordings folder; put the file itself "
                    "there.",
                )
        return found

    def require_inside(self, source: Path) -> None:
        """Raise Refused or NotFound where what was opened leads out of the folder by now, or holds no recording any more."""
        below = self.path_of(source)
        if below is not None:
            self.recording(below)

    def path_of(self, source: Path) -> str | None:
        """Where a recording is below the root, as whoever opened it chose it; None where no such folder is offered now."""
        if self._root is None or not source.is_relative_to(self._root):
            return None
        return source.relative_to(self._root).as_posix()

    def _within(self, path: str) -> tuple[Path, Path]:
        if self._root is None:
            raise NotFound("folder.not_offered", "This server offers no folder; start it with --recordings DIR.")
        try:
            found = (self._root / path).resolve()
            found.exists()  # a name that no file system holds is an error here and in no later place
        except (OSError, ValueError, RuntimeError):
            raise NotFound("folder.not_found", f"{path[:80]!r} is no path in the recordings folder.") from None
        if not found.is_relative_to(self._root):
            raise Refused("folder.outside", f"{path[:80]!r} leads out of the recordings folder; stay inside it.")
        return self._root, found


def is_text(path: Path) -> bool:
    """Whether the path can be written down: file systems keep bytes, and not all bytes are text."""
    try:
        str(path).encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


def _stays(child: Path, root: Path) -> bool:
    """Whether the child is below the root, wherever links lead; one that leads round in a circle leads nowhere else."""
    try:
        return child.resolve().is_relative_to(root)
    except (OSError, RuntimeError):
        return True


def _entry_or_closed(child: Path, root: Path) -> FolderEntry | None:
    """The entry of a child; what the server may not look into, a disk's lost+found for instance, cannot be opened."""
    try:
        return _entry(child, root)
    except PermissionError:
        return FolderEntry(name=child.name, path=_below(child, root), kind="file", size_bytes=0)


def _entry(child: Path, root: Path) -> FolderEntry | None:
    """What is shown of a child; None for what is neither file nor folder."""
    if not is_text(child):  # nobody could ask for it by a name that is none
        name = os.fsencode(child.name).decode("utf-8", "replace")
        return FolderEntry(name=name, path=name, kind="file", size_bytes=0)
    if api.is_recording_file(child):
        return FolderEntry(name=child.name, path=_below(child, root), kind="recording", size_bytes=child.stat().st_size)
    if api.is_recording_folder(child) and all(_stays(file, root) for file in child.iterdir()):
        return FolderEntry(name=child.name, path=_below(child, root), kind="recording", size_bytes=tree_size(child))
    if child.is_dir():
        return FolderEntry(name=child.name, path=_below(child, root), kind="folder", size_bytes=0)
    if child.is_file():
        return FolderEntry(name=child.name, path=_below(child, root), kind="file", size_bytes=child.stat().st_size)
    return None


def _below(path: Path, root: Path) -> str:
    relative = path.relative_to(root).as_posix()
    return "" if relative == "." else relative
