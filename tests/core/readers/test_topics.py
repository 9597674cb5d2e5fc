"""Choosing topics: one fits or the caller says which; every refusal is one sentence that names what is there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.doctor import inspect
from calib_core.errors import Cancelled, InputError, PointTimeError, TopicError
from calib_core.events import LogEvent, StageEvent
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from tests.core.readers import build


def bag(folder: Path, *streams: list[build.Message]) -> Path:
    return build.write_ros1(folder / "r.bag", build.in_order(*streams))


def clouds(topic: str = "/velodyne_points", n: int = 8) -> list[build.Message]:
    return build.velodyne_messages(n, cdr=False, topic=topic)


def imu(topic: str = "/imu/data") -> list[build.Message]:
    return build.still_imu(1.0, cdr=False, topic=topic)


def refused(path: Path, settings: ReadSettings, kind: type[InputError]) -> str:
    with pytest.raises(kind) as caught:
        load(path, settings)
    text = str(caught.value)
    assert text.endswith(".")
    assert "\n" not in text
    report = inspect(path, settings)  # the doctor reports on the same recording and does not raise
    assert text in report.reasons
    return text


def test_no_lidar_and_no_imu(tmp_path: Path) -> None:
    """Mutation: return the first topic of the recording where none fits."""
    assert "has no lidar topic" in refused(bag(tmp_path, imu()), ReadSettings(), TopicError)
    (tmp_path / "b").mkdir()
    text = refused(bag(tmp_path / "b", clouds()), ReadSettings(), TopicError)
    assert "has no IMU topic" in text
    assert "/velodyne_points (sensor_msgs/msg/PointCloud2)" in text


def test_a_topic_without_a_whole_message_is_named_with_what_to_do(tmp_path: Path) -> None:
    """Mutation: do not look for topics of the right type that hold nothing."""
    whole = bag(tmp_path, clouds(), imu())
    cut = tmp_path / "cut.bag"
    cut.write_bytes(whole.read_bytes()[:9000])
    text = refused(cut, ReadSettings(), TopicError)
    assert "not one whole message of its lidar topic /velodyne_points" in text
    assert "cut short" in text
    report = inspect(cut, ReadSettings())
    assert not any("('" in reason for reason in report.reasons)


def test_several_topics_are_asked_for(tmp_path: Path) -> None:
    """Mutation: return fitting[0] where several fit."""
    path = bag(tmp_path, clouds("/a"), clouds("/b"), imu("/imu1"), imu("/imu2"))
    with pytest.raises(TopicError) as caught:
        load(path, ReadSettings())
    assert caught.value.candidates == ("/a", "/b")
    assert "choose one with --lidar-topic" in str(caught.value)
    with pytest.raises(TopicError) as caught:
        load(path, ReadSettings(lidar_topic="/b"))
    assert caught.value.candidates == ("/imu1", "/imu2")
    loaded = load(path, ReadSettings(lidar_topic="/b", imu_topic="/imu2"))
    assert (loaded.lidar.topic, loaded.imu.topic) == ("/b", "/imu2")
    report = inspect(path, ReadSettings())
    assert report.lidar_candidates == ("/a", "/b")
    assert report.imu_candidates == ("/imu1", "/imu2")
    assert report.verdict == "limited"


def test_a_named_topic_must_be_there_and_fit(tmp_path: Path) -> None:
    """Mutation: take a named topic without looking at its type."""
    path = bag(tmp_path, clouds(), imu())
    assert "is not in the recording" in refused(path, ReadSettings(lidar_topic="/nope"), TopicError)
    assert "is of type sensor_msgs/msg/Imu" in refused(path, ReadSettings(lidar_topic="/imu/data"), TopicError)
    assert "is of type sensor_msgs/msg/PointCloud2" in refused(
        path, ReadSettings(imu_topic="/velodyne_points"), TopicError
    )


def test_clouds_are_taken_before_their_packets(tmp_path: Path) -> None:
    """Mutation: list packets and clouds together in `lidar_topics`."""
    packets = [
        ("/velodyne_packets", "velodyne_msgs/msg/VelodyneScan", m[2], build.velodyne_scan([], cdr=False, stamp_ns=m[2]))
        for m in clouds()
    ]
    assert load(bag(tmp_path, clouds(), packets, imu()), ReadSettings()).lidar.topic == "/velodyne_points"


def test_packets_of_an_unknown_velodyne(tmp_path: Path) -> None:
    """Mutation: give unknown product bytes to the decoder."""
    body = bytearray(1206)
    body[1205] = 0x55
    packets = [
        (
            "/velodyne_packets",
            "velodyne_msgs/msg/VelodyneScan",
            m[2],
            build.velodyne_scan([(m[2], bytes(body))], cdr=False, stamp_ns=m[2]),
        )
        for m in clouds()
    ]
    text = refused(bag(tmp_path, packets, imu()), ReadSettings(), InputError)
    assert "/velodyne_packets" in text
    assert "0x55" in text


XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
#: Drivers' clouds without time: topic, frame, further fields, what the sentence must tell to change.
TIMELESS = {
    "livox format 0": (
        "/livox/lidar",
        "livox_frame",
        [("intensity", "<f4"), ("tag", "u1"), ("line", "u1")],
        "CustomMsg",
    ),
    "ouster xyz": ("/ouster/points", "os_lidar", [], "point_type:=original"),
    "ouster xyzi": ("/points", "os_sensor", [("intensity", "<f4")], "point_type:=original"),
    "ouster xyzir": ("/ouster/points", "os_lidar", [("intensity", "<f4"), ("ring", "<u2")], "point_type:=original"),
    "robosense xyzi": ("/rslidar_points", "rslidar", [("intensity", "<f4")], "POINT_TYPE=XYZIRT"),
    "sick default": ("/cloud", "world", [("i", "<f4")], "cloud_all_fields_"),
    "anything else": ("/points", "lidar", [("intensity", "<f4")], "a driver setting that keeps it"),
}


@pytest.mark.parametrize("name", TIMELESS)
def test_clouds_without_time_name_what_to_change(name: str, tmp_path: Path) -> None:
    """Mutation: leave `help_text` out of the sentence; drop an entry of `layouts._HELP`."""
    topic, frame_id, fields, advice = TIMELESS[name]
    scan = build.sweep()
    points = np.zeros(scan["ring"].size, [*XYZ, *fields])
    points["x"], points["y"], points["z"] = scan["xyz"].T
    kind = "sensor_msgs/msg/PointCloud2"
    stream = [
        (topic, kind, m[2], build.pointcloud2(points, cdr=False, stamp_ns=m[2], frame_id=frame_id)) for m in clouds()
    ]
    text = refused(bag(tmp_path, stream, imu()), ReadSettings(), PointTimeError)
    assert topic in text
    assert advice in text
    assert "--synthesise-point-time" in text


def test_other_sentences(tmp_path: Path) -> None:
    """Mutation: let an empty span, far points or a cloud without xyz through to the estimator."""
    path = bag(tmp_path, clouds(), imu())
    with pytest.raises(InputError, match=r"Nothing of r\.bag lies between 100 s"):
        load(path, ReadSettings(start_s=100.0))
    with pytest.raises(InputError, match="No scan on /velodyne_points holds a point between 500 m and"):
        load(path, ReadSettings(range_min_m=500.0, range_max_m=600.0))
    flat = np.zeros(10, [("range", "<f4"), ("time", "<f4")])
    stream = [
        ("/r", "sensor_msgs/msg/PointCloud2", m[2], build.pointcloud2(flat, cdr=False, stamp_ns=m[2])) for m in clouds()
    ]
    (tmp_path / "b").mkdir()
    assert "have no x, y and z" in refused(bag(tmp_path / "b", stream, imu()), ReadSettings(), InputError)


def test_events_and_cancel(tmp_path: Path) -> None:
    """Mutation: never poll `should_cancel`; report fractions above 1."""
    path = bag(tmp_path, clouds(n=60), build.still_imu(6.0, rate_hz=50, cdr=False))
    events: list[object] = []
    load(path, ReadSettings(), on_event=events.append)
    fractions = [e.fraction for e in events if isinstance(e, StageEvent)]
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert fractions == sorted(fractions)
    assert any(isinstance(e, LogEvent) and e.code == "imu.rate" for e in events)
    with pytest.raises(Cancelled):
        load(path, ReadSettings(), should_cancel=lambda: True)
    with pytest.raises(Cancelled):
        inspect(path, ReadSettings(), should_cancel=lambda: True)


def test_topics_of_an_earlier_run_are_taken_where_several_fit(tmp_path: Path) -> None:
    """`deskew` asked for --imu-topic of a recording with two IMUs, though its calibration names the one.

    Mutations: each of the two not looked at; before what the settings name; names that are not there.
    """
    lidars, imus = ("/left", "/right"), ("/box/imu", "/car/imu")
    streams = [*(clouds(topic) for topic in lidars), *(imu(topic) for topic in imus)]
    path = bag(tmp_path, *streams)
    read = load(path, ReadSettings(), topics_before=("/right", "/car/imu"))
    assert (read.lidar.topic, read.imu.topic) == ("/right", "/car/imu")
    own = ReadSettings(lidar_topic="/left", imu_topic="/box/imu")
    read = load(path, own, topics_before=("/right", "/car/imu"))
    assert (read.lidar.topic, read.imu.topic) == ("/left", "/box/imu")
    with pytest.raises(TopicError, match="2 lidar topics"):
        load(path, ReadSettings(), topics_before=("/top", "/car/imu"))
    (tmp_path / "one").mkdir()
    read = load(bag(tmp_path / "one", clouds(), imu()), ReadSettings(), topics_before=("/right", "/car/imu"))
    assert (read.lidar.topic, read.imu.topic) == ("/velodyne_points", "/imu/data")
