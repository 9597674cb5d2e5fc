"""Livox CustomMsg of both drivers in both ROS versions, on the raw bytes: no Python object per point.

    header, timebase u64, point_num u32, lidar_id u8, rsvd u8[3], points[]: offset_time u32 [ns], x y z f32 [m],
    reflectivity u8, tag u8, line u8

ROS 1 packs 19 bytes a point; CDR pads to 20, the last point excepted.
"""

from __future__ import annotations

import numpy as np

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.clouds.pointcloud2 import MAX_POINTS
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.container.wire import Encoding, MalformedMessage, Wire

TYPES = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")


def _point_dtype(order: str) -> np.dtype[np.void]:
    f4 = f"{order}f4"
    return np.dtype(
        [
            ("offset_time", f"{order}u4"),
            ("x", f4),
            ("y", f4),
            ("z", f4),
            ("reflectivity", "u1"),
            ("tag", "u1"),
            ("line", "u1"),
        ]
    )


_DTYPES = {"<": _point_dtype("<"), ">": _point_dtype(">")}


def read_custom_msg(message: RawMessage, encoding: Encoding) -> RawCloud:
    """The cloud of one stored CustomMsg; `offset_time` counts from the header's stamp."""
    wire = Wire(message.payload, encoding)
    header_ns, frame_id = wire.header()
    lidar_id, points = _points(wire)
    return RawCloud(header_ns, message.receive_ns, frame_id, points, points.size, 1, lidar_id=lidar_id)


def custom_msg_points(payload: bytes | bytearray, encoding: Encoding) -> StructArray:
    """(N,) structured view of a message's points; writable where the payload is."""
    wire = Wire(payload, encoding)
    wire.header()
    return _points(wire)[1]


def _points(wire: Wire) -> tuple[int, StructArray]:
    """The lidar's number and the points of a message whose header has been read."""
    wire.u64()  # timebase: the header's stamp again, in the sensor's own count
    declared = wire.u32()
    lidar_id = wire.view(4)[0]  # and rsvd[3]
    n_points = wire.u32()
    if n_points > MAX_POINTS or declared != n_points:
        raise MalformedMessage(f"{declared} points announced, {n_points} sent")
    dtype = _DTYPES[wire.order]
    stride = dtype.itemsize if wire.encoding == "ros1" else dtype.itemsize + 1
    wire.align(4)
    if n_points == 0:
        return lidar_id, np.zeros(0, dtype)
    body = wire.view((n_points - 1) * stride + dtype.itemsize)
    return lidar_id, np.ndarray((n_points,), dtype, body, strides=(stride,))
