"""Simulated messages into a bag: ROS 1, or ROS 2 as mcap or sqlite3, through rosbags' own writers.

A recording appears under its name only when it is complete: it is written beside it and moved.
"""

from __future__ import annotations

import shutil
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from calib_core.errors import SettingsError
from calib_core.simulate.layouts import Cloud, StructArray
from calib_core.simulate.simulation import ImuRecords

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg

Container = Literal["ros1", "mcap", "sqlite3"]

_SECOND_NS = 1_000_000_000
_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
_IMU_TYPE = "sensor_msgs/msg/Imu"
_LIVOX_TYPE = "livox_ros_driver2/msg/CustomMsg"
_LIVOX_DEFINITIONS = {
    "livox_ros_driver2/msg/CustomPoint": (
        "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
    ),
    _LIVOX_TYPE: (
        "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
        "CustomPoint[] points\n"
    ),
}
#: PointField's numbers for the types that drivers use.
_DATATYPES = {"uint8": 2, "uint16": 4, "int32": 5, "uint32": 6, "float32": 7, "float64": 8}


def container_of(out: Path) -> Container:
    """The container that the path's suffix asks for. Raises SettingsError for any other suffix."""
    containers: dict[str, Container] = {".bag": "ros1", ".mcap": "mcap", "": "sqlite3"}
    if out.suffix not in containers:
        raise SettingsError(
            f"expected an output that ends in .bag, .mcap or nothing (a ROS 2 folder), found {out.name!r}; "
            "choose one of these endings",
            code="simulate.container",
        )
    return containers[out.suffix]


class BagSink:
    """An open bag that takes clouds and IMU messages in the order they were received."""

    def __init__(self, path: Path, container: Container, *, lidar_topic: str, imu_topic: str, cloud_kind: str) -> None:
        ros1 = container == "ros1"
        self._store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        for name, text in _LIVOX_DEFINITIONS.items():
            self._store.register(get_types_from_msg(text, name))
        self._ros1 = ros1
        self._writer: Ros1Writer | Ros2Writer
        if ros1:
            self._writer = Ros1Writer(path)
        else:
            plugin = StoragePlugin.MCAP if container == "mcap" else StoragePlugin.SQLITE3
            self._writer = Ros2Writer(path, version=9, storage_plugin=plugin)
        self._writer.open()
        self._lidar = self._connect(lidar_topic, _CLOUD_TYPE if cloud_kind == "PointCloud2" else _LIVOX_TYPE)
        self._imu = self._connect(imu_topic, _IMU_TYPE)
        self._seq = [0, 0]

    def _connect(self, topic: str, msgtype: str) -> Connection:
        return self._writer.add_connection(topic, msgtype, typestore=self._store)

    def close(self) -> None:
        """Finish the bag."""
        self._writer.close()

    def abort(self) -> None:
        """Leave the bag unfinished."""
        self._writer.abort()

    def add_cloud(self, cloud: Cloud, received_ns: int, frame_id: str) -> None:
        """Write one cloud."""
        if cloud.kind == "CustomMsg":
            payload: bytes | memoryview = self._livox(cloud, frame_id)
        else:
            payload = self._serialize(self._point_cloud(cloud, frame_id), _CLOUD_TYPE)
        self._writer.write(self._lidar, received_ns, payload)
        self._seq[0] += 1

    def add_imu(self, records: ImuRecords, index: int, frame_id: str) -> None:
        """Write one reading. The orientation is marked as not given."""
        types = self._store.types
        vector = types["geometry_msgs/msg/Vector3"]
        unknown = np.zeros(9)
        unknown[0] = -1.0
        message = types[_IMU_TYPE](
            header=self._header(int(records.stamps_ns[index]), frame_id, self._seq[1]),
            orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=unknown,
            angular_velocity=vector(*(float(v) for v in records.gyro_rad_s[index])),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(*(float(v) for v in records.accel[index])),
            linear_acceleration_covariance=np.zeros(9),
        )
        self._writer.write(self._imu, int(records.received_ns[index]), self._serialize(message, _IMU_TYPE))
        self._seq[1] += 1

    def _serialize(self, message: object, msgtype: str) -> memoryview:
        return (
            self._store.serialize_ros1(message, msgtype) if self._ros1 else self._store.serialize_cdr(message, msgtype)
        )

    def _header(self, stamp_ns: int, frame_id: str, seq: int) -> Msg:
        types = self._store.types
        sec, nanosec = divmod(stamp_ns, _SECOND_NS)
        stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        header = types["std_msgs/msg/Header"]
        return header(seq=seq, stamp=stamp, frame_id=frame_id) if self._ros1 else header(stamp=stamp, frame_id=frame_id)

    def _point_cloud(self, cloud: Cloud, frame_id: str) -> Msg:
        types = self._store.types
        step = cloud.points.dtype.itemsize
        field = types["sensor_msgs/msg/PointField"]
        layout = dict(cloud.points.dtype.fields or {})
        fields = [
            field(name=name, offset=int(entry[1]), datatype=_DATATYPES[entry[0].name], count=1)
            for name, entry in layout.items()
        ]
        return types[_CLOUD_TYPE](
            header=self._header(cloud.stamp_ns, frame_id, self._seq[0]),
            height=cloud.height,
            width=cloud.width,
            fields=fields,
            is_bigendian=False,
            point_step=step,
            row_step=step * cloud.width,
            data=cloud.points.view(np.uint8).reshape(-1),
            is_dense=cloud.is_dense,
        )

    def _livox(self, cloud: Cloud, frame_id: str) -> bytes:
        """CustomMsg byte by byte: 19 bytes a point in ROS 1; in CDR 20, but for the last."""
        sec, nanosec = divmod(cloud.stamp_ns, _SECOND_NS)
        name = frame_id.encode() + (b"" if self._ros1 else b"\0")
        head = struct.pack("<I", self._seq[0]) if self._ros1 else b""
        head += struct.pack("<III", sec, nanosec, len(name)) + name
        n = cloud.points.shape[0]
        if not self._ros1:
            head += b"\0" * (-len(head) % 8)
        head += struct.pack("<QIB3xI", cloud.stamp_ns, n, 0, n)
        if self._ros1:
            return head + cloud.points.tobytes()
        return b"\0\1\0\0" + head + _padded(cloud.points, 20)


def _padded(points: StructArray, stride: int) -> bytes:
    names = points.dtype.names or ()
    wide = np.dtype(
        {
            "names": list(names),
            "formats": [points.dtype[name] for name in names],
            "offsets": [points.dtype.fields[name][1] for name in names] if points.dtype.fields else [],
            "itemsize": stride,
        }
    )
    out = np.zeros(points.shape[0], wide)
    for name in names:
        out[name] = points[name]
    return out.tobytes()[: points.shape[0] * stride - (stride - points.dtype.itemsize)]


@contextmanager
def finished_file(out: Path, container: Container) -> Iterator[Path]:
    """A path to write a bag to; moved to `out` when the block ends well, removed when it does not."""
    out.parent.mkdir(parents=True, exist_ok=True)
    workshop = Path(tempfile.mkdtemp(prefix=".simulate-", dir=out.parent))
    try:
        # The folder's name is in a ROS 2 bag's file names: it must be the one that the user asked for.
        draft = workshop / (out.stem if container == "mcap" else out.name)
        yield draft
        made = next(draft.glob("*.mcap")) if container == "mcap" else draft
        if out.is_dir():
            shutil.rmtree(out)
        made.replace(out)
    finally:
        shutil.rmtree(workshop, ignore_errors=True)
