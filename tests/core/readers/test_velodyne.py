"""Velodyne packets packed here byte by byte, against the driver's geometry written as a plain loop."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from calib_core.readers.storage import RawMessage
from calib_core.readers.velodyne import VelodyneDecoder
from tests.core.readers import build

FIRING_US, SEQUENCE_US = 2.304, 55.296
TURN_DEG_S = 3600.0
N_PACKETS = 75
ELEVATIONS_16 = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)


def vlp16_packet(number: int, first_us: int, distances: np.ndarray) -> bytes:
    """12 blocks of two firing sequences of 16 lasers. distances: (24, 16) in units of 2 mm."""
    body = b""
    for block in range(12):
        elapsed_us = number * 24 * SEQUENCE_US + 2 * block * SEQUENCE_US
        azimuth = round(elapsed_us * 1e-6 * TURN_DEG_S * 100) % 36000
        body += struct.pack("<HH", 0xEEFF, azimuth)
        for sequence in range(2):
            for laser in range(16):
                body += struct.pack("<HB", int(distances[2 * block + sequence, laser]), 40 + laser)
    stamp_us = first_us + round(number * 24 * SEQUENCE_US)
    return body + struct.pack("<IBB", stamp_us % 3_600_000_000, 0x37, 0x22)


@pytest.mark.parametrize("cdr", [False, True])
@pytest.mark.parametrize("first_us", [1_000_000, 3_599_960_000])
def test_vlp16_single_return(cdr: bool, first_us: int) -> None:
    """Mutation: leave the last block out of `_advance_of_driver_s`; do not unwrap the hour in `device_us`."""
    distances = np.random.default_rng(0).integers(500, 20_000, (N_PACKETS, 24, 16))
    packets = []
    for k in range(N_PACKETS):
        # the host stamps jitter, one is late by 20 ms
        late_ns = 20_000_000 if k == 0 else (k * 7919) % 400_000
        stamp_ns = build.EPOCH_NS + round(k * 24 * SEQUENCE_US * 1000) + late_ns
        packets.append((stamp_ns, vlp16_packet(k, first_us, distances[k])))
    payload = build.velodyne_scan(packets, cdr=cdr, stamp_ns=packets[0][0])
    cloud = VelodyneDecoder("cdr" if cdr else "ros1")(RawMessage("/v", 1, payload))

    expected = []
    for k in range(N_PACKETS):
        for step in range(24):
            block_deg = round((k * 24 + step // 2 * 2) * SEQUENCE_US * 1e-6 * TURN_DEG_S * 100) / 100
            for laser in range(16):
                advance_us = laser * FIRING_US + step % 2 * SEQUENCE_US
                azimuth = math.radians(block_deg + (0 if step >= 22 else advance_us * 1e-6 * TURN_DEG_S))
                elevation = math.radians(ELEVATIONS_16[laser])
                distance = 0.002 * distances[k, step, laser]
                time_us = (k * 24 + step) * SEQUENCE_US + laser * FIRING_US
                flat = distance * math.cos(elevation)
                xyz = flat * math.cos(azimuth), -flat * math.sin(azimuth), distance * math.sin(elevation)
                ring = sorted(ELEVATIONS_16).index(ELEVATIONS_16[laser])
                expected.append((*xyz, 40 + laser, ring, time_us * 1e-6))
    want = np.array(expected)
    got = np.stack([cloud.points[n].astype(np.float64) for n in ("x", "y", "z", "intensity", "ring", "time")], 1)
    assert got.shape == want.shape
    want, got = (a[np.lexsort((a[:, 4], np.round(a[:, 5] * 1e6)))] for a in (want, got))
    # a hundredth of a degree, the packets' own resolution, at 40 m
    assert np.abs(got[:, :3] - want[:, :3]).max() < 0.012
    assert np.median(np.abs(got[:, :3] - want[:, :3])) < 0.001
    np.testing.assert_array_equal(got[:, 3:5], want[:, 3:5])
    assert np.abs(got[:, 5] - want[:, 5]).max() < 3e-6
    assert abs(cloud.header_ns - build.EPOCH_NS) < 400_000


def test_an_empty_scan_is_an_empty_cloud() -> None:
    """Mutation: index packet 0 of none."""
    payload = build.velodyne_scan([], cdr=True, stamp_ns=build.EPOCH_NS)
    assert VelodyneDecoder("cdr")(RawMessage("/v", 1, payload)).points.size == 0
