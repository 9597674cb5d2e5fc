"""Readings of an IMU with its own errors taken out of them, for whoever looks at them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from calib_core.full.assess.own_errors import ideal_readings
from calib_core.result import Intrinsic
from calib_core.types import ImuData


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
