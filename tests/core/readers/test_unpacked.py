"""An archive unpacked once for several readers, and removed when nobody reads it. Oracle: a count of the unpackings."""

from __future__ import annotations

import threading
import zipfile
from pathlib import Path

import pytest

from calib_core.errors import UnreadableRecording
from calib_core.readers.container import unpacked as module
from calib_core.readers.container.unpacked import discard, sharing, unpacked_archive


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    path = tmp_path / "room.zip"
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("room/room_0.mcap", b"first half")
        made.writestr("room/room_1.mcap", b"second half")
    return path


@pytest.fixture
def unpackings(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders that archives were unpacked into."""
    into: list[Path] = []
    really = module.unpack_archive

    def counted(path: Path, folder: Path) -> Path:
        into.append(folder)
        return really(path, folder)

    monkeypatch.setattr(module, "unpack_archive", counted)
    return into


def read(archive: Path) -> str:
    """All bytes of the archive's files, in name order."""
    with unpacked_archive(archive) as folder:
        return " ".join(file.read_text() for file in sorted(folder.iterdir()))


def test_readers_that_share_unpack_once_and_others_for_themselves(
    archive: Path, tmp_path: Path, unpackings: list[Path]
) -> None:
    """Mutations: the shared folder left when the first reader closes; it goes on being shared after `sharing` has ended."""
    shared = tmp_path / "shared"
    for _ in range(3):
        with sharing(shared):
            assert read(archive) == "first half second half"
    assert len(unpackings) == 1
    assert read(archive) == "first half second half"
    assert len(unpackings) == 2
    assert not unpackings[1].exists()


def test_another_archive_takes_the_place_of_the_first(archive: Path, tmp_path: Path, unpackings: list[Path]) -> None:
    """Mutations: files believed by the folder's being there; the old ones kept, so that a shared folder grows."""
    shared = tmp_path / "shared"
    with sharing(shared):
        read(archive)
        with zipfile.ZipFile(archive, "w") as made:
            made.writestr("room.bag", b"another recording")
        assert read(archive) == "another recording"
    assert len(unpackings) == 2
    assert sum(entry.is_dir() for entry in shared.iterdir()) == 1


def test_what_a_crash_left_half_unpacked_is_not_believed(archive: Path, tmp_path: Path) -> None:
    """Mutation: unpacked straight into its final name."""
    shared = tmp_path / "shared"
    damaged = archive.read_bytes()
    archive.write_bytes(damaged.replace(b"second half", b"second HALF"))
    with sharing(shared):
        for _ in range(2):
            with pytest.raises(UnreadableRecording, match=r"room\.zip"):
                read(archive)
    assert discard(shared)
    assert [entry.name for entry in shared.iterdir()] == ["lock"]


def test_two_at_once_wait_for_one_unpacking(
    archive: Path, tmp_path: Path, unpackings: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Locks are of open files, so that two threads stand for two processes. Mutation: no lock while unpacking."""
    shared, begun, go_on = tmp_path / "shared", threading.Event(), threading.Event()
    counted, found = module.unpack_archive, []

    def slow(path: Path, folder: Path) -> Path:
        begun.set()
        assert go_on.wait(20)
        return counted(path, folder)

    monkeypatch.setattr(module, "unpack_archive", slow)

    def reader() -> None:
        with sharing(shared):
            found.append(read(archive))

    threads = [threading.Thread(target=reader) for _ in range(2)]
    threads[0].start()
    assert begun.wait(20)
    threads[1].start()
    threads[1].join(0.3)
    go_on.set()
    for thread in threads:
        thread.join(20)
    assert found == ["first half second half"] * 2
    assert len(unpackings) == 1


def test_nothing_is_removed_while_somebody_reads_it(archive: Path, tmp_path: Path) -> None:
    """Mutations: files removed in spite of the lock; the lock given up once unpacked."""
    shared = tmp_path / "shared"
    assert discard(shared)
    with sharing(shared), unpacked_archive(archive) as folder:
        assert not discard(shared)
        assert (folder / "room_1.mcap").is_file()
    assert discard(shared)
    assert not folder.exists()
