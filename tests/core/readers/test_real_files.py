"""Real sensors' files: decoded to the points of the driver's own .pcd, or refused with a sentence."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from calib_core.doctor import inspect
from calib_core.errors import InputError, TopicError
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.clouds.deskewed import azimuth_misfit_rad
from calib_core.readers.clouds.pointcloud2 import read_pointcloud2
from calib_core.readers.container.opening import open_recording
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.load import load
from calib_core.readers.scans import make_scan
from calib_core.readers.timing.point_time import PointTiming
from calib_core.settings import ReadSettings
from tests.core.readers import build


def pcd_points(path: Path) -> np.ndarray:
    """(N, 3) of a binary .pcd."""
    raw = path.read_bytes()
    end = raw.index(b"\n", raw.index(b"DATA binary")) + 1
    lines = dict(line.split(" ", 1) for line in raw[:end].decode().splitlines() if line[0] != "#")
    kinds = {"F": "f", "U": "u", "I": "i"}
    fields = zip(lines["FIELDS"].split(), lines["TYPE"].split(), lines["SIZE"].split(), strict=True)
    dtype = np.dtype([(name, f"<{kinds[kind]}{size}") for name, kind, size in fields])
    points = np.frombuffer(raw[end:], dtype, int(lines["POINTS"]))
    return np.stack([points[a] for a in "xyz"], 1)


@pytest.mark.parametrize(("sensor", "n_messages"), [("vlp16", 4), ("vlp32", 5)])
def test_velodyne_packets_decode_to_the_drivers_points(sensor: str, n_messages: int, real_data: Path) -> None:
    """Mutation: return None from `_advance_of_driver_s`; keep the vertical offsets in `_scan_decoder`."""
    folder = real_data / "velodyne_ros2_packets" / sensor
    expected = pcd_points(next(folder.glob("*.pcd")))
    with open_recording(next(p for p in folder.iterdir() if p.is_dir())) as recording:
        topic = recording.topics[0]
        decode = cloud_decoder(topic)
        clouds = [decode(message) for message in recording.messages([topic.name])]
    assert len(clouds) == n_messages
    points = np.concatenate([np.stack([c.points[a] for a in "xyz"], 1) for c in clouds])
    distance, _ = cKDTree(points).query(expected)
    assert np.mean(distance < 0.005) >= 0.99


def test_velodyne_packet_times_are_even(real_data: Path) -> None:
    """Mutation: take the first packet's own host stamp in `first_packet_ns` (jitters by a millisecond)."""
    folder = real_data / "velodyne_ros2_packets" / "vlp16"
    with open_recording(next(p for p in folder.iterdir() if p.is_dir())) as recording:
        topic = recording.topics[0]
        decode = cloud_decoder(topic)
        clouds = [decode(message) for message in recording.messages([topic.name])]
    # One scan's first laser follows the one before's last by what is left of a sequence of 55.296 us after 15 lasers of 2.304 us.
    # Measured: 20.0, 21.2 and 21.1 us; packets tell whole microseconds.
    for before, after in itertools.pairwise(clouds):
        last_ns = before.header_ns + round(float(before.points["time"].max()) * 1e9)
        assert after.header_ns - last_ns == pytest.approx(55_296 - 15 * 2_304, abs=1_500)
        assert before.points["time"].min() >= 0
    spans = [float(c.points["time"].max()) for c in clouds[:3]]
    assert max(spans) - min(spans) < 1e-5


def test_vls128_decodes(real_data: Path) -> None:
    """Mutation: remove 0xA1 from MODELS."""
    folder = real_data / "velodyne_ros2_packets" / "vls128"
    with open_recording(next(p for p in folder.iterdir() if p.is_dir())) as recording:
        decode = cloud_decoder(recording.topics[0])
        clouds = [decode(message) for message in recording.messages([recording.topics[0].name])]
    assert [c.points.size > 100_000 for c in clouds] == [True] * 4
    assert np.unique(clouds[1].points["ring"]).size > 120


@pytest.mark.parametrize(
    ("path", "topic", "model"),
    [
        ("hesai_ros2_packets/xt32/1673400677802009732", "/pandar_packets", "XT32"),
        ("ouster_ros1_packets/512x10_raw.bag", "/os_node0/lidar_packets", "OS"),
    ],
)
def test_other_packets_are_refused_by_topic_and_model(path: str, topic: str, model: str, real_data: Path) -> None:
    """Mutation: drop the foreign packets from `choose_lidar` (the sentence then says there is no lidar)."""
    with pytest.raises(TopicError) as caught:
        load(real_data / path, ReadSettings())
    assert topic in str(caught.value)
    assert model in str(caught.value)
    assert str(caught.value).endswith(".")
    report = inspect(real_data / path, ReadSettings())
    assert report.verdict == "unusable"
    assert any(topic in reason and model in reason for reason in report.reasons)


def test_static_vlp16_packets_as_a_whole_recording(real_data: Path, tmp_path: Path) -> None:
    """Mutation: count a packet message's `time` from the header instead of from the first packet."""
    raw = (real_data / "vlp16_static_packets" / "recording.bin").read_bytes()
    packets = [raw[i : i + 1206] for i in range(0, len(raw), 1206)]
    device_us = [struct.unpack_from("<I", p, 1200)[0] for p in packets]
    stamps = [build.EPOCH_NS + (us - device_us[0]) * 1000 for us in device_us]
    per_scan = 75
    scans: list[build.Message] = []
    for k in range(0, len(packets) - per_scan, per_scan):
        part = list(zip(stamps[k : k + per_scan], packets[k : k + per_scan], strict=True))
        body = build.velodyne_scan(part, cdr=False, stamp_ns=part[0][0])
        scans.append(("/velodyne_packets", "velodyne_msgs/msg/VelodyneScan", part[-1][0] + 2_000_000, body))
    path = build.write_ros1(tmp_path / "static.bag", build.in_order(scans, build.still_imu(1.3, cdr=False)))
    loaded = load(path, ReadSettings())
    assert len(loaded.scans) == len(scans) == 13
    assert loaded.lidar.frame_id == "velodyne"
    for k, scan in enumerate(loaded.scans):
        assert scan.points.size > 10_000
        assert abs(scan.stamp_ns - stamps[k * per_scan]) < 1_400_000
        assert 0.09e9 < scan.points["offset_ns"].max() < 0.105e9
    # The sensor stands still: most points of the last scan lie where the first scan had some.
    near, _ = cKDTree(loaded.scans[0].points["xyz"]).query(loaded.scans[-1].points["xyz"])
    assert np.quantile(near, 0.8) < 0.1


def test_a_serialized_cloud_of_another_writer(real_data: Path) -> None:
    """Mutation: align fields in `cloud_dtype` to their size."""
    payload = (real_data / "pointcloud2_message" / "dds_message.bin").read_bytes()
    cloud = read_pointcloud2(RawMessage("/points", 0, payload), "cdr")
    assert {"x", "y", "z", "ring", "timestamp"} <= set(cloud.names)
    assert cloud.points.size == cloud.width * cloud.height > 1000
    distance = np.linalg.norm(np.stack([cloud.points[a] for a in "xyz"], 1).astype(np.float64), axis=1)
    finite = np.isfinite(distance)
    assert np.mean(finite) > 0.3
    assert np.nanmax(distance) < 500
    times = cloud.points["timestamp"].astype(np.float64)[finite]
    assert 0.02 < np.quantile(times, 0.99) - np.quantile(times, 0.01) < 0.2


def test_imu_only_bag_is_reported_and_refused(real_data: Path) -> None:
    """Mutation: raise from `inspect` when no lidar topic fits."""
    path = real_data / "imu_only" / "test1.bag"
    with pytest.raises(InputError, match="no lidar topic"):
        load(path, ReadSettings())
    report = inspect(path, ReadSettings())
    assert report.verdict == "unusable"
    assert report.imu is not None
    assert report.lidar is None
    assert report.imu.readings == 11865
    assert abs(report.imu.stamps.rate_hz - 30.0) < 0.1
    assert abs(report.duration_s - 395.3) < 0.1


def test_real_imu_units_are_detected(real_data: Path) -> None:
    """Mutation: swap the two misfits in `detect_gyroscope`; compare the accelerometer's norm with 9.8 only."""
    from calib_core.readers.imu.units import detect_accelerometer_unit, detect_gyroscope

    table = np.genfromtxt(real_data / "imu_only" / "sensor_data.csv", delimiter=",", skip_header=1)
    stamps = np.rint(table[:, 0] * 1e9).astype(np.int64)
    gyro, accel = table[:, 1:4], table[:, 4:7]
    accel_unit, _ = detect_accelerometer_unit(stamps, gyro, accel, ReadSettings(), "/imu")
    assert accel_unit == "g"
    unit, findings = detect_gyroscope(stamps, gyro, accel * 9.80665, ReadSettings(), "/imu")
    assert unit == "deg_s"
    assert findings[0].confidence > 0.5
    unit, findings = detect_gyroscope(stamps, np.deg2rad(gyro), accel * 9.80665, ReadSettings(), "/imu")
    assert unit == "rad_s"
    assert [f.code for f in findings] == ["imu.gyroscope_unit"]  # no axis is called mirrored
    flipped = np.deg2rad(gyro) * (1, -1, 1)
    _, findings = detect_gyroscope(stamps, flipped, accel * 9.80665, ReadSettings(), "/imu")
    assert any(f.code == "imu.axis_signs" and "axis y" in f.text for f in findings)


def test_real_static_scans_are_not_called_deskewed(real_data: Path) -> None:
    """Mutation: take the azimuth of all rings together in `azimuth_misfit_rad`."""
    folder = next(p for p in (real_data / "velodyne_ros2_packets" / "vls128").iterdir() if p.is_dir())
    with open_recording(folder) as recording:
        decode = cloud_decoder(recording.topics[0])
        clouds = [decode(message) for message in recording.messages([recording.topics[0].name])]
    scan, _ = make_scan(clouds[1], 1, PointTiming("time", "s", "header-first", -1e7, 1.2e8), 0.3, 200.0)
    assert scan is not None
    misfit = azimuth_misfit_rad(scan)
    assert misfit is not None
    assert misfit < np.deg2rad(0.1)
