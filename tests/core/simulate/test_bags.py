"""Bags against what rosbags' own deserialisers and plain struct arithmetic make of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from calib_core.errors import Cancelled, SettingsError
from calib_core.events import Event, StageEvent
from calib_core.simulate import SCENARIOS, TruthFile, generate, simulate, truth_path
from calib_core.simulate.sensors import HeaderAt
from calib_core.types import Float32Array, IntArray, Recording

#: Field, offset, PointField datatype, as each driver publishes them.
VELODYNE = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("intensity", 12, 7), ("ring", 16, 4), ("time", 18, 7)]
HESAI = [*VELODYNE[:5], ("timestamp", 18, 8)]
OUSTER = [
    *VELODYNE[:3],
    ("intensity", 16, 7),
    ("t", 20, 6),
    ("reflectivity", 24, 4),
    ("ring", 26, 4),
    ("ambient", 28, 4),
    ("range", 32, 6),
]
#: rosbags makes its message classes while it runs; this stands for any of them.
Message = SimpleNamespace
_NUMPY = {4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}


class Bag:
    """Every message of a bag, by rosbags alone."""

    def __init__(self, path: Path) -> None:
        store = get_typestore(Stores.ROS2_HUMBLE)
        self.clouds: list[tuple[Connection, int, Message]] = []
        self.imu: list[tuple[int, Message]] = []
        with AnyReader([path], default_typestore=store) as reader:
            for connection, received_ns, payload in reader.messages():
                message = reader.deserialize(payload, connection.msgtype)
                if connection.msgtype.endswith("Imu"):
                    self.imu.append((received_ns, message))
                else:
                    self.clouds.append((connection, received_ns, message))


def _stamp_ns(message: Message) -> int:
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _points(
    message: Message, fields: list[tuple[str, int, int]], step: int
) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    sent = [(f.name, f.offset, f.datatype) for f in message.fields]
    assert sent == fields
    assert message.point_step == step
    names, offsets, types = zip(*fields, strict=True)
    dtype = np.dtype({"names": names, "offsets": offsets, "formats": [_NUMPY[t] for t in types], "itemsize": step})
    return np.frombuffer(message.data.tobytes(), dtype)


def _check(recording: Recording, index: int, xyz: Float32Array, time_ns: IntArray, ring: IntArray) -> None:
    """The recording in memory against points as sent, valid ones only."""
    scan = recording.scans[index]
    returned = np.abs(xyz).sum(axis=1) > 0.0
    np.testing.assert_array_equal(scan.points["xyz"], xyz[returned])
    np.testing.assert_array_equal(scan.stamp_ns + scan.points["offset_ns"].astype(np.int64), time_ns[returned])
    np.testing.assert_array_equal(scan.points["ring"], ring[returned])
    assert scan.points["offset_ns"].min() == 0


@pytest.mark.parametrize("name", ["room.bag", "room.mcap", "room"])
def test_every_container_holds_the_recording_in_memory(tmp_path: Path, name: str) -> None:
    """Fails when a container loses a message, or the recording in memory keeps times finer than float32's.

    Velodyne: seconds after the header in float32, at offset 18 of 22.
    """
    recording, truth = generate("paper-normal", seed=3, duration_s=0.7)
    simulate("paper-normal", tmp_path / name, seed=3, duration_s=0.7)
    bag = Bag(tmp_path / name)
    assert len(bag.clouds) == recording.scans_total == 7
    for index, (connection, received_ns, message) in enumerate(bag.clouds):
        assert (connection.topic, message.header.frame_id) == ("/velodyne_points", "velodyne")
        points = _points(message, VELODYNE, 22)
        header_ns = _stamp_ns(message)
        assert points["time"].min() == 0.0
        assert points["time"].max() < 0.101
        time_ns = header_ns + np.round(points["time"].astype(np.float64) * 1e9).astype(np.int64)
        xyz = np.stack([points[axis] for axis in "xyz"], axis=1)
        _check(recording, index, xyz, time_ns, points["ring"].astype(np.int64))
        assert received_ns > time_ns.max()
    stamps = np.array([_stamp_ns(message) for _, message in bag.imu])
    np.testing.assert_array_equal(stamps, recording.imu.stamps_ns)
    for axis, letter in enumerate("xyz"):
        gyro = [getattr(message.angular_velocity, letter) for _, message in bag.imu]
        accel = [getattr(message.linear_acceleration, letter) for _, message in bag.imu]
        np.testing.assert_array_equal(gyro, recording.imu.gyro_rad_s[:, axis])
        np.testing.assert_array_equal(accel, recording.imu.accel_m_s2[:, axis])
    for received_ns, message in bag.imu:
        late = received_ns - _stamp_ns(message) - truth.time_offset_ns
        assert 0 < late < 20_000_000
        assert message.orientation_covariance[0] == -1.0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "room.truth.json"])


def test_a_header_at_the_last_packet_makes_times_negative(tmp_path: Path) -> None:
    """Fails when the header is the sweep's end instead of its last packet's first firing, or points move in time."""
    simulate("paper-normal-last-stamp", tmp_path / "room.bag", duration_s=0.5)
    first, _ = generate("paper-normal", duration_s=0.5)
    last, _ = generate("paper-normal", duration_s=0.5, header_at="last")
    for index, (_, _, message) in enumerate(Bag(tmp_path / "room.bag").clouds):
        time = _points(message, VELODYNE, 22)["time"]
        assert time.min() == pytest.approx(-(time.shape[0] / 16 - 24) * 55.296e-6, abs=1e-8)
        assert time.max() == pytest.approx(23 * 55.296e-6 + 15 * 2.304e-6, abs=1e-8)
        np.testing.assert_array_equal(first.scans[index].points["xyz"], last.scans[index].points["xyz"])
        assert abs(first.scans[index].stamp_ns - last.scans[index].stamp_ns) <= 4
        apart = first.scans[index].points["offset_ns"] - last.scans[index].points["offset_ns"]
        assert np.abs(apart).max() <= 8


@pytest.mark.parametrize("scenario", ["ouster", "outdoor", "livox"])
@pytest.mark.parametrize("header_at", ["first", "last"])
def test_a_header_that_cannot_be_chosen_is_refused(scenario: str, header_at: HeaderAt) -> None:
    """It had no effect, in silence. Mutation: no check."""
    with pytest.raises(SettingsError, match=rf"Velodyne cloud .*, found {scenario}, .*leave --header-at out"):
        generate(scenario, duration_s=0.5, header_at=header_at)


def test_hesai_stamps_absolute_seconds(tmp_path: Path) -> None:
    """Fails when `timestamp` is relative, or loses more than float64's 0.24 us."""
    recording, truth = generate("outdoor", duration_s=0.5)
    simulate("outdoor", tmp_path / "out.bag", duration_s=0.5)
    for index, (_, _, message) in enumerate(Bag(tmp_path / "out.bag").clouds):
        points = _points(message, HESAI, 26)
        header_ns = _stamp_ns(message)
        assert header_ns == truth.epoch_ns + index * 100_000_000
        assert not message.is_dense
        after_ns = (points["timestamp"] - header_ns // 10**9) * 1e9 - header_ns % 10**9
        assert (after_ns > -240).all()
        assert (after_ns < 100_000_000).all()
        xyz = np.stack([points[axis] for axis in "xyz"], axis=1)
        np.testing.assert_array_equal(recording.scans[index].points["xyz"], xyz)
        scan = recording.scans[index]
        read_ns = scan.stamp_ns - header_ns + scan.points["offset_ns"]
        assert np.abs(read_ns - after_ns).max() < 240.0


def test_ouster_is_organised_and_zero_where_nothing_came_back(tmp_path: Path) -> None:
    """Fails when rows and columns are swapped, when missing points are left out, or lost columns keep their time."""
    scenario = replace(SCENARIOS["ouster"], lidar=replace(SCENARIOS["ouster"].lidar, lost_columns_probability=0.05))
    recording, _ = generate(scenario, duration_s=0.5)
    simulate(scenario, tmp_path / "o.mcap", duration_s=0.5)
    for index, (_, _, message) in enumerate(Bag(tmp_path / "o.mcap").clouds):
        assert (message.height, message.width) == (64, 1024)
        points = _points(message, OUSTER, 48).reshape(64, 1024)
        assert (points["ring"] == np.arange(64)[:, None]).all()
        assert (points["t"] == points["t"][:1]).all()
        lost = points["t"][0] == 0
        lost[0] = False
        assert 20 < lost.sum() < 100
        assert (points["range"][:, lost] == 0).all()
        kept = np.flatnonzero(~lost)
        np.testing.assert_allclose(points["t"][0, kept], kept * 1e8 / 1024, atol=1.0)
        xyz = np.stack([points[axis] for axis in "xyz"], axis=-1).reshape(-1, 3)
        time_ns = (_stamp_ns(message) + points["t"].astype(np.int64)).reshape(-1)
        _check(recording, index, xyz, time_ns, points["ring"].reshape(-1).astype(np.int64))
        up = points["z"][:, kept] / np.maximum(points["range"][:, kept], 1) * 1000.0
        assert up[0].max() > 0.25
        assert up[-1].min() < -0.25


@pytest.mark.parametrize("name", ["l.bag", "l.mcap"])
def test_livox_messages_are_what_rosbags_itself_reads(tmp_path: Path, name: str) -> None:
    """Fails when a point is 20 bytes in ROS 1, the CDR point is unpadded, or the header is misaligned."""
    recording, truth = generate("livox", duration_s=0.5)
    simulate("livox", tmp_path / name, duration_s=0.5)
    bag = Bag(tmp_path / name)
    for index, (connection, _, message) in enumerate(bag.clouds):
        assert (connection.topic, connection.msgtype) == ("/livox/lidar", "livox_ros_driver2/msg/CustomMsg")
        assert message.timebase == _stamp_ns(message)
        sent = message.points
        assert message.point_num == len(sent) == 24_000
        xyz = np.array([(p.x, p.y, p.z) for p in sent], dtype=np.float32)
        time_ns = _stamp_ns(message) + np.array([p.offset_time for p in sent], dtype=np.int64)
        _check(recording, index, xyz, time_ns, np.array([p.line for p in sent]))
    norm = np.linalg.norm([[getattr(m.linear_acceleration, a) for a in "xyz"] for _, m in bag.imu], axis=1)
    assert norm[:100].mean() == pytest.approx(1.0, abs=0.01)
    assert truth.scenario.imu.accelerometer_unit == "g"


@pytest.mark.parametrize("ros1", [True, False])
@pytest.mark.parametrize("frame_id", ["a", "livox_frame", "frame_of_an_odd_length"])
def test_livox_bytes_are_those_of_a_general_serialiser(tmp_path: Path, ros1: bool, frame_id: str) -> None:
    """Fails when padding is computed from the wrong origin. Every length of frame name shifts the alignment."""
    scenario = replace(SCENARIOS["livox"], lidar=replace(SCENARIOS["livox"].lidar, frame_id=frame_id))
    path = tmp_path / ("l.bag" if ros1 else "l.mcap")
    simulate(scenario, path, duration_s=0.5)
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connection, _, payload = next(item for item in reader.messages() if "Custom" in item[0].msgtype)
        text = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line"
        store.register(get_types_from_msg(text, "livox_ros_driver2/msg/CustomPoint"))
        text = "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
        text += "CustomPoint[] points"
        store.register(get_types_from_msg(text, connection.msgtype))
        if ros1:
            message = store.deserialize_ros1(payload, connection.msgtype)
            assert bytes(store.serialize_ros1(message, connection.msgtype)) == bytes(payload)
        else:
            message = store.deserialize_cdr(payload, connection.msgtype)
            assert bytes(store.serialize_cdr(message, connection.msgtype)) == bytes(payload)


@pytest.mark.parametrize("scenario", ["walking-person", "ouster", "livox"])
def test_the_same_seed_gives_the_same_bytes(tmp_path: Path, scenario: str) -> None:
    """Fails when anything is drawn from an unseeded generator, depends on which thread came first, or on what lay in memory.

    Mutation: Ouster's records turned round by a copy, which leaves the bytes between their fields unwritten.
    """
    for name, seed in (("a.bag", 1), ("b.bag", 1), ("c.bag", 2)):
        simulate(scenario, tmp_path / name, seed=seed, duration_s=1.0)
    a, b, c = ((tmp_path / name).read_bytes() for name in ("a.bag", "b.bag", "c.bag"))
    assert a == b
    assert a != c
    assert truth_path(tmp_path / "a.bag").read_text() == truth_path(tmp_path / "b.bag").read_text()


def test_truth_beside_the_bag_has_the_options(tmp_path: Path) -> None:
    """Fails when an option is dropped, the quaternion's order changes, or the file is not what `TruthFile` reads."""
    half = float(np.sqrt(0.5))
    path = simulate(
        "paper-normal",
        tmp_path / "x.mcap",
        seed=9,
        mounting=(0.1, 0.2, -0.3, 0.0, 0.0, half, half),
        time_offset_s=-0.15,
        duration_s=1.0,
        noise=False,
    )
    assert path == tmp_path / "x.truth.json"
    raw = json.loads(path.read_text())
    np.testing.assert_allclose(
        raw["T_imu_lidar"]["matrix"], [[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, -0.3], [0, 0, 0, 1]], atol=1e-12
    )
    np.testing.assert_allclose(raw["T_imu_lidar"]["euler_xyz_deg"], [0.0, 0.0, 90.0], atol=1e-9)
    assert (raw["scenario"], raw["seed"]) == ("paper-normal", 9)
    assert (raw["time_offset_s"], raw["time_offset_ns"]) == (-0.15, -150_000_000)
    assert set(raw["noise"].values()) == {0.0}
    assert [plane["name"] for plane in raw["planes"]][:2] == ["floor", "ceiling"]
    assert TruthFile.model_validate(raw).to_json() == path.read_text()


def test_a_mounting_that_points_straight_up_is_told_without_a_warning(tmp_path: Path) -> None:
    """Its angles are those of its matrix. Oracle: three elementary rotations. Mutation: a library's warning let through."""
    half = float(np.sqrt(0.5))
    path = simulate(
        "paper-normal", tmp_path / "x.mcap", mounting=(0.0, 0.0, 0.0, 0.0, half, 0.0, half), duration_s=1.0, noise=False
    )
    transform = json.loads(path.read_text())["T_imu_lidar"]
    roll, pitch, yaw = np.radians(transform["euler_xyz_deg"])
    assert np.degrees(pitch) == pytest.approx(90.0)
    angles = Rotation.from_euler("z", yaw) * Rotation.from_euler("y", pitch) * Rotation.from_euler("x", roll)
    np.testing.assert_allclose(np.array(transform["matrix"])[:3, :3], angles.as_matrix(), atol=1e-9)


def test_stopping_leaves_nothing_behind(tmp_path: Path) -> None:
    """Fails when a cancelled run leaves its draft, or progress does not end at 1."""
    told: list[float] = []

    def hear(event: Event) -> None:
        if isinstance(event, StageEvent):
            told.append(event.fraction)

    with pytest.raises(Cancelled):
        simulate(
            "paper-normal", tmp_path / "x.bag", duration_s=2.0, on_event=hear, should_cancel=lambda: len(told) >= 3
        )
    assert list(tmp_path.iterdir()) == []
    assert told == pytest.approx([0.05, 0.1, 0.15])
    told.clear()
    simulate("paper-normal", tmp_path / "x.bag", duration_s=0.5, on_event=hear)
    assert told[-1] == 1.0


def test_a_recording_is_replaced_only_if_it_was_simulated(tmp_path: Path) -> None:
    """Fails when a stranger's file is overwritten, or a simulation cannot be repeated in its place."""
    for name in ("own.bag", "own"):
        simulate("static", tmp_path / name, seed=1, duration_s=0.5)
        simulate("static", tmp_path / name, seed=2, duration_s=0.5)
        assert json.loads((tmp_path / "own.truth.json").read_text())["seed"] == 2
        truth_path(tmp_path / name).unlink()
    (tmp_path / "precious.bag").write_text("a drive through the Alps")
    with pytest.raises(SettingsError, match=r"precious\.bag.*remove it"):
        simulate("static", tmp_path / "precious.bag", duration_s=0.5)
    assert (tmp_path / "precious.bag").read_text() == "a drive through the Alps"


def test_an_unknown_ending_is_refused(tmp_path: Path) -> None:
    """Fails when any suffix makes a folder."""
    with pytest.raises(SettingsError, match=r"\.bag, \.mcap"):
        simulate("static", tmp_path / "room.pcap", duration_s=0.5)
