"""Readings that the IMU's range cut off are said before anything is made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.events import Event, LogEvent, never_cancel
from calib_core.full.prepare.prepare import prepare
from calib_core.imu.clipping import clipped_text
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording


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
