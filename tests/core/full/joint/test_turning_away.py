"""Carrying the estimate where the planes come and go, on a recording that turns away from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Scenario, generate


@pytest.fixture(scope="module")
def turning_away(short: Scenario) -> Scenario:
    """A free-standing corner, seen whole at first, then by two planes, one, none, and again; a third of the columns."""
    partial = SCENARIOS["partial-views"]
    return replace(partial, lidar=replace(partial.lidar, pattern=short.lidar.pattern), duration_s=22.0)


def test_views_of_one_plane_and_of_none_are_bridged(turning_away: Scenario) -> None:
    """Fails when lost planes are not known again by their normals (`_know_again` gives None), or the gates stay narrow.

    The planes are out of sight for seconds more than once. Without what comes after, 70 of the 220 scans are left.
    """
    recording, truth = generate(turning_away, seed=2)
    result = calibrate(recording, CalibrateSettings()).result
    assert result.status == "calibrated"
    assert result.quality.scans_used > 150
    assert result.T_imu_lidar is not None
    assert result.uncertainty is not None
    T = np.array(result.T_imu_lidar.matrix)
    assert result.time_offset_s is not None
    error = np.concatenate(
        [
            log(T[:3, :3].T @ truth.R_imu_lidar),
            truth.p_imu_lidar - T[:3, 3],
            [truth.time_offset_s - result.time_offset_s],
        ]
    )
    sigma = np.sqrt(np.diag(np.array(result.uncertainty.covariance)))
    assert np.abs(error / sigma).max() < 5.0
    assert np.degrees(np.linalg.norm(error[:3])) < 0.3
    assert np.linalg.norm(error[3:6]) < 0.01
