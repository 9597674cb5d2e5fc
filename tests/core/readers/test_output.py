"""Where a recording written again goes: told before the work where it cannot, and there as a whole or not at all."""

from __future__ import annotations

import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calib_core import api
from calib_core.errors import Cancelled, SettingsError, UnreadableRecording
from calib_core.readers.container import unpacked
from calib_core.readers.container.opening import kind_of
from calib_core.readers.write.output import check_output
from tests.core.exporters.results import make_result

RESULT = make_result(np.eye(3), np.zeros(3))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """No reader is asked for more than the name."""
    (tmp_path / "in" / "old.ply").mkdir(parents=True)
    path = tmp_path / "in" / "room.bag"
    path.write_bytes(b"#ROSBAG V2.0\n")
    return path


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading, and what comes after it, is a failure of the test."""

    def works(*_: object, **__: object) -> None:
        pytest.fail("the recording was read before the output was looked at")

    monkeypatch.setattr("calib_core.readers.load.load", works)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize(
    ("out", "map_out", "words"),
    [
        ("room.mcap", None, r"does not fit room\.bag"),
        ("in", None, "exists already"),
        ("in/room.bag/clouds", None, "that is a file"),
        ("clouds", "map.xyz", r"\.ply or \.pcd for the map"),
        ("clouds", "none/map.ply", "folder for the map"),
        ("clouds", "in/old.ply", "is a folder"),
        ("clouds", "clouds/map.ply", "outside of"),
    ],
)
def test_what_cannot_be_written_is_told_before_the_recording_is_read(
    bag: Path, tmp_path: Path, out: str, map_out: str | None, words: str
) -> None:
    """Mutations: no `check_output` in `api.deskew`; each of its checks left out."""
    beside = None if map_out is None else tmp_path / map_out
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SettingsError, match=words):
        api.deskew(bag, RESULT, tmp_path / out, map_out=beside)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_that_takes_nothing_is_told(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: the writing is not asked for (the tests' user may write everywhere, so the system's answer is made up)."""
    monkeypatch.setattr("os.access", lambda path, _: Path(path) != tmp_path)
    with pytest.raises(SettingsError, match="Nothing may be written"):
        check_output(bag, tmp_path / "new" / "folder" / "clouds")


def test_the_kind_is_in_the_names(bag: Path, tmp_path: Path) -> None:
    """Also of a bag under compression and of an archive's. Mutations: the suffix of the archive taken; a missing file's kind."""
    assert kind_of(bag) == "ros1"
    for name, kind in (("a.mcap", "ros2"), ("b.bag.zst", "ros1"), ("c.bag.active", "ros1")):
        (tmp_path / name).touch()
        assert kind_of(tmp_path / name) == kind
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
        archive.write(bag, "room/room.bag")
    assert kind_of(tmp_path / "packed.zip") == "ros1"
    with pytest.raises(UnreadableRecording, match="There is no file or folder"):
        kind_of(tmp_path / "none.bag")


def test_an_archive_is_unpacked_once_for_all_that_open_it(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is gone afterwards. Mutation: `kept_unpacked` that shares nothing."""
    packed, folders = tmp_path / "packed.zip", []
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(bag, "room/room.bag")
    unpack = unpacked.unpack_archive
    monkeypatch.setattr(unpacked, "unpack_archive", lambda path, to: folders.append(to) or unpack(path, to))
    with unpacked.kept_unpacked():
        assert [kind_of(packed), kind_of(packed)] == ["ros1"] * 2
    assert len(folders) == 1
    assert not folders[0].parent.exists()


@pytest.mark.parametrize("stopped", [KeyboardInterrupt(), Cancelled("stopped"), OSError("no room"), None])
def test_the_map_is_there_with_the_scans_or_not_at_all(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stopped: BaseException | None
) -> None:
    """An older map stays as it was where the scans are not written. Mutations: the map written to its own name at once; the
    result's topics not handed on.
    """
    the_map = tmp_path / "map.ply"
    the_map.write_text("the older one")

    def rewrites(*_: object, **__: object) -> int:
        if stopped is not None:
            raise stopped
        return 3

    found_in = RESULT.provenance.recording

    def loads(*_: object, topics_before: tuple[str, str], **__: object) -> SimpleNamespace:
        assert topics_before == (found_in.lidar_topic, found_in.imu_topic)
        return SimpleNamespace(lidar=SimpleNamespace(topic="/points"))

    monkeypatch.setattr("calib_core.readers.load.load", loads)
    monkeypatch.setattr(
        "calib_core.full.known_extrinsic.held_motion", lambda *_, **__: SimpleNamespace(solved=None, deskew=None)
    )
    monkeypatch.setattr(
        api, "_write_map", lambda *words: next(w for w in words if isinstance(w, Path)).write_text("new")
    )
    monkeypatch.setattr("calib_core.readers.write.rewrite.rewrite_clouds", rewrites)
    if stopped is None:
        assert api.deskew(bag, RESULT, tmp_path / "clouds", map_out=the_map) == 3
    else:
        with pytest.raises(type(stopped)):
            api.deskew(bag, RESULT, tmp_path / "clouds", map_out=the_map)
    assert the_map.read_text() == ("new" if stopped is None else "the older one")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "map.ply"]
