"""What an error comes of."""

from __future__ import annotations

import errno
import os
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import is_for_want_of_room

#: A device of Linux's that has no room, whatever is written to it.
FULL = Path("/dev/full")
pytestmark = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")


def by_python() -> None:
    FULL.write_bytes(b"x")


def by_numpy() -> None:
    """Bytes that go through the C library: how many were written is all that it says."""
    with FULL.open("wb", buffering=0) as file:
        np.zeros(100_000).tofile(file)


def by_sqlite() -> None:
    """A database that may have no more pages."""
    database = sqlite3.connect(":memory:")
    database.execute("PRAGMA max_page_count = 3")
    database.execute("CREATE TABLE one (content BLOB)")
    try:
        database.execute("INSERT INTO one VALUES (zeroblob(100000))")
    finally:
        database.close()


def on_the_way() -> None:
    """A library that says something of its own instead."""
    try:
        by_python()
    except OSError as error:
        raise RuntimeError("the writer is broken") from error


def by_its_number() -> None:
    raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """No folder for temporary files takes any."""
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: ["/dev/null"])
    monkeypatch.setattr(tempfile, "tempdir", None)


@pytest.mark.parametrize("write", [by_python, by_numpy, by_sqlite, on_the_way, by_its_number])
def test_a_write_without_room_is_known_however_it_is_told(write: Callable[[], None]) -> None:
    """Oracle: a device that is full. Seen: NumPy's has no number, and was a defect to report.

    Mutations: the number asked alone; the first error asked alone; sqlite's left out.
    """
    with pytest.raises((OSError, sqlite3.Error, RuntimeError)) as failed:
        write()
    assert is_for_want_of_room(failed.value)


@pytest.mark.usefixtures("nowhere")
def test_so_is_a_disk_on_which_no_temporary_file_can_be_made() -> None:
    """Mutation: only what a write says."""
    with pytest.raises(FileNotFoundError) as failed:
        tempfile.gettempdir()
    assert is_for_want_of_room(failed.value)


@pytest.mark.parametrize(
    "error",
    [
        OSError(errno.EACCES, os.strerror(errno.EACCES)),
        FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), "5 requested"),
        ValueError("disk"),
        sqlite3.OperationalError("database is locked"),
    ],
)
def test_other_errors_are_what_they_are(error: Exception) -> None:
    """Mutation: any OSError."""
    assert not is_for_want_of_room(error)
