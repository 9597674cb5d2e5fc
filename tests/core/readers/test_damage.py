"""Cut and damaged recordings: recovered as far as they go, with a finding, or refused in one sentence. No crash."""

from __future__ import annotations

import os
import re
import resource
import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import InputError, UnreadableRecording
from calib_core.readers.container.opening import open_recording
from calib_core.readers.container.recover_mcap import McapRecovery
from calib_core.readers.container.recover_sqlite import SqliteRecovery
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from calib_core.types import Recording
from tests.core.readers import build, damage

N_SCANS = 60


def messages(*, cdr: bool) -> list[build.Message]:
    return build.in_order(build.velodyne_messages(N_SCANS, cdr=cdr), build.still_imu(6.2, cdr=cdr))


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One intact file per container."""
    folder = tmp_path_factory.mktemp("bags")
    return {
        "plain.bag": build.write_ros1(folder / "plain.bag", messages(cdr=False), chunk=100_000),
        "lz4.bag": build.write_ros1(folder / "lz4.bag", messages(cdr=False), compression="lz4", chunk=100_000),
        "plain.mcap": next(build.write_ros2(folder / "m", messages(cdr=True)).glob("*.mcap")),
        "zstd.mcap": next(build.write_ros2(folder / "z", messages(cdr=True), compress="storage").glob("*.mcap")),
        "plain.db3": next(build.write_ros2(folder / "s", messages(cdr=True), plugin="sqlite3").glob("*.db3")),
    }


def attempt(path: Path) -> Recording | str:
    """The recording, or the sentence it was refused with."""
    try:
        return load(path, ReadSettings())
    except InputError as error:
        return str(error)


def is_one_sentence(text: str) -> bool:
    return text.endswith(".") and "\n" not in text and "Traceback" not in text and len(text) < 600


@pytest.mark.parametrize("name", ["plain.bag", "lz4.bag", "plain.mcap", "zstd.mcap", "plain.db3"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.1, 0.45, 0.7, 0.95, 0.999])
def test_truncated(name: str, share: float, bags: dict[str, Path], tmp_path: Path) -> None:
    """Mutation: return True from the end of `Ros1Recovery._scan` whatever was met; drop MIN_SCANS_OF_DAMAGED."""
    whole = bags[name].read_bytes()
    cut = tmp_path / name
    cut.write_bytes(whole[: int(len(whole) * share)])

    got = attempt(cut)

    if isinstance(got, str):
        assert is_one_sentence(got)
        assert name in got
        # half of the recording and more is enough, except where SQLite's own tree was cut away
        assert share < 0.5 or name == "plain.db3"
        return
    assert any(f.code == "recording.truncated" and f.level == "warning" for f in got.findings)
    assert len(got.scans) >= 20
    if name != "plain.db3":
        assert len(got.scans) >= int(N_SCANS * share) - 6
    for scan in got.scans:
        expected = build.sweep(seed=scan.index)
        np.testing.assert_array_equal(scan.points["xyz"], expected["xyz"].astype(np.float32))


@pytest.mark.parametrize("name", ["plain.bag", "lz4.bag"])
def test_unindexed_bag_is_read_whole(name: str, bags: dict[str, Path], tmp_path: Path) -> None:
    """Mutation: do not `_remember` the connections that stand inside chunks."""
    whole = bytearray(bags[name].read_bytes())
    at = whole.index(b"index_pos=") + len(b"index_pos=")
    index_pos = int.from_bytes(whole[at : at + 8], "little")
    whole[at : at + 8] = bytes(8)
    (tmp_path / f"{name}.active").write_bytes(whole[:index_pos])  # as a killed recorder leaves it
    got = attempt(tmp_path / f"{name}.active")
    assert isinstance(got, Recording)
    assert len(got.scans) == N_SCANS
    assert got.imu.stamps_ns.size == 620
    assert any(f.code == "recording.damaged" and "without an index" in f.text for f in got.findings)


@pytest.mark.parametrize("name", ["lz4.bag", "zstd.mcap"])
def test_a_damaged_chunk_in_the_middle_costs_that_chunk(name: str, bags: dict[str, Path], tmp_path: Path) -> None:
    """Mutation: do not fall back to recovery after damage met half-way."""
    whole = bytearray(bags[name].read_bytes())
    middle = len(whole) // 2
    if name == "zstd.mcap":  # rosbags' writer leaves the checksum out: hit the frame's own head
        starts = [m.start() for m in re.finditer(re.escape(b"\x28\xb5\x2f\xfd"), bytes(whole))]
        middle = min(starts, key=lambda at: abs(at - middle))
    whole[middle : middle + 40] = b"\xa5" * 40
    (tmp_path / name).write_bytes(whole)
    got = attempt(tmp_path / name)
    assert isinstance(got, Recording)
    assert N_SCANS - 35 <= len(got.scans) < N_SCANS
    assert any(f.code.startswith("recording.") and f.level == "warning" for f in got.findings)
    if name == "lz4.bag":
        assert len(got.scans) >= N_SCANS - 12
        assert got.scans[-1].stamp_ns - got.scans[0].stamp_ns > 5.5e9


def _record(op: int, content: bytes) -> bytes:
    return struct.pack("<BQ", op, len(content)) + content


def _text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def _chunk(payloads: dict[int, bytes], *, told: bool) -> bytes:
    """One of an mcap, by the format's own description. payloads: by log time.   told: whether it has a checksum, else 0."""
    inside = b"".join(_record(5, struct.pack("<HIQQ", 1, 0, at, at) + payload) for at, payload in payloads.items())
    checksum = zlib.crc32(inside) if told else 0
    head = struct.pack("<QQQI", min(payloads), max(payloads), len(inside), checksum)
    return _record(6, head + _text(b"") + struct.pack("<Q", len(inside)) + inside)


@pytest.mark.parametrize(("told", "left"), [(True, [3, 4]), (False, [1, 2, 3, 4])])
def test_a_chunk_whose_checksum_fails_is_not_believed(told: bool, left: list[int], tmp_path: Path) -> None:
    """Two chunks of two messages each, and a byte of the first message is another; where no checksum is told, nobody knows.

    Mutations: the checksum not compared; compared where there is none.
    """
    schema = _record(3, struct.pack("<H", 1) + _text(b"sensor_msgs/msg/Imu") + _text(b"ros2msg") + _text(b""))
    channel = _record(4, struct.pack("<HH", 1, 1) + _text(b"/imu") + _text(b"cdr") + struct.pack("<I", 0))
    chunks = [_chunk({1: b"first", 2: b"second"}, told=told), _chunk({3: b"third", 4: b"fourth"}, told=told)]
    whole = (
        b"\x89MCAP0\r\n"
        + _record(1, _text(b"ros2") + _text(b""))
        + schema
        + channel
        + b"".join(chunks)
        + _record(15, bytes(4))
    )
    path = tmp_path / "told.mcap"
    path.write_bytes(whole.replace(b"first", b"fIrst"))
    read = McapRecovery(path, "as asked")
    assert [message.receive_ns for message in read.messages(["/imu"], None, None)] == left
    assert [damage.kind for damage in read.damages] == (["holes"] if told else [])
    read.close()


def test_a_damaged_message_costs_itself(tmp_path: Path) -> None:
    """Mutation: let ZstdError out of `message_itself` (the rest of the file is then lost, or the program ends)."""
    whole = bytearray(damage.recording(tmp_path, "message.db3", n_scans=24, n_columns=30).read_bytes())
    starts = [m.start() for m in re.finditer(re.escape(b"\x28\xb5\x2f\xfd"), bytes(whole))]
    for at in starts[len(starts) // 2 : len(starts) // 2 + 3]:
        whole[at + 4 : at + 12] = b"\xff" * 8
    (tmp_path / "one.db3").write_bytes(whole)
    got = load(tmp_path / "one.db3", ReadSettings())
    assert len(got.scans) + got.imu.stamps_ns.size >= 24 + 260 - 3


@pytest.mark.parametrize("name", damage.CONTAINERS)
def test_flipped_bytes_never_crash(name: str, tmp_path: Path) -> None:
    """Mutation: raise KeyError instead of MalformedMessage in `Wire.unpack`; believe any chunk size.

    A slice of `python -m tests.core.readers.damage`, whose last full run is in bench/results/damage.md.
    """
    intact = damage.recording(tmp_path, name, n_scans=24, n_columns=30).read_bytes()
    tally = damage.run(name, damage.flips(intact, 12), tmp_path)
    assert not tally.defects
    assert tally.read + tally.refused == 12
    assert tally.read >= 2


def test_a_lying_chunk_size_does_not_take_memory(bags: dict[str, Path], tmp_path: Path) -> None:
    """Mutation: drop MAX_CHUNK_BYTES from `_usable` and read the claimed size at once."""
    whole = bytearray(bags["plain.bag"].read_bytes())
    whole[whole.index(b"index_pos=") + 10 :][:8] = bytes(8)
    at = whole.index(b"compression=none")
    at = whole.index(b"size=", at)
    whole[at + 5 + 4 : at + 5 + 8] = (0xFFFFFFF0).to_bytes(4, "little")
    (tmp_path / "liar.bag").write_bytes(whole)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    attempt(tmp_path / "liar.bag")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300_000  # kB


@pytest.mark.parametrize(
    ("name", "body", "expected"),
    [
        ("empty.bag", b"", "is empty"),
        ("text.bag", b"hello, this is no bag\n" * 20, "no readable recording"),
        ("text.mcap", b"hello, this is no bag\n" * 20, "no readable recording"),
        ("text.db3", b"hello, this is no bag\n" * 20, "no readable recording"),
        ("notes.txt", b"hello", "is no recording"),
        ("bad.zip", b"PK\x03\x04nonsense", "is damaged"),
        ("bad.tar.gz", b"\x1f\x8bnonsense", "is damaged"),
    ],
)
def test_files_that_are_no_recording(name: str, body: bytes, expected: str, tmp_path: Path) -> None:
    """Mutation: let StorageError out of `_open_file`; drop the size check in `_open_file`."""
    (tmp_path / name).write_bytes(body)
    with pytest.raises(UnreadableRecording, match=expected) as caught:
        open_recording(tmp_path / name)
    assert is_one_sentence(str(caught.value))
    assert name in str(caught.value)


def test_paths_that_are_no_recording(tmp_path: Path) -> None:
    """Mutations: drop the existence check in `_open_all`; ask a pipe, whose archive is waited for without end."""
    for name in ("pipe.bag", "pipe.tar"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(UnreadableRecording, match="found a pipe or a device; copy the recording into a file"):
            open_recording(tmp_path / name)
        (tmp_path / name).unlink()
    with pytest.raises(UnreadableRecording, match="There is no file or folder"):
        open_recording(tmp_path / "nowhere.bag")
    with pytest.raises(UnreadableRecording, match=r"holds no \.mcap"):
        open_recording(tmp_path)


@pytest.mark.parametrize(
    ("name", "seeds"),
    [("message.db3", (158, 851)), ("none.db3", (94, 163)), ("none.mcap", (235,)), ("zstd.mcap", (494, 584))],
)
def test_damage_that_once_ended_the_program(name: str, seeds: tuple[int, ...], tmp_path: Path) -> None:
    """Mutation: drop `_MAX_POINT_BYTES`; take a damaged topic's id as it is; let MemoryError pass `RosbagsStorage`."""
    intact = damage.recording(tmp_path, name, n_scans=24, n_columns=30).read_bytes()
    tally = damage.run(name, ((f"seed {s}", damage.flipped(intact, s)) for s in seeds), tmp_path)
    assert not tally.defects


def test_a_page_of_points_that_cannot_be_read_is_said(tmp_path: Path) -> None:
    """On opening stamps alone are read, and they lie elsewhere. Mutations: nothing is said; said once more on every pass."""
    path = tmp_path / "pages.db3"
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("PRAGMA page_size=1024")
        database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.execute("INSERT INTO topics VALUES(1, '/points', 'sensor_msgs/msg/PointCloud2')")
        for k in range(30):
            database.execute("INSERT INTO messages VALUES(?, 1, ?, ?)", (k, 10 * k, bytes([65 + k]) * 5000))
    whole = bytearray(path.read_bytes())
    page = whole.index(bytes([65 + 20]) * 1000) // 1024 + 1  # overflow of the message at 200
    whole[page * 1024 : page * 1024 + 4] = b"\x7f\xff\xff\xff"  # the next page lies nowhere
    path.write_bytes(whole)

    recovery = SqliteRecovery(path, "why")
    assert recovery.damages == []
    read = [message.receive_ns for message in recovery.messages(["/points"], None, None)]
    assert len(read) in {19, 20, 21}
    assert read == [10 * k for k in range(len(read))]
    list(recovery.messages(["/points"], None, None))
    ((file, kind, since_ns),) = [(d.file, d.kind, d.lost_from_ns) for d in recovery.damages]
    assert (file, kind, since_ns) == ("pages.db3", "cut", read[-1])
