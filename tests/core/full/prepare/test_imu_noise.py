"""IMU noise as measured against what was drawn, and standstill as found against what was done."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.events import Event, LogEvent, never_cancel
from calib_core.full.prepare import imu_noise
from calib_core.full.prepare.imu_noise import (
    longest_still,
    measure_imu_noise,
    rests_throughout,
)
from calib_core.full.prepare.noise_floor import Floor
from calib_core.full.prepare.prepare import prepare
from calib_core.full.prepare.settings import NOISE
from calib_core.full.run import ImuNoiseLevel
from calib_core.presets import find_imu_preset
from calib_core.settings import CalibrateSettings, ImuNoise
from calib_core.simulate import SCENARIOS, Truth, generate
from calib_core.simulate.motion import Start
from calib_core.types import FloatArray, ImuData
from tests.core.full.conftest import SHORT

GYRO_STD, ACCEL_STD = 2e-3, 0.03
_SCENARIO = SCENARIOS["paper-fast"]


def _recorded(
    seconds: float, rate_hz: float, *, seed: int, noise: float = 1.0
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fast hand-held motion after a second of standstill: stamps, gyro, accel with white noise on top."""
    truth = Truth(_SCENARIO, 0, 0, 0, np.zeros(3), np.zeros(3))
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    at = truth.imu(t)
    force = np.einsum("nji,nj->ni", at.R_world, at.a_m_s2 - truth.gravity_world_m_s2)
    rng = np.random.default_rng(seed)
    gyro = at.omega_rad_s + noise * GYRO_STD * rng.normal(size=(len(t), 3))
    return t, gyro, force + noise * ACCEL_STD * rng.normal(size=(len(t), 3))


@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_noise_is_what_was_drawn_moving_or_still(rate_hz: float) -> None:
    """Fails when a standstill's differences are not divided by two, or densities by the root of the period.

    From n samples a variance is good to sqrt(2 / n), doubled for neighbours' shared readings and again for the median
    in motion; three axes pooled. Five sigmas.
    """
    t, gyro, accel = _recorded(30.0, rate_hz, seed=1)
    rng = np.random.default_rng(2)
    quiet = rng.normal(size=(len(t), 6)) * np.repeat([GYRO_STD, ACCEL_STD], 3) + [0.01, 0.02, 0, 0, 0, 9.8]
    still = slice(0, len(t))
    for level, n in (
        (measure_imu_noise(t, gyro, accel, None), len(t)),
        (measure_imu_noise(t, quiet[:, :3], quiet[:, 3:], still), len(t)),
    ):
        for std, true in ((level.sample_std[:3], GYRO_STD), (level.sample_std[3:], ACCEL_STD)):
            assert np.ptp(std) == 0.0
            assert abs(std[0] / true - 1) < 5 * np.sqrt(2.0 / (3 * n))
        np.testing.assert_allclose(level.density.gyro_rad_s_sqrt_hz, level.sample_std[:3] / np.sqrt(rate_hz))
        np.testing.assert_allclose(level.density.accel_m_s2_sqrt_hz, level.sample_std[3:] / np.sqrt(rate_hz))


def test_an_engine_shakes_the_readings_and_a_brisk_hand_does_not() -> None:
    """Three lines of 30 to 47 Hz, 0.2 m/s2 and 0.02 rad/s each. Mutations: always shaken; the density compared with itself."""
    t, gyro, accel = _recorded(30.0, 100.0, seed=6)
    lines = sum(np.sin(2 * np.pi * hz * t + hz)[:, None] for hz in (30.3, 37.7, 46.9))
    assert not measure_imu_noise(t, gyro, accel, None).shaken
    assert measure_imu_noise(t, gyro + 0.02 * lines, accel + 0.2 * lines, None).shaken


def test_a_slow_drift_in_a_standstill_is_not_noise() -> None:
    """Fails when the standstill's standard deviation is taken instead of its differences'."""
    rng = np.random.default_rng(3)
    t = np.arange(2000) / 100.0
    values = rng.normal(size=(2000, 6)) * np.repeat([GYRO_STD, ACCEL_STD], 3) + np.outer(t, [0.01] * 3 + [0.1] * 3)
    level = measure_imu_noise(t, values[:, :3], values[:, 3:], slice(0, 2000))
    np.testing.assert_allclose(level.sample_std, np.repeat([GYRO_STD, ACCEL_STD], 3), rtol=0.06)


def test_a_noise_free_sensor_is_held_to_a_floor_and_a_coarse_one_to_its_resolution() -> None:
    """Fails when the floor is left out: the solve would divide by zero. Or when the resolution is."""
    t, gyro, accel = _recorded(10.0, 100.0, seed=4, noise=0.0)
    level = measure_imu_noise(t, gyro, accel, None)
    assert (level.density.gyro_rad_s_sqrt_hz >= NOISE.gyro_floor_rad_s_sqrt_hz * 0.999).all()
    assert (level.density.accel_m_s2_sqrt_hz >= NOISE.accel_floor_m_s2_sqrt_hz * 0.999).all()
    assert (level.sample_std < 1e-3).all()
    coarse = measure_imu_noise(
        t, np.zeros((len(t), 3)) + 0.02 * (np.arange(len(t)) % 50 == 0)[:, None], accel, slice(0, 900)
    )
    assert coarse.sample_std[0] >= 0.02 / np.sqrt(12.0) * 0.999


def test_the_standstill_found_is_the_one_that_was_made() -> None:
    """Fails when windows are returned instead of samples.

    Still for 3 s, then swaying: found to a quarter-second window at its start, and to half a second at its end, where
    the ramp has not yet moved anything by more than the noise.
    """
    motion = SCENARIOS["handheld"].motion
    assert getattr(motion, "start", None) == Start(static_s=3.0, ramp_s=2.0)
    truth = Truth(SCENARIOS["handheld"], 0, 0, 0, np.zeros(3), np.zeros(3))
    t = np.arange(1200) / 100.0
    at = truth.imu(t)
    force = np.einsum("nji,nj->ni", at.R_world, at.a_m_s2 - truth.gravity_world_m_s2)
    rng = np.random.default_rng(5)
    still = longest_still(
        t, at.omega_rad_s + 1e-3 * rng.normal(size=(1200, 3)), force + 0.01 * rng.normal(size=(1200, 3))
    )
    assert still is not None
    assert still.start == 0
    assert 2.75 <= t[still.stop - 1] <= 3.6


def test_a_recording_without_standstill_has_none_and_one_that_never_moves_is_all() -> None:
    """Fails when a steady turn counts as still (no limit on the mean rate), or a slow creep does (means not compared)."""
    rng = np.random.default_rng(6)
    t = np.arange(1000) / 100.0
    noise = rng.normal(size=(1000, 6)) * np.repeat([1e-3, 0.01], 3)
    steady = noise[:, :3] + [0.0, 0.0, 0.5]
    assert longest_still(t, steady, noise[:, 3:] + [0, 0, 9.8]) is None
    moving = _recorded(12.0, 100.0, seed=7)
    late = [values[300:] for values in moving]
    assert longest_still(*late) is None
    creep = noise[:, :3] + np.linspace(0.0, 0.1, 1000)[:, None] * [1.0, 0.0, 0.0]
    still = longest_still(t, creep, noise[:, 3:] + [0, 0, 9.8])
    assert still is None or still.stop - still.start < 150
    whole = longest_still(t, noise[:, :3] + [0.01, 0.0, 0.0], noise[:, 3:] + [0, 0, 9.8])
    assert whole == slice(0, 1000)
    assert longest_still(t[:60], noise[:60, :3], noise[:60, 3:]) is None


@pytest.mark.parametrize("moved", [None, slice(0, 50), slice(480, 530), slice(950, 1010)])
def test_a_recording_rests_throughout_where_nobody_touches_it(moved: slice | None) -> None:
    """Ten seconds and a rest that is less than a block; touched at its start, in between, or at its end. Mutations: any
    standstill; its start, its end not asked for; what is left of a block asked for.
    """
    rng, t = np.random.default_rng(7), np.arange(1010) / 100.0
    gyro = 1e-3 * rng.normal(size=(1010, 3)) + [0.01, 0.0, 0.0]
    accel = 0.01 * rng.normal(size=(1010, 3)) + [0.0, 0.0, 9.8]
    if moved is not None:
        gyro[moved, 1] += 0.3
    imu = ImuData((1e9 * t).astype(np.int64), gyro, accel)
    assert rests_throughout(t, imu) == (moved is None)


@pytest.mark.parametrize(
    ("still", "moving", "found"),
    [
        (1.02, 1.01, 1.0),  # white, and told so by both
        (0.9, None, 1.0),
        (None, None, 1.0),
        (0.2, 0.21, 0.2),  # an engine on, and its lines apart
        (0.9, 0.04, 0.04),  # seen: a standstill so short that its lines are all there is
        (1.02, 0.9, 1.0),  # by chance
    ],
)
def test_the_density_is_that_of_the_lowest_floor_unless_noise_is_white(
    still: float | None, moving: float | None, found: float
) -> None:
    """By hand, of a noise of 1 at all frequencies, floors good to a tenth. Seen: 25 times the noise there was, and a lever arm
    to 8 mm where half a one is possible, behind a standstill of 2.5 s with an engine on.

    Mutations: the first floor alone is asked; the lowest taken by chance too.
    """
    floors = [Floor(np.full(3, level), np.full(3, 0.1)) for level in (still, moving) if level is not None]
    assert imu_noise._at_low_frequencies(1.0, floors, slice(0, 3)) == pytest.approx(found)


def test_a_preset_names_an_imu_and_does_not_say_how_noisy_this_one_is() -> None:
    """A unit three times as noisy as its data sheet. Oracle: the noise it was simulated with; the sheet's were below the bound.

    Mutations: the sheet's densities taken for this unit's; given ones replaced by what is measured; a contradiction not said.
    """
    sheet = find_imu_preset("xsens-mti-300")
    assert sheet is not None
    gyro, accel = (
        sheet.noise.gyroscope_noise_density_rad_s_sqrt_hz,
        sheet.noise.accelerometer_noise_density_m_s2_sqrt_hz,
    )
    noisy = replace(
        SHORT.imu,
        gyroscope_noise_density_rad_s_sqrt_hz=3.0 * gyro,
        accelerometer_noise_density_m_s2_sqrt_hz=3.0 * accel,
    )
    recording = generate(replace(SHORT, imu=noisy), seed=1)[0]

    def prepared(noise: ImuNoise | str | None) -> tuple[ImuNoiseLevel, list[str]]:
        said: list[str] = []

        def listen(event: Event) -> None:
            if isinstance(event, LogEvent) and event.level == "warning":
                said.append(event.code)

        run = prepare(recording, CalibrateSettings(imu_noise=noise), listen, never_cancel)
        return run.noise, said

    measured, silent = prepared(None)
    np.testing.assert_allclose(measured.density.gyro_rad_s_sqrt_hz, 3.0 * gyro, rtol=0.1)
    np.testing.assert_allclose(measured.density.accel_m_s2_sqrt_hz, 3.0 * accel, rtol=0.1)
    named, also_silent = prepared("xsens-mti-300")
    np.testing.assert_array_equal(named.density.gyro_rad_s_sqrt_hz, measured.density.gyro_rad_s_sqrt_hz)
    assert (silent, also_silent) == ([], [])
    given, said = prepared(sheet.noise)
    np.testing.assert_allclose(given.density.accel_m_s2_sqrt_hz, accel)
    assert said == ["imu.noise_given"]
