"""Proposals say whether the scan that they are of determines a pose by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.odometry.reference_cloud import propose_planes
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording


def test_a_scan_that_sees_one_wall_determines_no_pose(clean: tuple[Recording, Truth]) -> None:
    """All scans see what is ahead alone, or everything. Mutations: always determined; never; of the merged cloud."""
    recording, settings = clean[0], CalibrateSettings()
    assert propose_planes(recording, settings).determined
    ahead = []
    for scan in recording.scans[:8]:
        azimuth = np.arctan2(scan.points["xyz"][:, 1], scan.points["xyz"][:, 0])
        ahead.append(replace(scan, points=scan.points[np.abs(azimuth) < np.radians(20.0)]))
    assert not propose_planes(replace(recording, scans=ahead), settings).determined
