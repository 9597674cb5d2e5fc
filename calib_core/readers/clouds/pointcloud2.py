"""sensor_msgs/PointCloud2, ROS 1 and CDR: a structured view over the message's own bytes, unaligned fields included."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.container.wire import Encoding, MalformedMessage, Wire

TYPE = "sensor_msgs/msg/PointCloud2"
#: PointField's datatype codes.
_CODES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
MAX_POINTS = 1 << 24
_MAX_FIELDS = 128
_MAX_POINT_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class PointField:
    """One entry of the message's field list."""

    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True, slots=True)
class CloudMessage:
    """The message taken apart; `body` is the point bytes, not copied, `body_pos` where they start in the payload."""

    header_ns: int
    frame_id: str
    height: int
    width: int
    fields: tuple[PointField, ...]
    is_bigendian: bool
    point_step: int
    row_step: int
    body: memoryview
    body_pos: int


def parse_pointcloud2(payload: bytes | memoryview, encoding: Encoding) -> CloudMessage:
    """The message's parts. Raises MalformedMessage where sizes and bytes disagree."""
    wire = Wire(payload, encoding)
    header_ns, frame_id = wire.header()
    height, width = wire.u32(), wire.u32()
    n_fields = wire.u32()
    if n_fields > _MAX_FIELDS:
        raise MalformedMessage(f"{n_fields} point fields")
    fields = tuple(PointField(wire.string(), wire.u32(), wire.u8(), wire.u32()) for _ in range(n_fields))
    is_bigendian = wire.u8() != 0
    point_step, row_step = wire.u32(), wire.u32()
    size = wire.u32()
    body_pos = wire.pos
    body = wire.view(size)
    if height * width > MAX_POINTS or point_step > _MAX_POINT_BYTES or (height * width and point_step == 0):
        raise MalformedMessage(f"{height} x {width} points of {point_step} bytes")
    return CloudMessage(header_ns, frame_id, height, width, fields, is_bigendian, point_step, row_step, body, body_pos)


@lru_cache(maxsize=64)
def cloud_dtype(fields: tuple[PointField, ...], point_step: int, is_bigendian: bool) -> np.dtype[np.void]:
    """The structured dtype of one point. Raises MalformedMessage for fields outside the point or unknown codes."""
    order = ">" if is_bigendian else "<"
    names: list[str] = []
    formats: list[np.dtype[np.generic]] = []
    offsets: list[int] = []
    for field in fields:
        code = _CODES.get(field.datatype)
        if code is None or not field.name or field.name in names or field.count > 4096:
            continue  # padding entries and vendor codes are not worth a refusal
        scalar = np.dtype(order + code)
        whole = np.dtype((scalar, (field.count,))) if field.count > 1 else scalar
        if field.offset + whole.itemsize > point_step:
            raise MalformedMessage(f"field {field.name!r} reaches past the point's {point_step} bytes")
        names.append(field.name)
        formats.append(whole)
        offsets.append(field.offset)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": point_step})


def cloud_points(message: CloudMessage) -> StructArray:
    """(height * width,) structured view of the points; a copy only where rows are padded."""
    dtype = cloud_dtype(message.fields, message.point_step, message.is_bigendian)
    n_points = message.height * message.width
    if n_points == 0:
        return np.zeros(0, dtype)
    packed = message.width * message.point_step
    if message.height == 1 or message.row_step in (packed, 0):
        if len(message.body) < n_points * message.point_step:
            raise MalformedMessage(f"{len(message.body)} bytes for {n_points} points of {message.point_step} bytes")
        return np.frombuffer(message.body, dtype, n_points)
    if message.row_step < packed or len(message.body) < message.row_step * (message.height - 1) + packed:
        raise MalformedMessage(f"{len(message.body)} bytes for {message.height} rows of {message.row_step} bytes")
    rows = np.ndarray(
        (message.height, message.width), dtype, message.body, strides=(message.row_step, message.point_step)
    )
    return rows.reshape(-1)


def read_pointcloud2(message: RawMessage, encoding: Encoding) -> RawCloud:
    """The cloud of one stored message."""
    parsed = parse_pointcloud2(message.payload, encoding)
    points = cloud_points(parsed)
    return RawCloud(parsed.header_ns, message.receive_ns, parsed.frame_id, points, parsed.width, parsed.height)
