"""A flash lidar, whose points are all of one instant: its sweeps tell no rates, and last no time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.events import IterationEvent
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording, Scan
from tests.core.full.answers import errors_of
from tests.core.full.tracks import straightened


def _at_once(scan: Scan, truth: Truth) -> Scan:
    """The surroundings as they are seen from where the lidar was at the sweep's beginning, all points at that instant."""
    points = straightened(scan, truth).points.copy()
    points["offset_ns"] = 0
    return replace(scan, points=points)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_it_is_calibrated(noisy: tuple[Recording, Truth]) -> None:
    """Seen refused: "turns against the IMU", then "moved the time offset more than a sweep of 0.00 s". Mutations: turns within
    sweeps asked; an offset's reach of no time; sweeps told at one instant thrice, between which the page found no number.
    """
    recording, truth = noisy
    flash = replace(recording, scans=[_at_once(scan, truth) for scan in recording.scans])
    steps: list[IterationEvent] = []
    result = calibrate(
        flash,
        CalibrateSettings(crispness=False),
        on_event=lambda e: steps.append(e) if isinstance(e, IterationEvent) else None,
    ).result
    assert result.status == "calibrated"
    assert result.uncertainty is not None
    covariance, error = np.array(result.uncertainty.covariance), errors_of(result, truth)
    assert error @ np.linalg.solve(covariance, error) < 24.3  # 99.9 % of chi-square with 7 degrees of freedom
    assert steps[-1].sweeps
    assert all((np.diff(sweep.offset_s) > 0.0).all() for sweep in steps[-1].sweeps)
