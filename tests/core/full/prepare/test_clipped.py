"""Readings that the IMU's range cut off are said before anything is made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.events import Event, LogEvent, never_cancel
from calib_core.full.prepare.prepare import prepare
from calib_core.imu.clipping import LEAST_GYRO_RANGE_RAD_S, clipped_share, clipped_text
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording


@pytest.mark.parametrize("range_rad_s", [np.inf, 2.18])
def test_a_clipped_gyroscope_is_named(noisy: tuple[Recording, Truth], range_rad_s: float) -> None:
    """Seen: a tenth of all readings cut off, and scale, axes and walls blamed. Mutations: never said; said of whole ones."""
    recording, _ = noisy
    imu = recording.imu
    fast = 4.0 / np.abs(imu.gyro_rad_s).max() * imu.gyro_rad_s
    given = replace(recording, imu=replace(imu, gyro_rad_s=np.clip(fast, -range_rad_s, range_rad_s)))
    said: list[Event] = []
    prepare(given, CalibrateSettings(), said.append, never_cancel)
    told = [event.text for event in said if isinstance(event, LogEvent) and event.code == "imu.clipped"]
    assert len(told) == np.isfinite(range_rad_s)
    for text in told:
        share = np.mean(np.abs(fast) > range_rad_s, axis=0).max()
        assert text.startswith("the gyroscope is clipped in ")
        assert float(text.split("clipped in ")[1].split("%")[0]) / 100.0 == pytest.approx(share, rel=0.6)


def _read(seed: int, peak_rad_s: float, range_rad_s: float, std_rad_s: float, step_rad_s: float) -> FloatArray:
    """(4000, 3) of a hand's swings at 200 Hz, about x the fastest, as a gyroscope of that range and step reads them."""
    rng, t = np.random.default_rng(seed), np.arange(4000) / 200.0
    hz, phase = rng.uniform(0.4, 1.2, (3, 1)), rng.uniform(0.0, 2.0 * np.pi, (3, 1))
    rate = np.array([peak_rad_s, 0.5, 0.4]) * np.sin(2.0 * np.pi * hz * t + phase).T
    rate += std_rad_s * rng.normal(size=rate.shape)
    return np.asarray(np.clip(step_rad_s * np.round(rate / step_rad_s), -range_rad_s, range_rad_s))


@pytest.mark.parametrize(
    ("std_deg_s", "step_deg_s"), [(0.0, 0.06), (0.06, 0.06), (0.2, 0.06), (0.05, 0.25), (0.2, 1e-5)]
)
def test_a_peak_that_is_alike_for_a_while_is_no_end_of_a_range(std_deg_s: float, step_deg_s: float) -> None:
    """Seen: "clipped in 0.13 %" of a gyroscope that reads to 2000 deg/s, at 121. A smooth peak's top step is wide, and noise
    makes three alike. Mutations: any three in a row; steep edges not asked beside noise; no step.
    """
    std, step = np.radians([std_deg_s, step_deg_s])
    for seed in range(60):
        assert clipped_share(_read(seed, 2.1, np.inf, std, step), LEAST_GYRO_RANGE_RAD_S) == 0.0


@pytest.mark.parametrize(("std_deg_s", "step_deg_s"), [(0.0, 1e-5), (0.06, 0.06), (0.2, 0.004), (0.05, 0.25)])
def test_what_a_range_cuts_off_is_seen_however_coarse_and_noisy(std_deg_s: float, step_deg_s: float) -> None:
    """A tenth over the range. Oracle: the readings before they were cut. Mutations: chance not asked; steep edges not asked."""
    std, step = np.radians([std_deg_s, step_deg_s])
    for seed in range(30):
        whole, cut = _read(seed, 2.4, np.inf, std, step), _read(seed, 2.4, 2.18, std, step)
        share = float(np.mean(np.abs(whole[:, 0]) > 2.18))
        assert clipped_share(cut, LEAST_GYRO_RANGE_RAD_S) > 0.4 * share


def test_the_one_that_is_clipped_more_is_named() -> None:
    """Mutations: the first; said of a knock."""
    assert clipped_text((0.01, 0.02)).startswith("the accelerometer is clipped in 2.00% of its readings")
    assert clipped_text((0.02, 0.01)).startswith("the gyroscope is clipped in 2.00%")
    assert clipped_text((4e-4, 0.0)) == ""


@pytest.mark.parametrize(("near_m", "nearest_m"), [(0.5, 0.5), (1.3, 0.0)])
def test_where_a_lidar_is_blind_is_told_by_its_nearest_return(
    noisy: tuple[Recording, Truth], near_m: float, nearest_m: float
) -> None:
    """Nothing nearer than half a metre: it is blind there, for all that is known. Than 1.3 m: nothing was there. Mutations:
    never; always."""
    recording, _ = noisy
    scans = [
        replace(scan, points=scan.points[np.linalg.norm(scan.points["xyz"], axis=1) > max(near_m, 1.2)])
        for scan in recording.scans
    ]
    first = scans[0].points.copy()
    first["xyz"] *= near_m / np.linalg.norm(first["xyz"], axis=1, keepdims=True)
    run = prepare(
        replace(recording, scans=[replace(scans[0], points=first), *scans[1:]]), CalibrateSettings(), list, never_cancel
    )
    assert run.nearest_m == pytest.approx(nearest_m, abs=1e-3)
