"""The density of white noise under lines, filters and motion, against what was drawn and chi-square's law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from scipy.stats import chi2

from calib_core.full.prepare.imu_noise import measure_imu_noise
from calib_core.full.prepare.noise_floor import noise_floor
from calib_core.types import FloatArray

CHANNELS = 6


def _engine(t: FloatArray, amplitude: float, rng: np.random.Generator) -> FloatArray:
    """Three lines an axis between 25 and 120 Hz, as the readings see them."""
    waves = [
        np.sin(2 * np.pi * rng.uniform(25, 120, CHANNELS) * t[:, None] + rng.uniform(0, 6, CHANNELS)) for _ in "xyz"
    ]
    return np.asarray(amplitude * np.sum(waves, axis=0))


def _motion(t: FloatArray) -> FloatArray:
    """Seventy decibels above unit noise, up to five hertz."""
    waves = 1000.0 * np.sin(5.0 * t) + 500.0 * np.sin(12.6 * t + 1.0) + 30.0 * np.sin(31.4 * t + 2.0)
    return np.asarray(waves[:, None])


@pytest.mark.parametrize("seconds", [3.5, 12.0, 30.0])
@pytest.mark.parametrize("what", ["white", "lines", "filtered", "moving"])
def test_the_density_is_what_was_drawn_within_its_own_law(what: str, seconds: float) -> None:
    """Six channels of unit noise at 200 Hz: the squares of what the densities are off by, in their own sigmas, are chi-square.

    Mutations: weigh the segments' overlap wrongly; count every value of the spectrum as one of its own.
    """
    rate_hz, seeds = 200.0, 10
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    off = []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, int(seconds)])
        noise = rng.normal(size=(len(t) + 400, CHANNELS))
        if what == "filtered":  # twice as wide as where noise is looked for: 3 % of the density are lost there
            noise = sosfilt(butter(2, 40.0, fs=rate_hz, output="sos"), noise, axis=0)
        readings = noise[400:]
        if what in ("lines", "moving"):
            readings = readings + _engine(t, 30.0, rng)
        if what == "moving":
            readings = readings + _motion(t)
        found = noise_floor(t, readings, lowest_hz=1.0 if what != "moving" else 8.0)
        off.append(np.log(found.density * np.sqrt(rate_hz)) / found.relative_std)
    total = float(np.sum(np.square(off)))
    assert chi2.ppf(1e-3, seeds * CHANNELS) < total < chi2.ppf(1 - 1e-3, seeds * CHANNELS)


def test_a_sensor_too_slow_to_tell_has_no_floor() -> None:
    """Mutation: look in stretches of two hertz."""
    t = np.arange(500) / 25.0
    found = noise_floor(t, np.random.default_rng(0).normal(size=(500, 2)), lowest_hz=8.0)
    assert np.isnan(found.density).all()


def test_readings_that_are_missing_are_no_noise() -> None:
    """One in fifty lost: within 3 %. Mutation: take the rest as if they lay a period apart (motion's phase jumps)."""
    t = np.arange(6000) / 200.0
    rng = np.random.default_rng(1)
    there = rng.random(len(t)) > 0.02
    readings = rng.normal(size=(len(t), CHANNELS)) + _motion(t)
    found = noise_floor(t[there], readings[there], lowest_hz=8.0)
    assert np.sqrt(np.mean(found.density**2)) * np.sqrt(200.0) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("filtered", [False, True])
@pytest.mark.parametrize("band_hz", [(14.0, 38.0), (20.0, 70.0)])
def test_a_road_that_shakes_in_a_band_is_no_noise(band_hz: tuple[float, float], filtered: bool) -> None:
    """Wheels on cobbles, a hundred times the noise in a band, whose top is flat: what lies below it says that this is none.

    Unit noise at 400 Hz, with and without a filter at 50 Hz, of which the end of the spectrum would say a twentieth: no more than
    half again, as the band has a foot, and no less than 0.9. Mutations: the floor may lie above what is seen below it (60
    times); the least of all frequencies.
    """
    rate_hz = 400.0
    t = np.arange(int(25 * rate_hz)) / rate_hz
    rng = np.random.default_rng(4)
    noise, shaking = rng.normal(size=(2, len(t) + 400, CHANNELS))
    if filtered:
        noise = sosfilt(butter(2, 50.0, fs=rate_hz, output="sos"), noise, axis=0)
    shaking = sosfilt(butter(6, band_hz, "bandpass", fs=rate_hz, output="sos"), shaking, axis=0)
    readings = (noise + 100.0 * shaking)[400:] + _motion(t)
    found = noise_floor(t, readings, lowest_hz=8.0).density * np.sqrt(rate_hz)
    assert (found > 0.9).all()
    assert (found < 1.5).all()


@pytest.mark.parametrize("standing", [True, False])
def test_an_engine_makes_readings_wider_but_not_their_density(standing: bool) -> None:
    """Density to 12 %, sample deviation with the shaking in it. Mutations: the density of all frequencies; of the floor."""
    rate_hz, std = 200.0, np.repeat([2e-3, 0.03], 3)
    t = np.arange(4000) / rate_hz
    rng = np.random.default_rng(2)
    readings = std * (rng.normal(size=(len(t), CHANNELS)) + _engine(t, 20.0, rng))
    still = slice(0, 1000) if standing else None
    level = measure_imu_noise(t, readings[:, :3], readings[:, 3:], still)
    density = np.concatenate([level.density.gyro_rad_s_sqrt_hz, level.density.accel_m_s2_sqrt_hz])
    np.testing.assert_allclose(density, std / np.sqrt(rate_hz), rtol=0.12)
    assert (level.sample_std > 5.0 * std).all()
    assert "low frequencies" in level.source
