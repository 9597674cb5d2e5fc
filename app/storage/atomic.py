"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calib_core.errors import InputError


def check_writable(path: Path) -> None:
    """Raise a sentence, before long work begins, where a file could not be written to `path`."""
    if path.is_dir():
        raise InputError(f"Expected a file name for the output, but {path} is a folder; add a name to it.")
    if _is_stream(path):
        if not os.access(path, os.W_OK):
            raise InputError(f"Nothing may be written to {path}; choose another place for the output.")
        return
    folder = path.resolve().parent
    if not folder.is_dir():
        raise InputError(
            f"Expected a folder for the output at {folder}, but there is none; make it, or correct the name."
        )
    if not os.access(folder, os.W_OK):
        raise InputError(f"Nothing may be written in {folder}; choose another place for the output.")


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path`. Whoever reads meanwhile sees the old file or the new one, never a part.

    A link stays a link. A device or a pipe (/dev/null, a shell's >(...)) is written to: what reads from it is to have the text,
    and a file put in its place would be the end of it.
    """
    try:
        if _is_stream(path):
            path.write_text(text, encoding="utf-8")
        else:
            _replace(path.resolve(), text)
    except OSError as error:
        raise InputError(
            f"{path} could not be written ({error.strerror}); free some space or choose another place."
        ) from error


def _is_stream(path: Path) -> bool:
    """Whether there is something at `path` that is no file and no folder: a device, a pipe, a socket."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _replace(path: Path, text: str) -> None:
    """Write a file anew, whole, beside its place and then into it."""
    descriptor, made = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        Path(made).chmod(0o666 & ~_umask())
        Path(made).replace(path)
    except BaseException:
        with suppress(OSError):
            Path(made).unlink()
        raise


def _umask() -> int:
    """The process's mask for new files; it can only be read by setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write what becomes `path` at the end, once its bytes are on the disk: after a power cut it is whole or absent.

    The folder is made where it is not there.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.stem}.part{path.suffix}")  # NumPy adds its suffix to a name that has another
    try:
        yield fresh
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise
    with fresh.open("rb") as file:
        os.fsync(file.fileno())
    fresh.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in the folder are on the disk: a file that is there may otherwise be lost with a power cut."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
