"""sensor_msgs/Imu, ROS 1 and CDR, as plain arrays."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

from calib_core.readers.storage import RawMessage
from calib_core.readers.wire import Encoding, Wire
from calib_core.types import FloatArray, IntArray

TYPE = "sensor_msgs/msg/Imu"
#: orientation (4), its covariance (9), angular velocity (3), covariance (9), linear acceleration (3), covariance (9)
_N_DOUBLES = 37


@dataclass(frozen=True, slots=True)
class RawImu:
    """All readings of one topic in receive order, in the units they were sent in.

    header_ns, receive_ns: (Q,) int64.   gyro, accel: (Q, 3).
    """

    header_ns: IntArray
    receive_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    frame_id: str
    n_malformed: int


@dataclass(slots=True)
class ImuCollector:
    """Gathers readings while a recording is iterated."""

    encoding: Encoding
    frame_id: str = ""
    n_malformed: int = 0
    _stamps: list[tuple[int, int]] = field(default_factory=list)
    _readings: list[tuple[float, ...]] = field(default_factory=list)

    def add(self, message: RawMessage) -> None:
        """Take one message; a malformed one is counted, not raised."""
        try:
            wire = Wire(message.payload, self.encoding)
            header_ns, frame_id = wire.header()
            wire.align(8)
            values = struct.unpack_from(f"{wire.order}{_N_DOUBLES}d", wire.buffer, wire.pos)
        except (ValueError, struct.error):
            self.n_malformed += 1
            return
        if not self._stamps:
            self.frame_id = frame_id
        self._stamps.append((header_ns, message.receive_ns))
        self._readings.append(values[13:16] + values[25:28])

    def finish(self) -> RawImu:
        """Everything gathered."""
        stamps = np.array(self._stamps, np.int64).reshape(-1, 2)
        readings = np.array(self._readings, np.float64).reshape(-1, 6)
        return RawImu(
            stamps[:, 0].copy(),
            stamps[:, 1].copy(),
            readings[:, :3].copy(),
            readings[:, 3:].copy(),
            self.frame_id,
            self.n_malformed,
        )
