"""velodyne_msgs/VelodyneScan: raw packets, decoded by velodyne-decoder, in the driver's own geometry.

    header, packets[]: stamp, u8[1206]

The decoder is the physical one: it moves each laser's beam vertically by a few millimetres, and advances the azimuth
by the time at which each laser fires. The driver whose clouds the real files hold does three things otherwise: no
vertical shift; for 32 lasers an advance of one firing time per laser although they fire in pairs (0.06 deg on
average); no advance in each packet's last block. A calibration is used with the driver's clouds, so the points made
here are the driver's: packets and clouds give the same extrinsic.

Times come from the packets' own microsecond counters, which are even; they are laid under the host's stamps by their
median, so that one late packet moves nothing.
"""

from __future__ import annotations

import re
import threading
from dataclasses import dataclass, field

import numpy as np
import velodyne_decoder as decoder_library

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.container.wire import Encoding, MalformedMessage, Wire
from calib_core.types import FloatArray, IntArray

PACKET_BYTES = 1206
MAX_PACKETS = 4096
_HOUR_US = 3_600_000_000
#: Product byte of a packet -> the decoder's model.
MODELS = {
    0x21: decoder_library.Model.HDL32E,
    0x22: decoder_library.Model.VLP16,
    0x24: decoder_library.Model.PuckHiRes,
    0x28: decoder_library.Model.VLP32C,
    0xA1: decoder_library.Model.VLS128,
}
_PUCKS = (decoder_library.Model.VLP16, decoder_library.Model.PuckHiRes)
_DUAL_RETURN = 0x39
_FIRING_S = 2.304e-6
_SEQUENCE_S = 55.296e-6
_POINT_DTYPE = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("time", "<f4")]
)


class UnsupportedModel(MalformedMessage):
    """Packets of a Velodyne whose geometry is not known here; `model` says which."""

    def __init__(self, product: int) -> None:
        names = {0x31: "VLP-32A or older", 0x00: "HDL-64E"}
        self.model = names.get(product, f"model byte 0x{product:02x}")
        super().__init__(f"packets of an unsupported Velodyne ({self.model})")


@dataclass(frozen=True, slots=True)
class _Packets:
    """stamps_ns: (P,) host stamps.   body: (P, 1206) uint8."""

    header_ns: int
    frame_id: str
    stamps_ns: IntArray
    body: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]


def parse_scan(payload: bytes | memoryview, encoding: Encoding) -> _Packets:
    """The packets of one message."""
    wire = Wire(payload, encoding)
    header_ns, frame_id = wire.header()
    count = wire.u32()
    if count > MAX_PACKETS:
        raise MalformedMessage(f"{count} packets in one scan")
    stride = PACKET_BYTES + 8
    if encoding == "cdr" and stride % 4:
        stride += 4 - stride % 4
    wire.align(4)
    if not count:
        return _Packets(header_ns, frame_id, np.zeros(0, np.int64), np.zeros((0, PACKET_BYTES), np.uint8))
    block = wire.view((count - 1) * stride + PACKET_BYTES + 8)
    order = wire.order
    dtype = np.dtype([("sec", f"{order}u4"), ("nsec", f"{order}u4"), ("body", "u1", (PACKET_BYTES,))])
    packets = np.ndarray((count,), dtype, block, strides=(stride,))
    stamps_ns = packets["sec"].astype(np.int64) * 1_000_000_000 + packets["nsec"]
    return _Packets(header_ns, frame_id, stamps_ns, packets["body"])


@dataclass(slots=True)
class VelodyneDecoder:
    """Decodes the scans of one topic. Stateful only in what it learnt of the sensor: its model."""

    encoding: Encoding
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _decoders: dict[int, decoder_library.ScanDecoder] = field(default_factory=dict)

    def __call__(self, message: RawMessage) -> RawCloud:
        """The cloud of one stored message; `time` counts from header_ns, the first packet's instant."""
        packets = parse_scan(message.payload, self.encoding)
        if not packets.stamps_ns.size:
            points = np.zeros(0, _POINT_DTYPE)
            return RawCloud(packets.header_ns, message.receive_ns, packets.frame_id, points, 0, 1)
        product = int(packets.body[0, 1205])
        if product not in MODELS:
            raise UnsupportedModel(product)
        vector = decoder_library.PacketVector(
            [
                decoder_library.VelodynePacket(stamp * 1e-9, body)
                for stamp, body in zip(packets.stamps_ns.tolist(), map(bytes, packets.body), strict=True)
            ]
        )
        with self._lock:  # the library's decoder keeps state while it decodes
            if product not in self._decoders:
                self._decoders[product] = _scan_decoder(product)
            _, decoded = self._decoders[product].decode(vector, as_pcl_structs=True)
        points = _driver_geometry(decoded, packets, product)
        return RawCloud(first_packet_ns(packets), message.receive_ns, packets.frame_id, points, points.size, 1)


def _scan_decoder(product: int) -> decoder_library.ScanDecoder:
    model = MODELS[product]
    text = decoder_library.Calibration.default_calibs[model].to_string()
    flat = re.sub(r"vert_offset_correction: \S+", "vert_offset_correction: 0", text)
    config = decoder_library.Config(
        model=model,
        calibration=decoder_library.Calibration.from_string(flat),
        min_range=0.01,
        max_range=1000.0,
        timestamp_first_packet=True,
    )
    return decoder_library.ScanDecoder(config)


def device_us(packets: _Packets) -> IntArray:
    """(P,) the packets' own microseconds, unwrapped over the hour."""
    raw = packets.body[:, 1200:1204].astype(np.int64) @ (1 << np.array([0, 8, 16, 24]))
    steps = np.diff(raw, prepend=raw[:1])
    return np.asarray(raw + np.cumsum(steps < -_HOUR_US // 2) * _HOUR_US, np.int64)


def first_packet_ns(packets: _Packets) -> int:
    """The first packet's instant in the host's clock: the median over all packets of what each says it is."""
    elapsed_ns = (device_us(packets) - device_us(packets)[0]) * 1000
    lag = packets.stamps_ns - elapsed_ns
    return int(np.sort(lag)[lag.size // 2])


def _driver_geometry(decoded: StructArray, packets: _Packets, product: int) -> StructArray:
    """The decoded points with the azimuth that the driver gives them."""
    out = np.empty(decoded.size, _POINT_DTYPE)
    for name in ("z", "intensity", "ring", "time"):
        out[name] = decoded[name]
    advance_s = _advance_of_driver_s(decoded, packets, product)
    if advance_s is None:
        out["x"], out["y"] = decoded["x"], decoded["y"]
        return out
    angle = advance_s * _turn_rate_rad_s(packets)
    cosine, sine = np.cos(angle), np.sin(angle)
    # Azimuth grows clockwise: an advance turns the point clockwise.
    out["x"] = cosine * decoded["x"] + sine * decoded["y"]
    out["y"] = -sine * decoded["x"] + cosine * decoded["y"]
    return out


def _advance_of_driver_s(decoded: StructArray, packets: _Packets, product: int) -> FloatArray | None:
    """(N,) seconds by which the driver turns each point further than the physical decoder; None where they agree."""
    model = MODELS[product]
    if model is decoder_library.Model.VLP32C:
        laser = _laser_of_ring(product)[decoded["ring"]]
        physical, sequences, last = laser // 2 * _FIRING_S, 12, 1
        driver = laser * _FIRING_S
    elif model in _PUCKS:
        # A block holds two firing sequences of 16 lasers; with dual returns two blocks hold the same two sequences.
        sequence = decoded["column"].astype(np.int64) % 2
        physical = _laser_of_ring(product)[decoded["ring"]] * _FIRING_S + sequence * _SEQUENCE_S
        driver, last = physical, 2
        sequences = 12 if packets.body[0, 1204] == _DUAL_RETURN else 24
    else:
        return None
    in_last_block = decoded["column"].astype(np.int64) % sequences >= sequences - last
    return np.asarray(np.where(in_last_block, 0.0, driver) - physical, np.float64)


def _laser_of_ring(product: int) -> IntArray:
    """(R,) firing order of each ring; rings count upwards."""
    text = decoder_library.Calibration.default_calibs[MODELS[product]].to_string()
    elevations = np.array([float(v) for v in re.findall(r"vert_correction: (\S+)", text)])
    return np.argsort(elevations, kind="stable").astype(np.int64)


def _turn_rate_rad_s(packets: _Packets) -> float:
    """Speed of the head, from azimuths and the packets' own time."""
    azimuth = np.unwrap(np.deg2rad((packets.body[:, 2].astype(np.float64) + 256.0 * packets.body[:, 3]) * 0.01))
    elapsed_s = (device_us(packets) - device_us(packets)[0]) * 1e-6
    steps = np.diff(elapsed_s)
    usable = steps > 0
    if not usable.any():
        return float(2 * np.pi * 10.0)
    return float(np.median(np.diff(azimuth)[usable] / steps[usable]))
