"""Property-based fuzzing of the decoders: any bytes end in a cloud that passed its checks, or in MalformedMessage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib_core.readers.clouds.cloud import RawCloud
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.clouds.pointcloud2 import MAX_POINTS
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.container.wire import MalformedMessage, Wire
from calib_core.readers.imu.messages import ImuCollector
from calib_core.readers.scans import make_scan
from calib_core.readers.timing.point_time import PointTiming
from tests.core.readers import build
from tests.core.readers.layouts import LAYOUTS

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
TYPES = {
    "cloud": ("sensor_msgs/msg/PointCloud2", lambda cdr: LAYOUTS["hesai"].make(0, cdr).payload),
    "custom": ("livox_ros_driver2/msg/CustomMsg", lambda cdr: LAYOUTS["livox-custom-1"].make(0, cdr).payload),
    "packets": (
        "velodyne_msgs/msg/VelodyneScan",
        lambda cdr: build.velodyne_scan(
            [(build.EPOCH_NS, bytes(1204) + b"\x37\x22")] * 3, cdr=cdr, stamp_ns=build.EPOCH_NS
        ),
    ),
}


def decoded(kind: str, payload: bytes, *, cdr: bool) -> RawCloud | None:
    """The cloud, or None where the bytes were refused as they should be."""
    topic = TopicSummary("/t", TYPES[kind][0], 1, "cdr" if cdr else "ros1")
    try:
        return cloud_decoder(topic)(RawMessage("/t", 0, payload))
    except MalformedMessage:
        return None


@pytest.mark.parametrize("cdr", [False, True])
@pytest.mark.parametrize("kind", TYPES)
@QUICK
@given(data=st.data())
def test_mutated_messages(kind: str, cdr: bool, data: st.DataObject) -> None:
    """Mutation: drop the size check in `Wire.view` or the comparison of step and field ends in `cloud_dtype`."""
    payload = bytearray(TYPES[kind][1](cdr))
    head = min(len(payload), 400)
    for _ in range(data.draw(st.integers(1, 6))):
        payload[data.draw(st.integers(0, head - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(payload)))
    for body in (bytes(payload), bytes(payload[:cut])):
        cloud = decoded(kind, body, cdr=cdr)
        if cloud is None or not {"x", "y", "z"} <= set(cloud.names):
            continue
        assert cloud.points.size <= MAX_POINTS
        if any(cloud.points.dtype[a].shape != () for a in "xyz"):
            continue
        time = next((n for n in cloud.names if n in ("timestamp", "offset_time", "time")), None)
        if time is None or cloud.points.dtype[time].shape != () or not cloud.points.size:
            continue
        scan, counts = make_scan(cloud, 0, PointTiming(time, "s", "absolute", -1e8, 1e8), 0.3, 200.0)
        assert counts.sent == cloud.points.size
        if scan is not None:
            ranges = np.linalg.norm(scan.points["xyz"].astype(np.float64), axis=1)
            assert ((ranges > 0.29) & (ranges < 200.1)).all()
            assert scan.points["offset_ns"].min() == 0
            assert scan.points["offset_ns"].max() <= 2e8


@pytest.mark.parametrize("kind", TYPES)
@QUICK
@given(payload=st.binary(max_size=300), cdr=st.booleans())
def test_any_bytes(kind: str, payload: bytes, cdr: bool) -> None:
    """Mutation: use `assert` in place of MalformedMessage anywhere in the decoders."""
    decoded(kind, payload, cdr=cdr)
    decoded(kind, b"\x00\x01\x00\x00" + payload, cdr=True)


@QUICK
@given(payload=st.binary(max_size=400), cdr=st.booleans())
def test_any_bytes_as_imu(payload: bytes, cdr: bool) -> None:
    """Mutation: let struct.error out of `ImuCollector.add`."""
    collector = ImuCollector("cdr" if cdr else "ros1")
    collector.add(RawMessage("/imu", 0, payload))
    raw = collector.finish()
    assert raw.n_malformed + raw.header_ns.size == 1


@given(
    text=st.text(max_size=20),
    number=st.integers(0, 2**32 - 1),
    stamp=st.integers(0, 2**31 * 10**9 - 1),
    cdr=st.booleans(),
)
@QUICK
def test_wire_reads_what_was_packed(text: str, number: int, stamp: int, cdr: bool) -> None:
    """Mutation: align from the payload's start; keep the NUL of a CDR string."""
    text = text.replace("\0", "")
    packer = build.Packer(cdr).header(stamp, text).put("B", 7).put("d", 1.5).text(text).put("H", 9).put("I", number)
    wire = Wire(packer.bytes(), "cdr" if cdr else "ros1")
    assert wire.header() == (stamp, text)
    assert (wire.u8(), wire.unpack("d", 8), wire.string(), wire.unpack("H", 2), wire.u32()) == (7, 1.5, text, 9, number)
    assert wire.remaining == 0
