"""Readings of an IMU with its own errors taken out of them, for whoever looks at them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.assess.own_errors import ideal_lasers, ideal_readings
from calib_core.result import Intrinsic
from calib_core.simulate import Truth, generate, parse_faults
from calib_core.types import ImuData, Recording
from tests.core.simulate.faulty import STATIC


def _known(truth: Truth) -> Any:
    """A result that knows all that a truth does of the sensors."""
    found = [
        SimpleNamespace(block=each.block, name=each.name, value=each.value, state="estimated")
        for each in truth.intrinsics
    ]
    return SimpleNamespace(intrinsics=found, clock_rate_ppm=None)


@pytest.mark.parametrize(
    "faults",
    [
        "gyro-scale=0.01",
        "accel-scale=0.01",
        "imu-axes=0.01",
        "gyro-rotation=0.02",
        "g-sensitivity=1e-3",
        "accel-delay=4ms",
        "accel-bend=1e-4",
        "size-effect=20mm",
        "imu-axes=0.01,accel-scale=0.01,gyro-scale=0.01,gyro-rotation=0.01,g-sensitivity=2e-4,size-effect=20mm",
    ],
)
def test_readings_without_errors_are_those_of_an_ideal_imu(faults: str) -> None:
    """To a tenth of what they were off by. Oracle: the same motion through a simulated IMU without them.

    Mutations: the sign of the delay, of the bend, of what the gyroscope feels of forces, of the accelerometers' places; a matrix
    not inverted, or transposed; forces felt by columns.
    """
    ideal, faulty = (
        generate("noise-free-fast", seed=3, duration_s=4.0, faults=parse_faults(each)) for each in ("", faults)
    )
    found, true, read = ideal_readings(faulty[0], _known(faulty[1])), ideal[0].imu, faulty[0].imu
    inner = slice(20, -20)
    for one, right, wrong in (
        (found.gyro_rad_s, true.gyro_rad_s, read.gyro_rad_s),
        (found.accel_m_s2, true.accel_m_s2, read.accel_m_s2),
    ):
        was_off = np.abs(wrong - right)[inner].max()
        assert np.abs(one - right)[inner].max() <= max(0.1 * was_off, 1e-9)


def _off_planes_m(recording: Recording, truth: Truth, points_m: np.ndarray) -> float:
    """Of points of a lidar that stands, the 90 % quantile of how far they are from the nearest plane there is."""
    normals, offsets_m = np.array([p.normal for p in truth.planes]), np.array([p.offset_m for p in truth.planes])
    return float(np.quantile(np.abs(points_m.astype(np.float64) @ normals.T + offsets_m).min(axis=1), 0.9))


@pytest.mark.parametrize(
    "faults",
    [
        "laser-offsets=20mm",
        "range-offset=30mm",
        "laser-scale=0.01",
        "laser-elevation=0.5deg",
        "laser-azimuth=0.5deg",
        "eccentricity=0.5deg",
        "laser-offsets=20mm,range-offset=30mm,laser-elevation=0.5deg,eccentricity=0.3deg",
    ],
)
def test_points_without_errors_lie_where_the_walls_are(faults: str) -> None:
    """To a thirtieth of what they were off by. Oracle: the simulated room's own planes.

    Mutations: all lasers' offset taken from each one's; sine and cosine change places; elevation taken for azimuth; lasers not
    told apart.
    """
    recording, truth = generate(STATIC, seed=5, faults=parse_faults(faults))
    lasers = ideal_lasers(_known(truth))
    assert lasers is not None
    scan = recording.scans[0]
    was_off = _off_planes_m(recording, truth, scan.points["xyz"])
    assert was_off > 1e-3
    assert _off_planes_m(recording, truth, lasers.corrected(scan).points["xyz"]) < was_off / 30.0


def _beyond_m(points_m: np.ndarray, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """(N,) [m] how far points lie behind their plane, seen from the lidar, and the incidence's cosine, positive."""
    normals, offsets_m = np.array([p.normal for p in truth.planes]), np.array([p.offset_m for p in truth.planes])
    nearest = np.abs(points_m @ normals.T + offsets_m).argmin(axis=1)
    towards = np.sum(points_m * normals[nearest], axis=1)
    cosine = towards / np.linalg.norm(points_m, axis=1)
    return np.sign(cosine) * (towards + offsets_m[nearest]), np.abs(cosine)


@pytest.mark.parametrize("block", ["grazing", "incidence"])
def test_distances_without_slant_are_those_of_a_thin_beam(block: str) -> None:
    """Short by 5 mrad of range and tangent, or long by 8 mm (1 / c - 1), along the ray by hand. Oracle: the room's own planes.

    Mutations: the sign of what lies beyond; the cosine's own sign kept; the one taken for the other.
    """
    recording, truth = generate(STATIC, seed=5)
    exact_m = recording.scans[0].points["xyz"].astype(np.float64)
    _, cosine = _beyond_m(exact_m, truth)
    exact_m, cosine = exact_m[cosine > 0.2], cosine[cosine > 0.2]
    range_m = np.linalg.norm(exact_m, axis=1)
    tangent = np.sqrt(1.0 - cosine**2) / cosine
    longer_m = -5e-3 * range_m * tangent if block == "grazing" else 8e-3 * (1.0 / cosine - 1.0)
    points_m = exact_m * (1.0 + longer_m / range_m)[:, None]
    value = SimpleNamespace(block=block, name="all", value=5e-3 if block == "grazing" else 8e-3, state="estimated")
    known: Any = SimpleNamespace(intrinsics=[value], clock_rate_ppm=None)
    lasers = ideal_lasers(known)
    assert lasers is not None
    beyond_m, cosine = _beyond_m(points_m, truth)
    was_off = np.quantile(np.abs(beyond_m), 0.9)
    assert was_off > 2e-3
    for sign in (1.0, -1.0):
        left_m = lasers.straightened(beyond_m, sign * cosine, points_m)
        assert np.quantile(np.abs(left_m), 0.9) < 0.05 * was_off


def test_what_a_filter_smeared_is_sharp_again() -> None:
    """A sine behind two poles whose delay is allowed for, at stamps that are not even; only the gyroscope is named.

    Mutations: not taken out; taken out of both.
    """
    pole_s, w = 0.008, 2.0 * np.pi * 2.0
    at_s = np.arange(900) / 300.0 + np.random.default_rng(1).uniform(0.0, 0.001, 900)
    answer = np.exp(2j * w * pole_s) / (1.0 + 1j * w * pole_s) ** 2
    phase = np.array([0.0, 1.0, 2.0])
    smeared, sharp = ((of * np.exp(1j * (w * at_s[:, None] + phase))).imag for of in (answer, 1.0))
    imu = ImuData(np.rint(at_s * 1e9).astype(np.int64), smeared, smeared)
    unit: Any = "s2"
    known = Intrinsic(
        block="low_pass_spread", name="gyroscope", unit=unit, value=2.0 * pole_s**2, std=1e-6, prior_std=1e-4,
        state="estimated", significant=True,
    )  # fmt: skip
    skew = known.model_copy(update={"block": "low_pass_skew", "value": 4.0 * pole_s**3})
    recording: Any = SimpleNamespace(imu=imu, scans=())
    result: Any = SimpleNamespace(intrinsics=[known, skew], clock_rate_ppm=None)
    ideal = ideal_readings(recording, result)
    inner = (at_s > 0.1) & (at_s < 2.9)
    np.testing.assert_allclose(ideal.gyro_rad_s[inner], sharp[inner], atol=3.0 * (w * pole_s) ** 4 + 3e-4)
    assert np.abs(smeared - sharp).max() > 5e-3
    np.testing.assert_array_equal(ideal.accel_m_s2, smeared)
    untouched: Any = SimpleNamespace(intrinsics=[], clock_rate_ppm=None)
    assert ideal_readings(recording, untouched) is imu


def test_the_clocks_rate_turns_about_the_instant_at_which_the_offset_holds() -> None:
    """10 s after the recording's start, of which 4 s were not read. Mutations: from the first scan read; the rate's sign."""
    imu = ImuData(np.array([0, 6, 16]) * 1_000_000_000, np.zeros((3, 3)), np.zeros((3, 3)))
    scan: Any = SimpleNamespace(stamp_ns=0)
    recording: Any = SimpleNamespace(imu=imu, scans=(scan,), skipped_s=4.0)
    unit: Any = "ppm"
    rate = Intrinsic(
        block="clock_rate",
        name="rate",
        unit=unit,
        value=50.0,
        std=1.0,
        prior_std=40.0,
        state="estimated",
        significant=True,
    )
    result: Any = SimpleNamespace(intrinsics=[rate], clock_rate_ppm=50.0, time_offset_ns=0, time_offset_at_s=10.0)
    moved_ns = ideal_readings(recording, result).stamps_ns - imu.stamps_ns
    assert moved_ns.tolist() == [-300_000, 0, 500_000]
