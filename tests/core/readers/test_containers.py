"""Every container gives the same messages: the recording written in one way is the oracle for all others."""

from __future__ import annotations

import shutil
import sqlite3
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import UnreadableRecording
from calib_core.readers.container.archive import unpack_archive
from calib_core.readers.container.compression import zstd
from calib_core.readers.container.opening import open_recording
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from tests.core.readers import build

N_SCANS = 12


def recording(*, cdr: bool) -> list[build.Message]:
    return build.in_order(build.velodyne_messages(N_SCANS, cdr=cdr), build.still_imu(1.5, cdr=cdr))


def ros1(compression: str | None) -> Callable[[Path], Path]:
    return lambda folder: build.write_ros1(
        folder / "r.bag", recording(cdr=False), compression=compression, chunk=20_000
    )


def ros2(plugin: str, compress: str | None = None, *, lone: bool = False) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = build.write_ros2(folder / "r", recording(cdr=True), plugin=plugin, compress=compress)
        return next(path.glob("r*.[md]*[p3]")) if lone else path

    return write


def without_metadata(folder: Path) -> Path:
    path = ros2("mcap")(folder)
    (path / "metadata.yaml").unlink()
    return path


def zipped(folder: Path) -> Path:
    path = ros2("sqlite3")(folder)
    with zipfile.ZipFile(folder / "r.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for file in path.iterdir():
            archive.write(file, f"room/{file.name}")
    return folder / "r.zip"


def tarred(folder: Path) -> Path:
    path = ros2("mcap")(folder)
    with tarfile.open(folder / "r.tar.gz", "w:gz") as archive:
        archive.add(path, "room")
    return folder / "r.tar.gz"


def without_definitions(folder: Path) -> Path:
    """As recorders before schema 4 wrote it: two tables, no definitions, an empty serialization format."""
    (folder / "old").mkdir()
    database = sqlite3.connect(folder / "old" / "old_0.db3")
    database.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
        " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    database.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT"
        " NULL, data BLOB NOT NULL)"
    )
    ids: dict[str, int] = {}
    for topic, kind, receive_ns, payload in recording(cdr=True):
        if topic not in ids:
            ids[topic] = len(ids) + 1
            database.execute("INSERT INTO topics VALUES (?, ?, ?, '', '')", (ids[topic], topic, kind))
        database.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", (ids[topic], receive_ns, payload)
        )
    database.commit()
    database.close()
    return folder / "old"


def split(folder: Path) -> Path:
    """Twelve files named without leading zeros, as the recorder splits: name order is not time order."""
    messages = recording(cdr=True)
    (folder / "s").mkdir()
    for k in range(12):
        part = messages[k * len(messages) // 12 : (k + 1) * len(messages) // 12]
        made = build.write_ros2(folder / f"part{k}", part, plugin="mcap")
        shutil.move(next(made.glob("*.mcap")), folder / "s" / f"s_{k}.mcap")
    return folder / "s"


def split_ros1(folder: Path) -> Path:
    messages = recording(cdr=False)
    (folder / "s").mkdir()
    for k in range(3):
        build.write_ros1(folder / "s" / f"s_{k}.bag", messages[k * len(messages) // 3 : (k + 1) * len(messages) // 3])
    return folder / "s"


CONTAINERS: dict[str, Callable[[Path], Path]] = {
    "ros1": ros1(None),
    "ros1-lz4": ros1("lz4"),
    "ros1-bz2": ros1("bz2"),
    "mcap-folder": ros2("mcap"),
    "mcap-lone": ros2("mcap", lone=True),
    "mcap-zstd": ros2("mcap", "storage"),
    "sqlite-folder": ros2("sqlite3"),
    "sqlite-lone": ros2("sqlite3", lone=True),
    "sqlite-zstd-file": ros2("sqlite3", "file"),
    "sqlite-zstd-message": ros2("sqlite3", "message"),
    "mcap-zstd-file": ros2("mcap", "file"),
    "no-metadata": without_metadata,
    "zip": zipped,
    "tar.gz": tarred,
    "no-definitions": without_definitions,
    "split": split,
    "split-ros1": split_ros1,
}


@pytest.mark.parametrize("container", CONTAINERS)
def test_every_container_gives_the_same_recording(container: str, tmp_path: Path) -> None:
    """Mutation: return the payload as it is from `message_itself` ("sqlite-zstd-message")."""
    path = CONTAINERS[container](tmp_path)
    loaded = load(path, ReadSettings())
    assert len(loaded.scans) == N_SCANS
    assert loaded.imu.stamps_ns.size == 150
    for k, scan in enumerate(loaded.scans):
        expected = build.sweep(seed=k)
        assert scan.index == k
        assert abs(scan.stamp_ns - (build.EPOCH_NS + k * 100_000_000)) <= 1
        np.testing.assert_array_equal(scan.points["xyz"], expected["xyz"].astype(np.float32))
        np.testing.assert_array_equal(scan.points["ring"], expected["ring"])
        np.testing.assert_allclose(scan.points["offset_ns"] * 1e-9, expected["time_s"], atol=8e-9)


@pytest.mark.parametrize("container", ["ros1", "split", "zip"])
def test_messages_come_in_receive_order_with_counts(container: str, tmp_path: Path) -> None:
    """Mutation: chain the storages in `OpenRecording.messages` instead of merging them, files in plain name order."""
    with open_recording(CONTAINERS[container](tmp_path)) as opened:
        counts = {t.name: t.count for t in opened.topics}
        times = [m.receive_ns for m in opened.messages(counts)]
    assert counts == {"/imu/data": 150, "/velodyne_points": N_SCANS}
    assert times == sorted(times)
    assert len(times) == 150 + N_SCANS


def test_a_span_is_cut_by_receive_time(tmp_path: Path) -> None:
    """Mutation: drop `start_ns` in `Reading.run`."""
    path = ros1(None)(tmp_path)
    loaded = load(path, ReadSettings(start_s=0.5, end_s=1.0))
    received = [build.EPOCH_NS + k * 100_000_000 + 105_000_000 for k in range(N_SCANS)]
    first = build.EPOCH_NS + 500_000  # the first IMU message is the recording's first
    inside = [k for k, t in enumerate(received) if first + 500_000_000 <= t <= first + 1_000_000_000]
    assert [round((s.stamp_ns - build.EPOCH_NS) / 1e8) for s in loaded.scans] == inside


def test_an_archive_cannot_write_outside_its_folder(tmp_path: Path) -> None:
    """Mutation: use the member's own name as the target in `unpack_archive`."""
    inner = ros2("mcap", lone=True)(tmp_path)
    with zipfile.ZipFile(tmp_path / "evil.zip", "w") as archive:
        archive.write(inner, "../../escaped.mcap")
    target = tmp_path / "in" / "deep"
    target.mkdir(parents=True)
    unpack_archive(tmp_path / "evil.zip", target)
    assert [p.name for p in target.iterdir()] == ["escaped.mcap"]
    assert not (tmp_path / "escaped.mcap").exists()


def test_an_archive_bomb_ends_in_a_sentence(tmp_path: Path) -> None:
    """Mutation: do not subtract from the budget in `_copy`."""
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("big.mcap", b"\0" * 3_000_000)
    (tmp_path / "to").mkdir()
    with pytest.raises(UnreadableRecording, match="more than there is room for"):
        unpack_archive(tmp_path / "bomb.zip", tmp_path / "to", max_bytes=1_000_000)


def test_a_folder_hashes_by_name_order_and_content(tmp_path: Path) -> None:
    """Mutation: hash the names too, or sort in reverse, in `recording_sha256`."""
    import hashlib

    folder = tmp_path / "f"
    (folder / "sub").mkdir(parents=True)
    contents = {"b.mcap": b"two", "a.yaml": b"one", "sub/c.mcap": b"three"}
    for name, body in contents.items():
        (folder / name).write_bytes(body)
    digests = [hashlib.sha256(contents[name]).hexdigest() for name in sorted(contents)]
    from calib_core.readers.container.fingerprint import recording_sha256

    assert recording_sha256(folder) == hashlib.sha256("".join(digests).encode()).hexdigest()
    assert recording_sha256(folder / "b.mcap") == hashlib.sha256(b"two").hexdigest()


@pytest.mark.parametrize("name", ["R.BAG", "R.MCAP", "R.Db3", "R.Bag.ACTIVE", "R.MCAP.ZST"])
@pytest.mark.parametrize("packed", [False, True])
def test_upper_case_counts_as_lower_case(name: str, packed: bool, tmp_path: Path) -> None:
    """Seen: "ROOM.BAG is no recording", and an archive of it "holds no .bag". Mutation: suffixes compared as they are."""
    stored = name.lower().split(".")[1]
    path = (
        ros1(None)(tmp_path)
        if stored == "bag"
        else ros2("mcap" if stored == "mcap" else "sqlite3", lone=True)(tmp_path)
    )
    content = path.read_bytes()
    path = tmp_path / name
    path.write_bytes(zstd.compress(content) if name.endswith(".ZST") else content)
    if packed:
        with zipfile.ZipFile(tmp_path / "R.ZIP", "w") as archive:
            archive.write(path, f"R/{name}")
        path = tmp_path / "R.ZIP"
    loaded = load(path, ReadSettings())
    assert (len(loaded.scans), loaded.imu.stamps_ns.size) == (N_SCANS, 150)
    assert not any(finding.code == "recording.damaged" for finding in loaded.findings)  # read by its index


def test_an_encrypted_archive_is_told_to_be_one(tmp_path: Path) -> None:
    """Seen: "is damaged (File <ZipInfo filename=...> is encrypted, ...); copy or pack it again". Mutation: not looked at."""
    path = zipped(tmp_path)
    content = bytearray(path.read_bytes())
    for mark, flags in ((b"PK\3\4", 6), (b"PK\1\2", 8)):  # the format's own bit, in both of a member's headers
        at = content.find(mark)
        while at >= 0:
            content[at + flags] |= 1
            at = content.find(mark, at + 4)
    path.write_bytes(content)
    with pytest.raises(UnreadableRecording, match=r"^The archive r\.zip is encrypted; unpack it with its password"):
        open_recording(path)


@pytest.mark.parametrize("packed", ["zip", "tar"])
def test_links_in_an_archive_are_passed_over_and_told_where_there_is_nothing_else(packed: str, tmp_path: Path) -> None:
    """Seen: where it leads read as a recording, "file is not a database". Mutation: a link's bytes taken for a file's."""
    path = ros2("sqlite3", lone=True)(tmp_path)
    archive = tmp_path / f"r.{packed}"

    def pack(*, with_file: bool) -> None:
        if packed == "tar":
            with tarfile.open(archive, "w") as out:
                member = tarfile.TarInfo("room/link_0.db3")
                member.type, member.linkname = tarfile.SYMTYPE, str(path)
                out.addfile(member)
                if with_file:
                    out.add(path, "room/r.db3")
            return
        with zipfile.ZipFile(archive, "w") as out:
            info = zipfile.ZipInfo("room/link_0.db3")
            info.create_system, info.external_attr = 3, 0o120777 << 16
            out.writestr(info, str(path))
            if with_file:
                out.write(path, "room/r.db3")

    pack(with_file=False)
    with pytest.raises(UnreadableRecording, match=r"holds no recording but links to it \(room/link_0\.db3\)"):
        open_recording(archive)
    pack(with_file=True)
    with open_recording(archive) as opened:
        assert [file.name for file in opened.files] == ["r.db3"]


def test_an_archive_with_a_list_is_one_recording_whatever_its_files_are_called(tmp_path: Path) -> None:
    """As a folder is, and as the browser packs one: the list first. Mutations: the list not asked; believed of files that it does
    not name.
    """
    text = "relative_file_paths:\n  - morning.mcap\n  - noon.mcap\n"

    def pack(*names: str) -> Path:
        with zipfile.ZipFile(tmp_path / "day.zip", "w") as archive:
            for name in names:
                archive.writestr(f"day/{name}", text if name == "metadata.yaml" else "-")
        return tmp_path / "day.zip"

    for name in ("out", "again"):
        (tmp_path / name).mkdir()
    unpack_archive(pack("metadata.yaml", "morning.mcap", "noon.mcap"), tmp_path / "out")
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"metadata.yaml", "morning.mcap", "noon.mcap"}
    with pytest.raises(UnreadableRecording, match="holds 3 recordings"):
        unpack_archive(pack("metadata.yaml", "morning.mcap", "night.mcap", "noon.mcap"), tmp_path / "again")
    (tmp_path / "late").mkdir()
    with pytest.raises(UnreadableRecording, match="holds 2 recordings"):  # the list too late to say so
        unpack_archive(pack("morning.mcap", "noon.mcap", "metadata.yaml"), tmp_path / "late")
