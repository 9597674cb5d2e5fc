"""sensor_msgs/Imu, ROS 1 and CDR, as plain arrays."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

from calib_core.readers.container.storage import RawMessage
from calib_core.readers.container.wire import MAX_STRING_BYTES, NS_PER_S, Encoding, Wire
from calib_core.readers.timing.stamps import never_set
from calib_core.types import FloatArray, IntArray

TYPE = "sensor_msgs/msg/Imu"
#: orientation (4), its covariance (9), angular velocity (3), covariance (9), linear acceleration (3), covariance (9)
_READINGS = struct.Struct("<37d")
_ROS1_HEADER = struct.Struct("<IIII")
_CDR_HEADER = struct.Struct("<IiII")
_LITTLE_ENDIAN_CDR = 0x00000100
_BIG_ENDIAN_CDR = 0
_BIG_READINGS, _BIG_CDR_HEADER = struct.Struct(">37d"), struct.Struct(">IiII")


@dataclass(frozen=True, slots=True)
class RawImu:
    """All readings of one topic in receive order, in the units they were sent in.

    header_ns, receive_ns: (Q,) int64.   gyro, accel: (Q, 3).   unset: the headers carry no time and receive times
    stand in for them.
    """

    header_ns: IntArray
    receive_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    frame_id: str
    n_malformed: int
    unset: bool = False


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
        # Thousands of messages a minute: the usual byte order goes around Wire's checks, which struct repeats.
        payload = message.payload
        readings = _READINGS
        try:
            if self.encoding == "ros1":
                _, seconds, nanoseconds, length = _ROS1_HEADER.unpack_from(payload)
                pos = 16 + length
            else:
                magic, seconds, nanoseconds, length = _CDR_HEADER.unpack_from(payload)
                if magic == _BIG_ENDIAN_CDR:
                    readings = _BIG_READINGS
                    _, seconds, nanoseconds, length = _BIG_CDR_HEADER.unpack_from(payload)
                elif magic != _LITTLE_ENDIAN_CDR:
                    raise ValueError("no CDR")
                pos = 16 + length
                pos += -(pos - 4) % 8
            values = readings.unpack_from(payload, pos)
            if nanoseconds >= NS_PER_S or length > MAX_STRING_BYTES:
                raise ValueError("header")
            header_ns = seconds * NS_PER_S + nanoseconds
            if not self._stamps:
                self.frame_id = Wire(payload, self.encoding).header()[1]
        except (ValueError, struct.error):
            self.n_malformed += 1
            return
        self._stamps.append((header_ns, message.receive_ns))
        self._readings.append(values[13:16] + values[25:28])

    def finish(self) -> RawImu:
        """Everything gathered."""
        stamps = np.array(self._stamps, np.int64).reshape(-1, 2)
        readings = np.array(self._readings, np.float64).reshape(-1, 6)
        unset = never_set(stamps[:, 0])
        return RawImu(
            stamps[:, 1 if unset else 0].copy(),
            stamps[:, 1].copy(),
            readings[:, :3].copy(),
            readings[:, 3:].copy(),
            self.frame_id,
            self.n_malformed,
            unset,
        )
