"""Readings that a driver sends again until there is a new one, against the instants at which the sensor took them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core import api
from calib_core.readers.imu.messages import RawImu
from calib_core.readers.imu.readings import clean_imu
from calib_core.readers.imu.repeats import first_of_each
from calib_core.settings import ReadSettings
from calib_core.simulate import generate, parse_faults, prepare, simulate
from calib_core.types import FloatArray, IntArray
from tests.core.readers import build

COUNT = 4000
PERIOD_NS = 5_000_000


def _moved(count: int, *, step_rad_s: float = 0.0, rest: int = 0) -> tuple[FloatArray, FloatArray]:
    """Rates of turn and accelerations of a hand's motion, (count, 3) each, after `rest` readings of standing still."""
    rng = np.random.default_rng(5)
    t = np.maximum(np.arange(count) - rest, 0) * PERIOD_NS * 1e-9
    gyro = np.stack([np.sin(2.0 * t), np.sin(3.1 * t), np.sin(4.7 * t)], axis=1) + rng.normal(0.0, 2e-3, (count, 3))
    accel = np.array([0.0, 0.0, 9.8]) + rng.normal(0.0, 0.02, (count, 3))
    return (np.rint(gyro / step_rad_s) * step_rad_s if step_rad_s else gyro), accel


def _raw(stamps_ns: IntArray, gyro: FloatArray, accel: FloatArray) -> RawImu:
    return RawImu(stamps_ns, stamps_ns + 1_000_000, gyro, accel, "imu", 0)


def _sent(every: float, *, accel_too: bool) -> tuple[RawImu, IntArray]:
    """A loop that sends so many times while the sensor takes one reading; and when each reading was first sent."""
    gyro, accel = _moved(COUNT)
    number = np.floor(np.arange(COUNT) / every).astype(np.int64)
    stamps_ns = build.EPOCH_NS + PERIOD_NS * np.arange(COUNT, dtype=np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    return _raw(stamps_ns, gyro[number], accel[number] if accel_too else accel), stamps_ns[first]


@pytest.mark.parametrize("every", [1.25, 1.37, 2.0, 3.0, 8.0])
@pytest.mark.parametrize("accel_too", [True, False], ids=["both", "the gyroscope alone"])
def test_the_first_of_each_reading_counts(every: float, accel_too: bool) -> None:
    """Mutations: the last of each is kept; only where the accelerometer repeats as well."""
    given, first_ns = _sent(every, accel_too=accel_too)
    cleaned = clean_imu(given, ReadSettings(), "/imu")
    np.testing.assert_array_equal(cleaned.imu.stamps_ns, first_ns)
    said = {finding.code: finding for finding in cleaned.findings}
    share = 1.0 - len(first_ns) / COUNT
    assert f"{share:.0%} of the readings on /imu repeat the angular rate of the one before" in said["imu.repeats"].text
    assert said["imu.repeats"].evidence[0].value == COUNT - len(first_ns)
    assert "imu.gaps" not in said


def test_a_gyroscope_that_reads_nought_of_slow_turns_in_coarse_steps_has_new_readings_there() -> None:
    """Seen: a Mid-360's, sent again now and then, of which "108 are missing". Mutation: the gyroscope alone is asked."""
    given, first_ns = _sent(1.25, accel_too=True)
    given.gyro[:] = 0.02 * np.rint(given.gyro / 0.02) * (np.abs(given.gyro) > 0.5)
    assert np.mean((given.gyro[1:] == given.gyro[:-1]).all(axis=1)) > 0.3
    cleaned = clean_imu(given, ReadSettings(), "/imu")
    np.testing.assert_array_equal(cleaned.imu.stamps_ns, first_ns)


def test_repeats_are_left_where_asked() -> None:
    """Mutation: the setting is not looked at."""
    given, _ = _sent(2.0, accel_too=True)
    left = clean_imu(given, ReadSettings(imu_bundles="as-stamped"), "/imu")
    assert len(left.imu.stamps_ns) == COUNT
    assert "imu.repeats" not in {finding.code for finding in left.findings}


@pytest.mark.parametrize(
    "case", ["fine", "coarse steps", "coarser than the motion", "half of it at rest", "a stuck second", "stuck", "few"]
)
def test_what_a_sensor_reads_twice_by_itself_is_kept(case: str) -> None:
    """Coarse: 16 bits over 2000 deg/s. At rest: with noise of a tenth of the step, so that nearly all repeat. Coarser than the
    motion: 12 bits, of slow turns, of which 38 % were left out, and their accelerations with them.

    Mutations: the mean share of all stretches is asked; no least share; no largest one (one
    reading was left of a sensor that was stuck); chance is not counted.
    """
    match case:
        case "coarse steps":
            gyro, accel = _moved(COUNT, step_rad_s=1.07e-3)
        case "coarser than the motion":
            gyro, accel = _moved(COUNT)
            gyro = 0.017 * np.rint(0.4 * gyro / 0.017)
            assert (gyro[1:] == gyro[:-1]).all(axis=1).mean() > 0.3
        case "half of it at rest":
            gyro, accel = _moved(COUNT, step_rad_s=2e-2, rest=COUNT // 2)
        case "a stuck second":
            gyro, accel = _moved(COUNT)
            gyro[1000:1200] = gyro[1000]
        case "stuck":
            gyro, accel = _moved(COUNT)
            gyro[:] = gyro[0]
        case "few":
            gyro, accel = (each[:200].repeat(1, axis=0) for each in _moved(COUNT))
            gyro = gyro[::2].repeat(2, axis=0)
        case _:
            gyro, accel = _moved(COUNT)
    assert first_of_each(gyro, accel) is None
    stamps_ns = build.EPOCH_NS + PERIOD_NS * np.arange(len(gyro), dtype=np.int64)
    cleaned = clean_imu(_raw(stamps_ns, gyro, accel), ReadSettings(), "/imu")
    assert len(cleaned.imu.stamps_ns) == len(gyro)


def test_lost_messages_do_not_hide_a_driver_that_repeats() -> None:
    """Three in a hundred are lost, and a second at once."""
    given, _ = _sent(2.0, accel_too=True)
    kept = np.random.default_rng(1).random(COUNT) > 0.03
    kept[700:900] = False
    fresh = first_of_each(given.gyro[kept], given.accel[kept])
    assert fresh is not None
    numbers = np.flatnonzero(kept) // 2
    np.testing.assert_array_equal(fresh, np.diff(numbers, prepend=-1) > 0)


def test_a_bag_with_readings_sent_again_is_read_as_the_simulator_knows_them(tmp_path: Path) -> None:
    """Mutations of the simulator: every third reading at the instant of the last; of the reader: none left out."""
    faults = parse_faults("imu-repeats=3")
    simulate("paper-normal", tmp_path / "b.bag", duration_s=5.0, faults=faults)
    known, truth = generate("paper-normal", duration_s=5.0, faults=faults)
    read = api.load(tmp_path / "b.bag").imu
    np.testing.assert_array_equal(read.stamps_ns, known.imu.stamps_ns)
    np.testing.assert_array_equal(read.gyro_rad_s, known.imu.gyro_rad_s)
    assert [each.value for each in truth.intrinsics if each.block == "imu_repeats"] == [3]
    # What is left was measured at its own stamp: the same readings as without a driver that repeats.
    plain = prepare("paper-normal", duration_s=5.0).imu_records
    np.testing.assert_array_equal(read.stamps_ns, plain.stamps_ns[::3])
    np.testing.assert_array_equal(read.gyro_rad_s, plain.gyro_rad_s[::3])
