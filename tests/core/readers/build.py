"""Bags and messages written byte for byte as recorders and drivers write them, without the readers' help.

Messages are packed member by member here; containers are packed here too where a damaged or odd one is needed, and
written by rosbags' own writers otherwise.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
EPOCH_NS = 1_700_000_000_000_000_000


@dataclass
class Packer:
    """Appends members: ROS 1 without gaps, CDR aligned from after its four bytes of encapsulation.

    order: "<", or ">" for big-endian CDR, which says so in its encapsulation.
    """

    cdr: bool
    out: bytearray = field(default_factory=bytearray)
    order: str = "<"

    def put(self, code: str, *values: float) -> Packer:
        for value in values:
            size = struct.calcsize(self.order + code)
            if self.cdr:
                self.out += b"\0" * (-len(self.out) % size)
            self.out += struct.pack(self.order + code, value)
        return self

    def text(self, value: str) -> Packer:
        encoded = value.encode() + (b"\0" if self.cdr else b"")
        self.put("I", len(encoded))
        self.out += encoded
        return self

    def raw(self, value: bytes) -> Packer:
        self.out += value
        return self

    def header(self, stamp_ns: int, frame_id: str, seq: int = 0) -> Packer:
        if not self.cdr:
            self.put("I", seq)
        seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
        return self.put("I" if not self.cdr else "i", seconds).put("I", nanoseconds).text(frame_id)

    def bytes(self) -> bytes:
        encapsulation = {"<": b"\x00\x01\x00\x00", ">": b"\x00\x00\x00\x00"}[self.order]
        return (encapsulation if self.cdr else b"") + bytes(self.out)


def pointcloud2(
    points: NDArray[np.void],
    *,
    cdr: bool,
    stamp_ns: int,
    frame_id: str = "lidar",
    height: int = 1,
    row_padding: int = 0,
    bigendian: bool = False,
    dense: bool = True,
    order: str = "<",
) -> bytes:
    """A PointCloud2 whose fields, offsets and step are those of the array's dtype."""
    dtype = points.dtype
    width = points.size // height
    packer = Packer(cdr, order=order).header(stamp_ns, frame_id).put("I", height, width, len(dtype.names))
    for name in dtype.names:
        kind, offset = dtype.fields[name][:2]
        packer.text(name).put("I", offset).put("B", DATATYPES[kind.base.str[1:]]).put("I", *(kind.shape or (1,)))
    step = dtype.itemsize
    rows = points.reshape(height, width)
    body = b"".join(row.tobytes() + b"\xee" * row_padding for row in rows)
    packer.put("B", int(bigendian)).put("I", step, width * step + row_padding, len(body)).raw(body)
    return packer.put("B", int(dense)).bytes()


def imu_message(
    stamp_ns: int,
    gyro: Sequence[float],
    accel: Sequence[float],
    *,
    cdr: bool,
    frame_id: str = "imu",
    order: str = "<",
) -> bytes:
    """A sensor_msgs/Imu without orientation."""
    packer = Packer(cdr, order=order).header(stamp_ns, frame_id)
    packer.put("d", 0, 0, 0, 1, -1, *[0] * 8)
    return packer.put("d", *gyro, *[0] * 9, *accel, *[0] * 9).bytes()


def custom_msg(
    points: NDArray[np.void], *, cdr: bool, stamp_ns: int, frame_id: str = "livox_frame", order: str = "<"
) -> bytes:
    """A Livox CustomMsg; points with fields offset_time x y z reflectivity tag line."""
    packer = (
        Packer(cdr, order=order)
        .header(stamp_ns, frame_id)
        .put("Q", stamp_ns)
        .put("I", points.size)
        .put("B", 1, 0, 0, 0)
    )
    packer.put("I", points.size)
    for p in points:
        packer.put("I", int(p["offset_time"])).put("f", float(p["x"]), float(p["y"]), float(p["z"]))
        packer.put("B", int(p["reflectivity"]), int(p["tag"]), int(p["line"]))
    return packer.bytes()


def velodyne_scan(
    packets: Sequence[tuple[int, bytes]],
    *,
    cdr: bool,
    stamp_ns: int,
    frame_id: str = "velodyne",
    order: str = "<",
) -> bytes:
    """A velodyne_msgs/VelodyneScan of (stamp, 1206 bytes) packets."""
    packer = Packer(cdr, order=order).header(stamp_ns, frame_id).put("I", len(packets))
    for packet_ns, body in packets:
        seconds, nanoseconds = divmod(packet_ns, 1_000_000_000)
        packer.put("i" if cdr else "I", seconds).put("I", nanoseconds).raw(body)
    return packer.bytes()


Message = tuple[str, str, int, bytes]  # topic, type, receive_ns, payload


def write_ros1(
    path: Path, messages: Iterable[Message], *, compression: str | None = None, chunk: int = 1 << 20
) -> Path:
    """A ROS 1 bag by rosbags' writer, type definitions left empty."""
    writer = Ros1Writer(path)
    if compression:
        writer.set_compression(getattr(Ros1Writer.CompressionFormat, compression.upper()))
    writer.chunk_threshold = chunk
    with writer:
        connections = {}
        for topic, kind, receive_ns, payload in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, msgdef="# none", md5sum="0" * 32)
            writer.write(connections[topic], receive_ns, payload)
    return path


def write_ros2(path: Path, messages: Iterable[Message], *, plugin: str = "mcap", compress: str | None = None) -> Path:
    """A ROS 2 bag folder by rosbags' writer (plugin mcap or sqlite3; compress None, file or message)."""
    writer = Ros2Writer(
        path, version=9, storage_plugin=StoragePlugin.MCAP if plugin == "mcap" else StoragePlugin.SQLITE3
    )
    if compress:
        writer.set_compression(CompressionMode[compress.upper()], CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, kind, receive_ns, payload in messages:
            if topic not in connections:
                definition = MessageDefinition(MessageDefinitionFormat.MSG, "# none")
                connections[topic] = writer.add_connection(
                    topic, kind, msgdef=definition.data, rihs01="RIHS01_" + "0" * 64
                )
            writer.write(connections[topic], receive_ns, payload)
    return path


VELODYNE_DTYPE = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 12, 16, 18],
        "itemsize": 22,
    }
)


def sweep(
    n_columns: int = 90, n_rings: int = 16, *, seed: int = 0, period_s: float = 0.1
) -> dict[str, NDArray[np.float64]]:
    """One clockwise sweep of a spinning lidar in firing order: xyz (N, 3), ring, intensity, time_s from its start."""
    rng = np.random.default_rng(seed)
    column, ring = (a.ravel() for a in np.meshgrid(np.arange(n_columns), np.arange(n_rings), indexing="ij"))
    azimuth = -2 * np.pi * column / n_columns
    elevation = np.deg2rad(-15 + 30 * ring / max(n_rings - 1, 1))
    distance = rng.uniform(2, 30, column.size)
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], 1
    )
    time_s = period_s * (column + ring / n_rings * 0.5) / n_columns
    return {
        "xyz": distance[:, None] * direction,
        "ring": ring,
        "intensity": rng.integers(0, 255, column.size),
        "time_s": time_s,
    }


def velodyne_points(scan: dict[str, NDArray[np.float64]], shift_s: float = 0.0) -> NDArray[np.void]:
    """The sweep as velodyne_pointcloud packs it; shift_s -0.1 for headers at the last packet."""
    points = np.zeros(len(scan["ring"]), VELODYNE_DTYPE)
    points["x"], points["y"], points["z"] = scan["xyz"].T
    points["intensity"], points["ring"], points["time"] = scan["intensity"], scan["ring"], scan["time_s"] + shift_s
    return points


def still_imu(
    duration_s: float,
    rate_hz: float = 100.0,
    *,
    cdr: bool,
    topic: str = "/imu/data",
    start_ns: int = EPOCH_NS,
    order: str = "<",
) -> list[Message]:
    """Readings of an IMU on a table, with a little noise."""
    rng = np.random.default_rng(5)
    messages: list[Message] = []
    for k in range(int(duration_s * rate_hz)):
        stamp = start_ns + round(k * 1e9 / rate_hz)
        gyro, accel = rng.normal(0, 1e-3, 3), np.array([0, 0, 9.81]) + rng.normal(0, 1e-2, 3)
        messages.append(
            (topic, "sensor_msgs/msg/Imu", stamp + 500_000, imu_message(stamp, gyro, accel, cdr=cdr, order=order))
        )
    return messages


def velodyne_messages(
    n_scans: int, *, cdr: bool, shift_s: float = 0.0, topic: str = "/velodyne_points"
) -> list[Message]:
    """Scans at 10 Hz from EPOCH_NS; with shift_s the header moves by -shift_s so that the instants stay the same."""
    messages: list[Message] = []
    for k in range(n_scans):
        start = EPOCH_NS + k * 100_000_000
        header = start - round(shift_s * 1e9)
        points = velodyne_points(sweep(seed=k), shift_s)
        body = pointcloud2(points, cdr=cdr, stamp_ns=header, frame_id="velodyne")
        messages.append((topic, "sensor_msgs/msg/PointCloud2", start + 105_000_000, body))
    return messages


def in_order(*streams: Iterable[Message]) -> list[Message]:
    """All messages by receive time."""
    return sorted((m for stream in streams for m in stream), key=lambda m: m[2])
