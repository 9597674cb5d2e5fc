"""Velodyne packets packed here byte by byte, against the driver's geometry written as a plain loop."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from calib_core.readers.clouds.velodyne import VelodyneDecoder
from calib_core.readers.container.storage import RawMessage
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


#: Elevation and azimuth of the lasers in firing order, in degrees, from the vendor's tables.
VLP32C_DEG = (
    (-25, 1.4), (-1, -4.2), (-1.667, 1.4), (-15.639, -1.4), (-11.31, 1.4), (0, -1.4), (-0.667, 4.2), (-8.843, -1.4),
    (-7.254, 1.4), (0.333, -4.2), (-0.333, 1.4), (-6.148, -1.4), (-5.333, 4.2), (1.333, -1.4), (0.667, 4.2), (-4, -1.4),
    (-4.667, 1.4), (1.667, -4.2), (1, 1.4), (-3.667, -4.2), (-3.333, 4.2), (3.333, -1.4), (2.333, 1.4), (-2.667, -1.4),
    (-3, 1.4), (7, -1.4), (4.667, 1.4), (-2.333, -4.2), (-2, 4.2), (15, -1.4), (10.333, 1.4), (-1.333, -1.4),
)  # fmt: skip
HDL32E_DEG = tuple((-30.67 + 21.33 * (n % 2) + 4 / 3 * (n // 2), 0.0) for n in range(32))


def packet_of_32(number: int, distances: np.ndarray, *, block_us: float, product: int) -> bytes:
    """12 blocks of one firing sequence of 32 lasers. distances: (12, 32) in the sensor's unit."""
    body = b""
    for block in range(12):
        azimuth = round((number * 12 + block) * block_us * 1e-6 * TURN_DEG_S * 100) % 36000
        body += struct.pack("<HH", 0xEEFF, azimuth)
        for laser in range(32):
            body += struct.pack("<HB", int(distances[block, laser]), 40 + laser)
    return body + struct.pack("<IBB", 1_000_000 + round(number * 12 * block_us), 0x37, product)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("product", "table", "unit_m", "block_us", "firing_us", "together", "tolerance_m"),
    [
        (0x28, VLP32C_DEG, 0.004, 55.296, 2.304, 2, 0.01),
        (0x21, HDL32E_DEG, 0.002, 46.080, 1.152, 1, 0.01),
    ],
)
def test_sensors_of_32_lasers(
    product: int,
    table: tuple[tuple[float, float], ...],
    unit_m: float,
    block_us: float,
    firing_us: float,
    together: int,
    tolerance_m: float,
    order: str,
) -> None:
    """Mutation: leave `physical` (lasers that fire in pairs) out for the VLP-32C; take host stamps as little-endian.

    together: lasers that fire at once.   tolerance_m: at 40 m; the azimuths of these packets are rounded to 0.01 deg.
    """
    rng = np.random.default_rng(3)
    n_packets = 60
    distances = rng.integers(int(1.0 / unit_m), int(40.0 / unit_m), (n_packets, 12, 32))
    packets = [
        (
            build.EPOCH_NS + round(k * 12 * block_us * 1000),
            packet_of_32(k, distances[k], block_us=block_us, product=product),
        )
        for k in range(n_packets)
    ]
    payload = build.velodyne_scan(packets, cdr=True, stamp_ns=build.EPOCH_NS, order=order)
    cloud = VelodyneDecoder("cdr")(RawMessage("/v", 1, payload))
    rings = sorted(range(32), key=lambda laser: table[laser][0])
    expected = []
    for k in range(n_packets):
        for block in range(12):
            at_us = (k * 12 + block) * block_us
            is_last = block == 11 and product == 0x28
            for laser, (elevation_deg, turned_deg) in enumerate(table):
                # the driver advances the azimuth by one firing time per laser, pairs or not
                advance_us = 0.0 if is_last else laser * firing_us
                start_deg = round(at_us * 1e-6 * TURN_DEG_S * 100) / 100
                azimuth = math.radians(start_deg + advance_us * 1e-6 * TURN_DEG_S + turned_deg)
                distance = unit_m * distances[k, block, laser]
                flat = distance * math.cos(math.radians(elevation_deg))
                height = distance * math.sin(math.radians(elevation_deg))
                time_s = (at_us + laser // together * firing_us) * 1e-6
                expected.append(
                    (flat * math.cos(azimuth), -flat * math.sin(azimuth), height, rings.index(laser), time_s)
                )
    want = np.array(expected)
    got = np.stack([cloud.points[n].astype(np.float64) for n in ("x", "y", "z", "ring", "time")], 1)
    assert got.shape == want.shape
    want, got = (a[np.lexsort((np.round(a[:, 4] * 1e5), a[:, 3]))] for a in (want, got))
    np.testing.assert_array_equal(got[:, 3], want[:, 3])
    assert np.abs(got[:, 4] - want[:, 4]).max() < 3e-6
    assert np.abs(got[:, :3] - want[:, :3]).max() < tolerance_m
    assert abs(cloud.header_ns - build.EPOCH_NS) <= 500  # the counter knows microseconds
