"""Bags written again, as other programs see them: types, what publishers offered, other programs' messages, and their place."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from calib_core.errors import SettingsError
from calib_core.events import LogEvent
from calib_core.readers.container.opening import kind_of, open_recording
from calib_core.readers.container.storage import TopicSummary
from calib_core.readers.load import load
from calib_core.readers.write.bag_writer import _definition
from calib_core.readers.write.output import check_output
from calib_core.readers.write.rewrite import rewrite_clouds
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray, Scan
from tests.core.readers import build

N = 12
CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
#: A type that no store of types knows, so that only its own text tells its hash.
OWN, OWN_TEXT = "rig_msgs/msg/Tick", "uint32 number\nstring name\n"
TICK = struct.pack("<BBBBII", 0, 1, 0, 0, 7, 1) + b"\0"


def shifted(scan: Scan) -> FloatArray:
    """One metre along x."""
    return scan.points["xyz"].astype(np.float64) + np.array([1.0, 0.0, 0.0])


def room(*, cdr: bool) -> list[build.Message]:
    """Messages of a lidar and an IMU."""
    return build.in_order(build.velodyne_messages(N, cdr=cdr), build.still_imu(1.0, cdr=cdr))


def latched() -> Qos:
    """What /tf_static is offered with."""
    ever = QosTime(9223372036, 854775807)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        ever,
        ever,
        QosLiveliness.AUTOMATIC,
        ever,
        False,
    )


def ros2_room(folder: Path, *, plugin: StoragePlugin) -> Path:
    """A folder's one file, with types as a recorder writes them; an mcap has no place for their hashes."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Ros2Writer(folder / "r", version=9, storage_plugin=plugin) as writer:
        qos = {"/imu/data": (latched(),)}
        topics = {
            name: writer.add_connection(name, kind, typestore=store, offered_qos_profiles=qos.get(name, ()))
            for name, kind in (("/velodyne_points", CLOUD), ("/imu/data", IMU))
        }
        own = writer.add_connection("/ticks", OWN, msgdef=OWN_TEXT, rihs01="RIHS01_" + "5" * 64)
        for name, _, receive_ns, payload in room(cdr=True):
            writer.write(topics[name], receive_ns, payload)
        writer.write(own, build.EPOCH_NS + 10**9, TICK)
    return next(file for file in (folder / "r").iterdir() if file.suffix in (".mcap", ".db3"))


def test_types_have_the_hashes_that_readers_compare(tmp_path: Path) -> None:
    """An mcap written again as .db3 had hashes of zeros, and rosbags opened not one message of it. Oracle: rosbags' own reader.

    Mutation: zeros where the recording has no hash.
    """
    source = ros2_room(tmp_path, plugin=StoragePlugin.MCAP)
    assert rewrite_clouds(source, None, tmp_path / "out.db3", shifted) == N
    with AnyReader([tmp_path / "out.db3"]) as reader:
        told = {c.topic: c.digest for c in reader.connections}
        ticks = [reader.deserialize(p, c.msgtype) for c, _, p in reader.messages() if c.topic == "/ticks"]
    assert [tick.number for tick in ticks] == [7]
    store = get_typestore(Stores.ROS2_HUMBLE)
    assert told["/velodyne_points"] == store.hash_rihs01(CLOUD)
    assert told["/imu/data"] == store.hash_rihs01(IMU)
    assert told["/ticks"].startswith("RIHS01_")
    assert told["/ticks"].strip("RIHS01_")


TYPE = "a_msgs/msg/B"
NONE = "RIHS01_" + "0" * 64


@pytest.mark.parametrize(
    ("kind", "text", "digest"),
    [
        (TYPE, "uint32 x\n", "of the same type in IDL"),
        (
            TYPE,
            "=" * 80 + f"\nIDL: {TYPE}\nmodule a_msgs {{ module msg {{ struct B {{ uint32 x; }}; }}; }};\n",
            "of the same",
        ),
        (TYPE, "a_msgs/Lacking one\n", NONE),
        (TYPE, "no type at all ~\n", NONE),
        (IMU, "std_msgs/Header header\n", get_typestore(Stores.ROS2_HUMBLE).hash_rihs01(IMU)),
    ],
)
def test_a_text_of_any_kind_gets_a_hash_or_none(kind: str, text: str, digest: str) -> None:
    """A recorder's text may lack types, or be in DDS's language. Oracle: rosbags' hash of the same type written by hand.

    Mutations: what a text lacks ends the writing; IDL is read as ROS's own; a standard type's hash is not looked up.
    """
    same = get_typestore(Stores.EMPTY)
    same.register(get_types_from_msg("uint32 x", TYPE))
    told = _definition(TopicSummary("/t", kind, 1, "cdr", text), ros_version=2)
    assert told == (text, digest if digest.startswith("RIHS01_") else same.hash_rihs01(TYPE))


def test_a_hash_that_the_recording_has_is_kept(tmp_path: Path) -> None:
    """It is the recorder's, right or not. Mutation: hashes made anew."""
    source = ros2_room(tmp_path, plugin=StoragePlugin.SQLITE3)
    rewrite_clouds(source, None, tmp_path / "out.db3", shifted)
    with Ros2Reader(tmp_path / "out.db3") as reader:
        assert {c.digest for c in reader.connections if c.topic == "/ticks"} == {"RIHS01_" + "5" * 64}


@pytest.mark.parametrize("suffix", [".mcap", ".db3"])
@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_topics_are_offered_as_they_were_in_ros2(plugin: StoragePlugin, suffix: str, tmp_path: Path) -> None:
    """Static transforms were replayed to nobody who came late. Mutation: no qualities of service."""
    source, out = ros2_room(tmp_path, plugin=plugin), tmp_path / f"out{suffix}"
    rewrite_clouds(source, None, out, shifted)
    with Ros2Reader(out) as reader:
        offered = {c.topic: tuple(c.ext.offered_qos_profiles) for c in reader.connections}
    assert offered == {"/velodyne_points": (), "/imu/data": (latched(),), "/ticks": ()}


def test_topics_are_offered_as_they_were_in_ros1(tmp_path: Path) -> None:
    """Mutation: no latching."""
    with Ros1Writer(tmp_path / "r.bag") as writer:
        topics = {
            name: writer.add_connection(name, kind, msgdef="# none", md5sum="0" * 32, latching=latching)
            for name, kind, latching in (("/velodyne_points", CLOUD, None), ("/imu/data", IMU, 1))
        }
        for name, _, receive_ns, payload in room(cdr=False):
            writer.write(topics[name], receive_ns, payload)
    rewrite_clouds(tmp_path / "r.bag", None, tmp_path / "out.bag", shifted)
    with Ros1Reader(tmp_path / "out.bag") as reader:
        assert {c.topic: c.ext.latching for c in reader.connections} == {"/velodyne_points": None, "/imu/data": 1}


def mcap_of(path: Path, messages: list[build.Message], *, profile: str, written: str) -> Path:
    """An mcap as converters write it, without chunks or summary, and a topic of a web page's beside ROS's."""

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(op: int, body: bytes) -> bytes:
        return struct.pack("<BQ", op, len(body)) + body

    out = [b"\x89MCAP0\r\n", record(1, text(profile) + text("hand"))]
    types = {"/velodyne_points": CLOUD, "/imu/data": IMU, "/notes": "page.Note"}
    for number, (topic, kind) in enumerate(types.items(), start=1):
        is_note = topic == "/notes"
        schema = text("jsonschema" if is_note else "ros1msg") + text("{}" if is_note else "")
        out.append(record(3, struct.pack("<H", number) + text(kind) + schema))
        encoding = "json" if is_note else written
        out.append(record(4, struct.pack("<HH", number, number) + text(topic) + text(encoding) + struct.pack("<I", 0)))
    numbers = {topic: number for number, topic in enumerate(types, start=1)}
    notes = [("/notes", "page.Note", build.EPOCH_NS + 10**9, b'{"seen": true}')]
    for topic, _, receive_ns, payload in build.in_order(messages, notes):
        head = struct.pack("<HIQQ", numbers[topic], 0, receive_ns, receive_ns)
        out.append(record(5, head + payload))
    path.write_bytes(b"".join([*out, record(15, bytes(4)), record(2, bytes(20)), b"\x89MCAP0\r\n"]))
    return path


@pytest.mark.parametrize(("profile", "written", "suffix"), [("ros1", "ros1", ".bag"), ("", "cdr", ".mcap")])
def test_messages_of_others_are_left_out_with_a_word(profile: str, written: str, suffix: str, tmp_path: Path) -> None:
    """They were written into the bag as if they were ROS's.

    Mutations: every topic goes into the bag; nothing is said; a ROS 1 recording is known by `.bag` alone.
    """
    source = mcap_of(tmp_path / "r.mcap", room(cdr=written == "cdr"), profile=profile, written=written)
    out, said = tmp_path / f"out{suffix}", list[str]()
    check_output(source, out)
    moved = rewrite_clouds(
        source, None, out, shifted, on_event=lambda e: said.extend([e.text] if isinstance(e, LogEvent) else [])
    )
    assert moved == N
    assert said == ["/notes of r.mcap hold no messages of ROS and are left out of the bag."]
    with open_recording(out) as recording:
        assert [topic.name for topic in recording.topics] == ["/imu/data", "/velodyne_points"]
    settings = ReadSettings(range_min_m=1e-4, range_max_m=1e6)
    for before, after in zip(load(source, settings).scans, load(out, settings).scans, strict=True):
        np.testing.assert_array_equal(after.points["xyz"], shifted(before).astype(np.float32))


def test_ros1_in_an_mcap_becomes_a_ros1_bag_alone(tmp_path: Path) -> None:
    """It became an mcap of ROS 2 that nothing reads, in silence. Told before the work; where no profile tells, before writing.

    Mutations: the file's suffix tells its kind; the lidar's own messages are not asked.
    """
    source = mcap_of(tmp_path / "r.mcap", room(cdr=False), profile="ros1", written="ros1")
    assert kind_of(source) == "ros1"
    with pytest.raises(SettingsError, match=r"does not fit r\.mcap.*a \.bag file"):
        check_output(source, tmp_path / "out.mcap")
    unnamed = mcap_of(tmp_path / "u.mcap", room(cdr=False), profile="", written="ros1")
    with pytest.raises(SettingsError, match=r"does not fit u\.mcap.*a \.bag file"):
        rewrite_clouds(unnamed, None, tmp_path / "out.mcap", shifted)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["r.mcap", "u.mcap"]


@pytest.mark.parametrize("heard", [True, False])
def test_two_types_of_one_topic_are_not_mixed(heard: bool, tmp_path: Path) -> None:
    """After a node was changed for another, say: all its messages were written as of one type, in silence. A type of which no
    message came is none.

    Mutations: no check, before the work or on the way; a type without messages counts, or takes the other's place.
    """
    source, odd = tmp_path / "r.bag", "std_msgs/msg/String"
    with Ros1Writer(source) as writer:
        topics = {
            kind: writer.add_connection(name, kind, msgdef="# none", md5sum=32 * digit)
            for name, kind, digit in (
                ("/velodyne_points", CLOUD, "0"),
                ("/imu/data", IMU, "1"),
                ("/imu/data", odd, "2"),
            )
        }
        for _, kind, receive_ns, payload in room(cdr=False):
            writer.write(topics[kind], receive_ns, payload)
        if heard:
            writer.write(topics[odd], build.EPOCH_NS + 10**9, struct.pack("<I", 0))
    if not heard:
        check_output(source, tmp_path / "out.bag")
        rewrite_clouds(source, None, tmp_path / "out.bag", shifted)
        with Ros1Reader(tmp_path / "out.bag") as reader:
            assert {c.topic: c.msgtype for c in reader.connections if c.msgcount} == {
                "/velodyne_points": CLOUD,
                "/imu/data": IMU,
            }
        return
    for refuse in (check_output, lambda path, out: rewrite_clouds(path, None, out, shifted)):
        with pytest.raises(
            SettingsError, match=rf"/imu/data of r\.bag holds .* two types, {IMU} and {odd}, .*recording\.$"
        ):
            refuse(source, tmp_path / "out.bag")
    check_output(source, tmp_path / "out")
    assert rewrite_clouds(source, None, tmp_path / "out", shifted) == N


@pytest.mark.parametrize("given", ["here", "link", "mount"])
def test_a_folder_that_is_there_is_filled_and_not_replaced(
    given: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`--output .`, a link and a mounted disk ended as a defect after the whole solve.

    Mutations: the folder is removed and another put in its place; what is made on the way stays in it.
    """
    source = build.write_ros1(tmp_path / "r.bag", room(cdr=False))
    clouds = tmp_path / "clouds"
    clouds.mkdir()
    number = clouds.stat().st_ino
    if given == "here":
        monkeypatch.chdir(clouds)
    (tmp_path / "link").symlink_to(clouds)
    out = {"here": Path(), "link": tmp_path / "link", "mount": clouds}[given]
    if given == "mount":
        monkeypatch.setattr(Path, "rmdir", lambda path: pytest.fail(f"{path} is a disk's place"))
    check_output(source, out)
    assert rewrite_clouds(source, None, out, shifted) == N
    assert sorted(path.name for path in clouds.iterdir()) == [f"{k:06d}.ply" for k in range(N)]
    assert clouds.stat().st_ino == number


def test_a_bag_does_not_take_a_folders_place(tmp_path: Path) -> None:
    """Mutation: an empty folder called out.bag is removed for it."""
    source = build.write_ros1(tmp_path / "r.bag", room(cdr=False))
    (tmp_path / "out.bag").mkdir()
    with pytest.raises(SettingsError, match=r"out\.bag is a folder"):
        rewrite_clouds(source, None, tmp_path / "out.bag", shifted)
