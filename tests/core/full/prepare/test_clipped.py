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


@pytest.mark.parametrize("range_rad_s", [np.inf, 2.18, 1.6])
def test_a_clipped_gyroscope_is_named(noisy: tuple[Recording, Truth], range_rad_s: float) -> None:
    """Seen: a tenth of all readings cut off, and scale, axes and walls blamed. Mutations: never said; said of whole ones; said of
    ranges in common use alone.
    """
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


@pytest.mark.parametrize(("std_deg_s", "step_deg_s"), [(0.06, 1e-5), (0.06, 0.015), (0.2, 0.004)])
@pytest.mark.parametrize("range_rad_s", [0.4, 1.3, 1.75, 2.18])
@pytest.mark.parametrize("over", [1.1, 1.5])
def test_what_a_range_cuts_off_is_all_told_however_narrow_it_is(
    std_deg_s: float, step_deg_s: float, range_rad_s: float, over: float
) -> None:
    """Of 23 to 125 deg/s, and turned faster: a quarter and a half of all readings, at both ends. Oracle: the readings before they
    were cut. Mutations: ranges in common use alone; one end of the two; the noise of what was cut off, which is none.
    """
    std, step = np.radians([std_deg_s, step_deg_s])
    for seed in range(20):
        whole, cut = (_read(seed, over * range_rad_s, end, std, step)[:, :1] for end in (np.inf, range_rad_s))
        share = float(np.mean(np.abs(whole) > range_rad_s))
        assert clipped_share(cut, LEAST_GYRO_RANGE_RAD_S) == pytest.approx(share, rel=0.1)


def _alike(of: str, rng: np.random.Generator, std_rad_s: float) -> FloatArray:
    """(4000,) of a gyroscope at 200 Hz that no range cuts off, but that is alike at its extremes for a while."""
    t, noise = np.arange(4000) / 200.0, std_rad_s * rng.normal(size=4000)
    swings = _read(int(rng.integers(1000)), 0.6, np.inf, 0.0, 1e-9)[:, 0]
    steady = np.select([t % 8.0 < 3.0, t % 8.0 < 5.0], [0.8, -0.8], 0.0)
    if of == "a robot":
        lag = np.exp(-np.arange(400) / (200.0 * rng.uniform(0.1, 0.5)))
        steady = np.convolve(steady, lag / lag.sum())[:4000]
    shaken = np.radians(3.0) * rng.normal(size=4000)
    if of == "repeats":
        taken = np.repeat(np.arange(4000), rng.integers(1, 7, 4000))[:4000]
        return np.asarray((swings + noise + shaken)[taken])
    if of == "a calm peak":
        calm = t < 8.0
        return np.where(calm, 0.6, 0.3) * np.sin(2.0 * np.pi * rng.uniform(0.15, 0.4) * t) + noise + ~calm * shaken
    if of == "a slow peak":
        fast = 0.57 * np.sin(2.0 * np.pi * rng.uniform(1.5, 3.0) * t)
        return np.asarray(np.where(t < 3.0, 0.6 * np.sin(2.0 * np.pi * 0.25 * t), fast) + noise)
    if of in ("a stop", "a start"):
        turns = np.where(t < 8.0, 0.8 * (t > 2.0), shaken) + noise
        return np.asarray(turns if of == "a stop" else turns[::-1])
    return np.asarray({"swings": swings, "rest": 0.0 * t}.get(of, steady) + noise)


def test_peaks_that_follow_one_another_within_readings_are_told() -> None:
    """A shake of 2.5 Hz at three times the range, 1.3 rad/s: of eighty readings in a round sixty-three are cut off. Oracle: the
    readings before they were cut. Mutation: the noise beside a run of readings that are cut off, too.
    """
    rng, t = np.random.default_rng(3), np.arange(4000) / 200.0
    whole = 3.9 * np.sin(2.0 * np.pi * 2.503 * t) + 1e-3 * rng.normal(size=4000)
    share = float(np.mean(np.abs(whole) > 1.3))
    cut = np.clip(whole, -1.3, 1.3)[:, None]
    assert clipped_share(cut, LEAST_GYRO_RANGE_RAD_S) == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize(
    ("std_deg_s", "step_deg_s"), [(0.0, 1e-5), (0.0, 0.06), (0.06, 0.06), (0.06, 1e-5), (0.05, 0.25), (0.18, 0.6)]
)
@pytest.mark.parametrize(
    "of", ["swings", "a platform", "a robot", "repeats", "a calm peak", "a slow peak", "a stop", "a start", "rest"]
)
def test_nothing_else_that_is_alike_is_an_end_of_a_narrow_range(of: str, std_deg_s: float, step_deg_s: float) -> None:
    """Swings; a platform that turns at two steady rates, with edges of one reading; a robot that comes to its rate as behind a
    lag; a driver that reads one to six times what its sensor reads once; a slow swing beside shaking, or beside fast
    ones; a steady turn that is shaken after it, or before it, alone; rest.

    Mutations: steep edges are enough, as of ranges in common use; the noise of all readings, not of those beside the run; the
    noise on one side of it alone; repeated readings not asked; steps of more than a hundredth of the extreme not known.
    """
    std, step = np.radians([std_deg_s, step_deg_s])
    for seed in range(60):
        read = step * np.round(_alike(of, np.random.default_rng(seed), std) / step)
        assert clipped_share(read[:, None], LEAST_GYRO_RANGE_RAD_S) == 0.0


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
