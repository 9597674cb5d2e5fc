"""A ROS 1 bag of a world, its points in the layouts of five drivers, by rosbags alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from calib_core.types import FloatArray, IntArray

_FIELD_TYPES = {"u1": 2, "u2": 4, "u4": 6, "f4": 7, "f8": 8}
_LIVOX = {
    "livox_ros_driver2/msg/CustomPoint": (
        "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
    ),
    "livox_ros_driver2/msg/CustomMsg": (
        "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nCustomPoint[] points\n"
    ),
}
_LAYOUTS = {
    "velodyne": ("x f4 0, y f4 4, z f4 8, intensity f4 12, ring u2 16, time f4 18", 22),
    "ouster": ("x f4 0, y f4 4, z f4 8, intensity f4 16, t u4 20, ring u1 26, range u4 32", 48),
    "hesai": ("x f4 0, y f4 4, z f4 8, intensity f4 12, timestamp f8 16, ring u2 24", 26),
    "robosense": ("x f4 0, y f4 4, z f4 8, intensity f4 12, ring u2 16, timestamp f8 20", 32),
}  # fmt: skip
#: A lidar's driver sends a sweep when it is whole, an IMU's each reading.
_SWEEP_LATE_S, _READING_LATE_S, _JITTER_S = 0.03, 0.002, 0.0005


@dataclass(frozen=True)
class Sweep:
    """Points that came back. xyz_m: (N, 3), lidar frame.   time_s: (N,), lidar clock.   laser: (N,)."""

    begins_s: float
    ends_s: float
    xyz_m: FloatArray
    time_s: FloatArray
    laser: IntArray


class _Messages:
    """Messages of a store of types. epoch_ns: of both clocks' zero."""

    def __init__(self, epoch_ns: int) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC)
        for name, text in _LIVOX.items():
            self.store.register(get_types_from_msg(text, name))
        self.epoch_ns = epoch_ns

    def at_ns(self, time_s: float) -> int:
        """A time of the epoch."""
        return self.epoch_ns + round(time_s * 1e9)

    def make(self, kind: str, **members: object) -> object:
        """One of that kind."""
        made: Callable[..., object] = self.store.types[kind]
        return made(**members)

    def header(self, time_s: float, frame_id: str) -> object:
        """With that stamp."""
        sec, nanosec = divmod(self.at_ns(time_s), 10**9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", seq=0, stamp=stamp, frame_id=frame_id)

    def imu(self, time_s: float, gyro: FloatArray, accel: FloatArray) -> object:
        """Without an orientation, and saying so."""
        unknown = np.zeros(9)
        unknown[0] = -1.0
        vectors = (
            self.make("geometry_msgs/msg/Vector3", x=v[0], y=v[1], z=v[2]) for v in (gyro.tolist(), accel.tolist())
        )
        return self.make(
            "sensor_msgs/msg/Imu",
            header=self.header(time_s, "imu"),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=unknown,
            angular_velocity=next(vectors),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=next(vectors),
            linear_acceleration_covariance=np.zeros(9),
        )

    def livox(self, sweep: Sweep) -> object:
        """A CustomMsg."""
        since_ns = np.round((sweep.time_s - sweep.begins_s) * 1e9).astype(int).tolist()
        points = [
            self.make(
                "livox_ros_driver2/msg/CustomPoint",
                offset_time=ns, x=x, y=y, z=z, reflectivity=50, tag=16, line=line,
            )
            for ns, (x, y, z), line in zip(since_ns, sweep.xyz_m.tolist(), sweep.laser.tolist(), strict=True)
        ]  # fmt: skip
        return self.make(
            "livox_ros_driver2/msg/CustomMsg", header=self.header(sweep.begins_s, "lidar"),
            timebase=self.at_ns(sweep.begins_s), point_num=len(points), lidar_id=0, rsvd=np.zeros(3, np.uint8), points=points,
        )  # fmt: skip

    def cloud(self, sweep: Sweep, layout: str) -> object:
        """A PointCloud2 as that driver lays it out, times as it counts them."""
        text, size = _LAYOUTS[layout]
        fields = [(name, kind, int(offset)) for name, kind, offset in (each.split() for each in text.split(", "))]
        names, kinds, offsets = zip(*fields, strict=True)
        kind = np.dtype({"names": names, "formats": [f"<{k}" for k in kinds], "offsets": offsets, "itemsize": size})
        points = np.zeros(len(sweep.xyz_m), kind)
        for axis, values in zip("xyz", sweep.xyz_m.T, strict=True):
            points[axis] = values
        points["ring"], points["intensity"] = sweep.laser, 30
        if layout == "velodyne":
            points["time"] = sweep.time_s - sweep.begins_s
        elif layout == "ouster":
            points["t"] = np.round((sweep.time_s - sweep.begins_s) * 1e9)
            points["range"] = 1000 * np.linalg.norm(sweep.xyz_m, axis=1)
        else:
            points["timestamp"] = 1e-9 * self.epoch_ns + sweep.time_s
        described = [
            self.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=_FIELD_TYPES[k], count=1)
            for name, k, offset in fields
        ]
        return self.make(
            "sensor_msgs/msg/PointCloud2", header=self.header(sweep.begins_s, "lidar"), height=1, width=len(points),
            fields=described, is_bigendian=False, point_step=size, row_step=size * len(points),
            data=points.view(np.uint8).reshape(-1), is_dense=True,
        )  # fmt: skip


def write_bag(
    path: Path,
    sweeps: Sequence[Sweep],
    imu_s: FloatArray,
    gyro_rad_s: FloatArray,
    accel_m_s2: FloatArray,
    *,
    layout: str,
    epoch_ns: int,
    rng: np.random.Generator,
) -> None:
    """In the order in which a recorder would get them. imu_s: (Q,), IMU clock. Raises WriterError where a file is there."""
    make = _Messages(epoch_ns)
    arrives_s = imu_s + _READING_LATE_S + np.abs(rng.normal(0, _JITTER_S, len(imu_s)))
    events = [(at, "imu", k) for k, at in enumerate(arrives_s.tolist())]
    events += [(sweep.ends_s + _SWEEP_LATE_S, "lidar", k) for k, sweep in enumerate(sweeps)]
    with Writer(path) as writer:
        cloud = "livox_ros_driver2/msg/CustomMsg" if layout == "livox" else "sensor_msgs/msg/PointCloud2"
        to = {
            "lidar": writer.add_connection("/lidar_points", cloud, typestore=make.store),
            "imu": writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=make.store),
        }
        for at_s, which, k in sorted(events):
            if which == "imu":
                message = make.imu(float(imu_s[k]), gyro_rad_s[k], accel_m_s2[k])
            else:
                message = make.livox(sweeps[k]) if layout == "livox" else make.cloud(sweeps[k], layout)
            raw = make.store.serialize_ros1(message, to[which].msgtype)
            writer.write(to[which], make.at_ns(at_s), raw)
