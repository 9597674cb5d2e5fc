"""Moved points put back into the bytes they came from, or copied, with all fields, into a cloud of their own."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.clouds.livox import custom_msg_points
from calib_core.readers.clouds.pointcloud2 import TYPE as POINTCLOUD2
from calib_core.readers.clouds.pointcloud2 import cloud_dtype, parse_pointcloud2
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.container.wire import Encoding
from calib_core.types import FloatArray, IntArray

_DATATYPES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


@dataclass(frozen=True, slots=True)
class MovedPoints:
    """rows: (K,) indices into the cloud's points.   xyz_m: (K, 3) their new coordinates."""

    rows: IntArray
    xyz_m: FloatArray


def patched_payload(message: RawMessage, topic: TopicSummary, moved: MovedPoints) -> bytes:
    """The message's bytes with only the moved points' x y z changed."""
    payload = bytearray(message.payload)
    if topic.type == POINTCLOUD2:
        parsed = parse_pointcloud2(message.payload, topic.encoding)
        dtype = cloud_dtype(parsed.fields, parsed.point_step, parsed.is_bigendian)
        row_step = parsed.row_step if parsed.height > 1 and parsed.row_step else parsed.width * parsed.point_step
        grid = np.ndarray((parsed.height, parsed.width), dtype, payload, parsed.body_pos, (row_step, parsed.point_step))
        at: tuple[IntArray, ...] = np.unravel_index(moved.rows, grid.shape)
    else:
        grid = custom_msg_points(payload, topic.encoding)
        at = (moved.rows,)
    for axis, name in enumerate("xyz"):
        grid[name][at] = moved.xyz_m[:, axis]
    return bytes(payload)


def moved_copy(cloud: RawCloud, moved: MovedPoints | None) -> StructArray:
    """The cloud's fields, packed little-endian, coordinates as float32 metres. One of several numbers is one of each: rgb_0 .."""
    columns = dict(_columns(cloud.points))
    formats = [(n, "<f4") if n in "xyz" else (n, values.dtype.newbyteorder("<")) for n, values in columns.items()]
    points = np.empty(cloud.points.size, np.dtype(formats))
    for name, values in columns.items():
        points[name] = values
    if moved is not None:
        for axis, name in enumerate("xyz"):
            points[name][moved.rows] = moved.xyz_m[:, axis]
    return points


def _columns(points: StructArray) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Names and values (N,) of the fields, those of several numbers a point taken apart."""
    for name in points.dtype.names or ():
        shape = points.dtype[name].shape
        if shape:
            several = points[name].reshape(points.size, math.prod(shape))
            yield from ((f"{name}_{k}", several[:, k]) for k in range(several.shape[1]))
        else:
            yield name, points[name]


def pointcloud2_payload(cloud: RawCloud, moved: MovedPoints | None, encoding: Encoding) -> bytes:
    """The cloud as a serialized sensor_msgs/PointCloud2 of one row."""
    points = moved_copy(cloud, moved)
    dtype = points.dtype
    out = bytearray(b"" if encoding == "ros1" else b"\x00\x01\x00\x00")
    base = len(out)

    def put(code: str, *values: int) -> None:
        for value in values:
            if encoding == "cdr":
                out.extend(b"\0" * (-(len(out) - base) % struct.calcsize("<" + code)))
            out.extend(struct.pack("<" + code, value))

    def text(value: str) -> None:
        encoded = value.encode() + (b"\0" if encoding == "cdr" else b"")
        put("I", len(encoded))
        out.extend(encoded)

    seconds, nanoseconds = divmod(cloud.header_ns, 1_000_000_000)
    put("I", *((0,) if encoding == "ros1" else ()), seconds, nanoseconds)
    text(cloud.frame_id)
    put("I", 1, points.size, len(dtype.names or ()))
    for name in dtype.names or ():
        text(name)
        put("I", int(dtype.fields[name][1]) if dtype.fields is not None else 0)
        put("B", _DATATYPES[dtype[name].str[1:]])
        put("I", 1)
    put("B", 0)
    put("I", dtype.itemsize, dtype.itemsize * points.size, points.nbytes)
    out.extend(points.tobytes())
    put("B", 1)
    return bytes(out)
