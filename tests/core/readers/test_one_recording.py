"""Files of one recording, and of several that lie together: by their names and folders."""

from __future__ import annotations

import tarfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath

import pytest

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.archive import unpack_archive
from calib_core.readers.container.files import recording_files
from calib_core.readers.container.one_recording import require_one_recording
from calib_core.readers.container.opening import open_recording
from tests.core.readers import build

Packed = Callable[[Path, list[str]], Path]
ONE = [
    ["room.bag"],
    ["room_0.bag", "room_1.bag", "room_10.bag"],
    ["room/room_0.mcap", "room/room_1.mcap"],
    ["room_0.mcap.zstd", "room_1.mcap.zstd"],
    ["room_0.bag", "room_1.bag.active"],
    ["room.v2_0.db3", "room.v2_1.db3"],
    ["name_2024-01-01-10-00-00_0.bag", "name_2024-01-01-10-05-00_1.bag"],
    ["2024-01-01-10-00-00_0.bag", "2024-01-01-10-05-00_1.bag"],
    ["rosbag2_2024_01_01-10_00_00_0.mcap", "rosbag2_2024_01_01-10_00_00_1.mcap"],
    ["room.bag", "room.mcap"],
    ["room.bag", "notes.txt", "other.yaml"],
]
SEVERAL = [
    ["h.bag", "other.bag"],
    ["a/h.bag", "b/g.bag"],
    ["a/room_0.mcap", "b/room_1.mcap"],
    ["room_0.mcap", "hall_0.mcap"],
    ["h.bag", "other.mcap"],
    ["name_2024-01-01-10-00-00.bag", "name_2024-01-01-11-00-00.bag"],
    ["name_2024-01-01-10-00-00_0.bag", "name_2024-01-01-11-00-00_0.bag"],
    ["rosbag2_2024_01_01-10_00_00.mcap", "rosbag2_2024_01_01-10_00_30.mcap"],
    ["rosbag2_2024_01_01-10_00_00_0.mcap", "rosbag2_2024_01_01-11_00_00_0.mcap"],
    ["h.bag", "h.orig.bag"],
    ["h.bag", "h.bag.zst"],
]


@pytest.mark.parametrize("names", ONE, ids=lambda names: names[-1])
def test_splits_are_one_recording(names: list[str]) -> None:
    """Mutations: names that must be equal; the date of a split left in its name; the suffix of what is compressed."""
    require_one_recording(map(PurePosixPath, names), "The folder x", "give one of them")


@pytest.mark.parametrize("names", SEVERAL, ids=lambda names: names[-1])
def test_others_are_several_and_named(names: list[str]) -> None:
    """Mutations: the folder not asked; a date's last number for a split's; numbers that come again; any name for a split's."""
    with pytest.raises(UnreadableRecording) as caught:
        require_one_recording(map(PurePosixPath, names), "The folder x", "give one of them")
    one, other = sorted(names)
    assert str(caught.value) == f"The folder x holds 2 recordings, {one} and {other}; give one of them."
    assert caught.value.code == "recording.several"


def test_of_many_recordings_a_few_are_named() -> None:
    """Mutation: all of them."""
    with pytest.raises(UnreadableRecording, match=r"holds 9 recordings, a\.bag, .*, e\.bag and 4 more; give"):
        require_one_recording([PurePosixPath(f"{letter}.bag") for letter in "abcdefghi"], "It", "give one")


def _zipped(path: Path, names: list[str]) -> Path:
    with zipfile.ZipFile(path / "two.zip", "w") as archive:
        for name in names:
            archive.writestr(name, name.encode())
    return path / "two.zip"


def _tarred(path: Path, names: list[str]) -> Path:
    with tarfile.open(path / "two.tar.gz", "w:gz") as archive:
        for name in names:
            (path / "file").write_bytes(name.encode())
            archive.add(path / "file", name)
    return path / "two.tar.gz"


@pytest.mark.parametrize("packed", [_zipped, _tarred])
def test_an_archive_of_two_recordings_is_refused_with_both(packed: Packed, tmp_path: Path) -> None:
    """Seen: read as one, with an hour between two scans. Mutations: folders left out; what is not the first's passed over."""
    archive = packed(tmp_path, ["two/a/h.bag", "two/b/g.bag", "two/b/notes.txt"])
    (tmp_path / "to").mkdir()
    with pytest.raises(UnreadableRecording) as caught:
        unpack_archive(archive, tmp_path / "to")
    assert str(caught.value) == (
        f"The archive {archive.name} holds 2 recordings, two/a/h.bag and two/b/g.bag; pack one recording per archive."
    )


@pytest.mark.parametrize("packed", [_zipped, _tarred])
def test_what_lies_beside_a_recording_in_an_archive_is_passed_over(packed: Packed, tmp_path: Path) -> None:
    """Other compressed files, and what a Mac puts into each archive. Mutations: hidden names, hidden folders, any .zst taken."""
    names = ["a/notes.zst", "a/._room_0.mcap", "__MACOSX/a/._room_0.mcap", ".Trash/old.bag"]
    archive = packed(tmp_path, [*names, "a/room_0.mcap", "a/room_1.mcap"])
    (tmp_path / "to").mkdir()
    assert sorted(file.name for file in unpack_archive(archive, tmp_path / "to").iterdir()) == [
        "room_0.mcap",
        "room_1.mcap",
    ]


@pytest.mark.parametrize("names", [["h.bag", "other.bag"], ["a/h.bag", "b/h.bag"], ["h.bag", "g.db3"]])
def test_a_folder_of_two_recordings_is_refused_with_both(names: list[str], tmp_path: Path) -> None:
    """Seen: two merged, or the first folder's alone read in silence. Mutations: one folder looked at; one suffix."""
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"-")
    with pytest.raises(UnreadableRecording) as caught:
        recording_files(tmp_path)
    one, other = sorted(names)
    assert str(caught.value) == f"The folder {tmp_path.name} holds 2 recordings, {one} and {other}; give one of them."


@pytest.mark.parametrize("inside", [".", "room"])
def test_files_that_metadata_name_are_one_recording_whatever_their_names(inside: str, tmp_path: Path) -> None:
    """Mutations: it is not asked; files that it does not name are read too; it is believed where none of its files is there,
    or of files in other folders.
    """
    (tmp_path / inside).mkdir(exist_ok=True)
    for name in ("morning.mcap", "noon.mcap"):
        (tmp_path / inside / name).write_bytes(b"-")
    listed = "relative_file_paths:\n  - morning.mcap\n  - noon.mcap\n"
    (tmp_path / inside / "metadata.yaml").write_text(listed)
    assert [file.name for file in recording_files(tmp_path).files] == ["morning.mcap", "noon.mcap"]
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "noon.mcap").write_bytes(b"-")
    if inside == "room":  # another beside it; below it, it is what somebody made of it
        with pytest.raises(UnreadableRecording, match="holds 3 recordings"):
            recording_files(tmp_path)
    else:
        assert len(recording_files(tmp_path).files) == 2
    (tmp_path / "old" / "noon.mcap").unlink()
    (tmp_path / inside / "night.mcap").write_bytes(b"-")
    found = recording_files(tmp_path)
    assert ([f.name for f in found.files], [f.name for f in found.beside]) == (
        ["morning.mcap", "noon.mcap"],
        ["night.mcap"],
    )
    for name in ("morning.mcap", "noon.mcap"):  # the list of another recording
        (tmp_path / inside / name).rename(tmp_path / inside / f"another-{name}")
    with pytest.raises(UnreadableRecording, match="holds 3 recordings"):
        recording_files(tmp_path)


def test_hidden_files_are_no_recordings(tmp_path: Path) -> None:
    """What a Mac leaves on a disk that knows no attributes, and a folder of what was thrown away.

    Seen: "The file ._h.bag is no readable recording". Mutations: hidden files taken; hidden folders.
    """
    folder = tmp_path / ".kept" / "room"
    folder.mkdir(parents=True)
    build.write_ros1(folder / "h.bag", build.still_imu(0.5, cdr=False))
    (folder / "._h.bag").write_bytes(b"\0\5\x16\7")
    (folder / ".Trash").mkdir()
    (folder / ".Trash" / "old.bag").write_bytes(b"-")
    with open_recording(folder) as recording:
        assert [file.name for file in recording.files] == ["h.bag"]
        assert recording.topics[0].count == 50


@pytest.mark.parametrize("alone", [False, True])
def test_a_closed_folder_beside_a_recording_is_passed_over(
    alone: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`lost+found` at the root of a disk. Mutations: it ends the reading; nothing said of it where there is no other."""
    (tmp_path / "lost+found").mkdir()
    if not alone:
        (tmp_path / "h.bag").write_bytes(b"-")
    really = Path.iterdir

    def closed(folder: Path) -> Iterator[Path]:
        if folder.name == "lost+found":
            raise PermissionError(13, "Permission denied", str(folder))
        return really(folder)

    monkeypatch.setattr(Path, "iterdir", closed)
    if alone:
        with pytest.raises(UnreadableRecording, match=r"lost\+found may not be read by this user"):
            open_recording(tmp_path)
    else:
        assert recording_files(tmp_path).files == [tmp_path / "h.bag"]


def test_what_somebody_made_of_a_recording_below_it_is_passed_over(tmp_path: Path) -> None:
    """Mutation: another recording."""
    (tmp_path / "results").mkdir()
    for name in ("h.bag", "results/deskewed.bag"):
        (tmp_path / name).write_bytes(b"-")
    assert [file.name for file in recording_files(tmp_path).files] == ["h.bag"]
