"""Stamps that step backwards: the readings say whether they are in the order of their stamps or in that in which they came."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.readers.imu.messages import RawImu
from calib_core.readers.imu.readings import CleanedImu, clean_imu
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray, IntArray
from tests.core.imu.instants import EPOCH_NS, in_ns, readings_at

PERIOD_S = 0.005


def _cleaned(stamps_ns: IntArray, readings: FloatArray) -> tuple[CleanedImu, str]:
    """What the reader makes of it, and what it says of the order."""
    gyro, accel = readings[:, :3], readings[:, 3:] + [0.0, 0.0, 9.8]
    receive_ns = EPOCH_NS + np.arange(len(stamps_ns)) * round(1e9 * PERIOD_S) + 10_000_000
    cleaned = clean_imu(RawImu(stamps_ns, receive_ns, gyro, accel, "imu", 0), ReadSettings(), "/imu")
    return cleaned, next((f.text for f in cleaned.findings if f.code == "imu.out_of_order"), "")


@pytest.mark.parametrize("seed", range(4))
def test_readings_of_a_jittering_clock_keep_the_order_in_which_they_came(seed: int) -> None:
    """Stamps off by 3 ms where a reading comes every 5 ms. Mutation: sort readings by stamps that jitter."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(4000)
    readings = readings_at(t, rng)
    stamps_ns = in_ns(t + 0.003 * rng.standard_normal(len(t)))
    cleaned, said = _cleaned(stamps_ns, readings)
    np.testing.assert_array_equal(cleaned.imu.gyro_rad_s, readings[:, :3])
    np.testing.assert_array_equal(cleaned.imu.stamps_ns, np.sort(stamps_ns))
    assert "keep the order in which they arrived" in said


@pytest.mark.parametrize("seed", range(4))
def test_readings_that_were_overtaken_go_back_to_their_stamps(seed: int) -> None:
    """One in ten comes up to 15 ms late, rightly stamped. Mutation: keep the order in which readings came."""
    rng = np.random.default_rng(seed)
    t = PERIOD_S * np.arange(4000)
    readings = readings_at(t, rng)
    order = np.argsort(t + np.where(rng.random(len(t)) < 0.1, rng.uniform(0.0, 0.015, len(t)), 0.0), kind="stable")
    cleaned, said = _cleaned(in_ns(t)[order], readings[order])
    np.testing.assert_array_equal(cleaned.imu.gyro_rad_s, readings[:, :3])
    np.testing.assert_array_equal(cleaned.imu.stamps_ns, in_ns(t))
    assert said.endswith("readings were sorted by stamp.")


def test_where_noise_hides_the_motion_stamps_are_believed() -> None:
    """Standing still, both orders are as rough. Mutation: keep the order unless stamps are smoother."""
    rng = np.random.default_rng(1)
    t = PERIOD_S * np.arange(4000)
    readings = np.hstack([1e-3 * rng.standard_normal((4000, 3)), 0.01 * rng.standard_normal((4000, 3))])
    _, said = _cleaned(in_ns(t + 0.003 * rng.standard_normal(len(t))), readings)
    assert said.endswith("readings were sorted by stamp.")


def test_a_clock_that_was_set_back_keeps_no_order() -> None:
    """By half a second: neither order is right, and stamps shared out among readings would be half a second wrong.

    Mutation: readings however far out of place.
    """
    rng = np.random.default_rng(2)
    t = PERIOD_S * np.arange(4000)
    readings = readings_at(t, rng)
    stamps_ns = in_ns(t - np.where(t > 10.0, 0.5, 0.0) + 1e-5)
    cleaned, said = _cleaned(stamps_ns, readings)
    assert said.endswith("readings were sorted by stamp.")
    by_stamp = np.argsort(stamps_ns, kind="stable")
    np.testing.assert_array_equal(cleaned.imu.gyro_rad_s[:1800], readings[by_stamp][:1800, :3])
