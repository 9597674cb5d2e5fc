"""Lasers that no field names, told by rows of elevation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib_core.readers.clouds.cloud import RawCloud, StructArray
from calib_core.readers.clouds.decoders import cloud_decoder
from calib_core.readers.container.opening import open_recording
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.ring_by_elevation import by_rows, find_rows
from calib_core.types import FloatArray

VLP_16_DEG = np.arange(-15.0, 16.0, 2.0)
#: A rotor whose lasers stand closer in the middle, as those of Pandar-40 and VLP-32C do.
UNEVEN_DEG = np.concatenate([np.arange(-25.0, -7.0, 3.0), np.arange(-6.0, 2.0, 1.0 / 3.0), np.arange(3.0, 16.0, 4.0)])


def cloud(elevation_deg: FloatArray, laser: NDArray[np.int64], seed: int, *, tilt_deg: float = 0.0) -> RawCloud:
    """A sweep's points with noise along their beams, one in a hundred without a return. laser: (N,)."""
    rng = np.random.default_rng(seed)
    elevation, azimuth = np.radians(elevation_deg[laser]), rng.uniform(-np.pi, np.pi, laser.size)
    away = rng.uniform(1.0, 12.0, laser.size) + 0.02 * rng.standard_normal(laser.size)
    x, y, z = (
        away * np.cos(elevation) * np.cos(azimuth),
        away * np.cos(elevation) * np.sin(azimuth),
        away * np.sin(elevation),
    )
    tilt = np.radians(tilt_deg)
    out = np.zeros(laser.size, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("time", "f4")])
    out["x"], out["y"], out["z"] = x * np.cos(tilt) + z * np.sin(tilt), y, z * np.cos(tilt) - x * np.sin(tilt)
    out[::100] = np.nan
    return RawCloud(0, 0, "lidar", out, laser.size, 1)


def lasers(count: int, seed: int, n: int = 8000) -> NDArray[np.int64]:
    return np.random.default_rng(100 + seed).integers(0, count, n)


@pytest.mark.parametrize("elevation_deg", [VLP_16_DEG, UNEVEN_DEG], ids=["even", "uneven"])
def test_a_rotors_lasers_are_told_by_their_elevation(elevation_deg: FloatArray) -> None:
    """Oracle: which laser it was. Mutations: rows counted from the highest; a border beside the middle between two rows."""
    sample = [cloud(elevation_deg, lasers(len(elevation_deg), k), k) for k in range(12)]
    rows = find_rows(sample)
    assert rows is not None
    assert rows.middles_deg == pytest.approx(elevation_deg, abs=0.02)
    borders_deg = np.degrees(np.arctan(rows.between))[4:-4]
    assert borders_deg == pytest.approx(0.5 * (elevation_deg[1:] + elevation_deg[:-1]), abs=0.02)
    mine = lasers(len(elevation_deg), 50)
    seen = cloud(elevation_deg, mine, 50).points
    there = np.isfinite(seen["x"])
    assert np.array_equal(rows.of(seen)[there], mine[there])


def test_rows_that_are_seen_later_are_lasers_of_their_own() -> None:
    """The two lowest lasers of sixteen look at nothing at first. Mutation: what is below the lowest counts as the lowest."""
    sample = [cloud(VLP_16_DEG, 2 + lasers(14, k), k) for k in range(12)]
    rows = find_rows(sample)
    assert rows is not None
    seen = cloud(VLP_16_DEG, np.arange(1600) % 16, 50)
    told = rows.of(seen.points)
    of_laser = [set(told[(np.arange(1600) % 16 == k) & np.isfinite(seen.points["x"])].tolist()) for k in range(16)]
    assert of_laser[2:] == [{k} for k in range(14)]
    assert all(len(each) == 1 and min(each) >= 14 for each in of_laser[:2])
    assert of_laser[0] != of_laser[1]


def test_where_there_are_no_rows_nothing_is_told() -> None:
    """A beam that is steered anywhere, and up to straight up (seen: a defect), a rotor's points in the frame of a tilted mount, a
    twentieth astray, one point, none.

    Mutations: rows that fill the most of what lies between them; rows of half of the points.
    """
    anywhere = np.linspace(-25.0, 25.0, 8000)
    assert find_rows([cloud(anywhere, np.arange(8000), k) for k in range(12)]) is None
    assert find_rows([cloud(VLP_16_DEG, lasers(16, k), k, tilt_deg=7.0) for k in range(12)]) is None
    assert find_rows([cloud(VLP_16_DEG, lasers(16, k), k, tilt_deg=0.7) for k in range(12)]) is None
    astray = [np.where(np.arange(8000) % 20 > 0, lasers(16, k), 16 + lasers(8000, k)) for k in range(12)]
    mixed = np.concatenate([VLP_16_DEG, np.linspace(-45.0, 45.0, 8000)])
    assert find_rows([cloud(mixed, each, k) for k, each in enumerate(astray)]) is None
    assert find_rows([cloud(anywhere * 90.0 / 25.0, np.arange(8000), k) for k in range(12)]) is None
    assert find_rows([cloud(VLP_16_DEG, np.zeros(0, np.int64), 1)]) is None
    assert find_rows([cloud(VLP_16_DEG, np.zeros(1, np.int64), 1)]) is None


def with_ring(sample: list[RawCloud], ring: int) -> list[RawCloud]:
    """The same with a field for it, whose values go from 0 to this one."""
    out = []
    for each in sample:
        points: StructArray = np.zeros(each.points.size, [*each.points.dtype.descr, ("ring", "u2")])
        for name in each.names:
            points[name] = each.points[name]
        points["ring"] = np.arange(points.size) % (ring + 1)
        out.append(RawCloud(0, 0, "lidar", points, points.size, 1))
    return out


def test_a_ring_that_is_sent_is_believed() -> None:
    """One that is always zero says nothing. Mutations: rows whatever is sent; a field that is there is believed."""
    sample = [cloud(VLP_16_DEG, lasers(16, k), k) for k in range(12)]

    def decoder(message: RawMessage) -> RawCloud:
        return sample[0]

    assert by_rows(with_ring(sample, 15), decoder, "/points") == (decoder, ())
    for each in (sample, with_ring(sample, 0)):
        told, (finding,) = by_rows(each, decoder, "/points")
        assert finding.evidence[0].value == 16
        decoded = told(RawMessage("/points", 0, b""))
        assert decoded.laser is not None
        assert np.unique(decoded.laser[np.isfinite(decoded.points["x"])]).tolist() == list(range(16))


@pytest.mark.parametrize(("sensor", "seen"), [("vlp16", 14), ("vlp32", 29), ("vls128", 127)])
def test_real_rotors_lie_in_rows(sensor: str, seen: int, real_data: Path) -> None:
    """Oracle: the laser that the packets name. Some see nothing beyond two metres there. Mutation: bins ten times as wide."""
    folder = real_data / "velodyne_ros2_packets" / sensor
    with open_recording(next(p for p in folder.iterdir() if p.is_dir())) as recording:
        decode = cloud_decoder(recording.topics[0])
        clouds = [decode(message) for message in recording.messages([recording.topics[0].name])]
    rows = find_rows(clouds)
    assert rows is not None
    assert len(rows.middles_deg) == seen
    points = np.concatenate([each.points for each in clouds])
    points = points[np.sqrt(points["x"] ** 2 + points["y"] ** 2 + points["z"] ** 2) > 2.0]
    told = rows.of(points)
    rows_of = [np.unique(told[points["ring"] == ring]).tolist() for ring in np.unique(points["ring"])]
    assert rows_of == [[k] for k in range(len(rows.middles_deg))]
