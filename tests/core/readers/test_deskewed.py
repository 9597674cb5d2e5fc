"""Clouds with the motion taken out are suspected, raw ones of the same drive are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.readers.clouds.deskewed import deskew_suspicion
from calib_core.types import POINT_DTYPE, ImuData, Scan
from tests.core.readers import build


def drive(*, deskewed: bool, turning: bool) -> tuple[list[Scan], ImuData]:
    """Forty scans, the last fifteen moving at 1 m/s and, if turning, 40 deg/s; deskewed by the true motion."""
    stamps = build.EPOCH_NS + np.arange(400, dtype=np.int64) * 10_000_000
    gyro = np.random.default_rng(0).normal(0, 1e-3, (400, 3))
    rate = np.deg2rad(40.0) if turning else 0.0
    gyro[250:, 0] += rate
    imu = ImuData(stamps, gyro, np.tile([0.0, 0, 9.81], (400, 1)))
    scans = []
    for k in range(40):
        sweep = build.sweep(n_columns=300, n_rings=4, seed=k)
        xyz, time_s = sweep["xyz"], sweep["time_s"]
        if deskewed and k >= 25:
            xyz = Rotation.from_rotvec(np.outer(time_s, [rate, 0, 0])).apply(xyz) + np.outer(time_s, [1.0, 0, 0])
        points = np.zeros(time_s.size, POINT_DTYPE)
        points["xyz"], points["ring"] = xyz, sweep["ring"]
        points["offset_ns"] = np.rint(time_s * 1e9)
        scans.append(Scan(k, build.EPOCH_NS + k * 100_000_000, points))
    return scans, imu


@pytest.mark.parametrize(
    ("deskewed", "turning", "suspected"), [(True, True, True), (False, True, False), (True, False, False)]
)
def test_only_deskewed_scans_are_suspected(deskewed: bool, turning: bool, suspected: bool) -> None:
    """Mutation: take resting scans for moving ones; raise _SUSPICIOUS_RAD to 5 deg."""
    finding = deskew_suspicion(*drive(deskewed=deskewed, turning=turning), 0, "/p")
    assert (finding is not None) == suspected
    if finding is not None:
        assert finding.code == "points.deskewed"
        assert finding.confidence == 0.8


def aiming_apart(scan: Scan) -> Scan:
    """Lasers 2 deg apart in azimuth within a column, as those of an Ouster, and no field that tells them apart."""
    points = scan.points.copy()
    turned = np.column_stack([np.zeros((points.size, 2)), np.deg2rad(2.0) * (points["ring"] - 1.5)])
    points["xyz"] = Rotation.from_rotvec(turned).apply(points["xyz"])
    points["ring"] = 0
    return replace(scan, points=points)


def test_lasers_that_aim_past_one_another_are_no_suspicion() -> None:
    """Their misfit is the same at rest; where nothing rests it is nobody's. Fails when all points are one laser's."""
    scans, imu = drive(deskewed=False, turning=True)
    apart = [aiming_apart(scan) for scan in scans]
    assert deskew_suspicion(apart, imu, 0, "/p") is None
    assert deskew_suspicion(apart[25:], imu, 0, "/p") is None


def test_lasers_told_apart_need_no_rest() -> None:
    """Fails when only a standstill makes a suspicion: of what never stops the azimuths tell as much."""
    scans, imu = drive(deskewed=True, turning=True)
    finding = deskew_suspicion(scans[25:], imu, 0, "/p")
    assert finding is not None
    assert finding.confidence == 0.5
