"""Planes in the map, which is the first scan's frame, where the lidar is followed from another scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.full.planes.propose import find_reference
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Plane, Recording, Scan

#: So many sweeps see what is ahead, up to so far aside: who stood around the rig has gone then, and it is on its way.
BLIND, ASIDE_DEG = 16, 20.0
SETTINGS = CalibrateSettings(points_per_plane_per_scan=300)


def _ahead(scan: Scan) -> Scan:
    azimuth = np.arctan2(scan.points["xyz"][:, 1], scan.points["xyz"][:, 0])
    return replace(scan, points=scan.points[np.abs(azimuth) < np.radians(ASIDE_DEG)])


@pytest.fixture(scope="module")
def blind(noisy: tuple[Recording, Truth]) -> tuple[Recording, Truth]:
    """The recording, of whose first sweeps a wall ahead is left; what it is followed from is taken on the move."""
    recording, truth = noisy
    scans = [_ahead(scan) if k < BLIND else scan for k, scan in enumerate(recording.scans)]
    return replace(recording, scans=scans), truth


def _off(planes: list[Plane], truth: Truth) -> list[tuple[float, float]]:
    """Of each plane by how much it is turned [rad] and away [m] from the true one that is nearest."""
    off = []
    for plane in planes:
        turned = [float(np.linalg.norm(np.cross(plane.normal, q.normal))) for q in truth.planes]
        sides = [1.0 if plane.normal @ q.normal > 0.0 else -1.0 for q in truth.planes]
        away = [abs(plane.offset_m - s * q.offset_m) for q, s in zip(truth.planes, sides, strict=True)]
        best = int(np.argmin(np.add(turned, away)))
        off.append((turned[best], away[best]))
    return off


def test_planes_are_told_and_taken_in_the_first_scans_frame(blind: tuple[Recording, Truth]) -> None:
    """Oracle: the simulator's planes, in the frame of its lidar's first place.

    Mutations: the map of the result that of the scan the lidar is followed from; planes of the map taken to be in that one's
    frame (refused then: none is there); moved the other way.
    """
    recording, truth = blind
    reference, _ = find_reference(recording.scans, SETTINGS)
    assert reference >= BLIND
    found = calibrate(recording, SETTINGS).result
    planes = [Plane(p.name, np.array(p.normal), p.offset_m) for p in found.quality.planes]
    assert len(planes) >= 3
    for turned, away_m in _off(planes, truth):
        assert turned < 0.004
        assert away_m < 0.01
    given = [replace(plane, suggested=False) for plane in truth.planes]
    chosen = calibrate(recording, SETTINGS, planes=given).result
    assert chosen.status in {"calibrated", "weak"}
    assert any(said.code == "planes.frame" for said in chosen.messages)
    assert {plane.name for plane in chosen.quality.planes} == {plane.name for plane in truth.planes}
    assert np.linalg.norm(np.array(chosen.T_imu_lidar.matrix)[:3, 3] - truth.p_imu_lidar) < 0.03
