"""An IMU whose signs or unit are not what they seem is named, and the calibration refused: never a wrong answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Finding, Recording

BOTH = (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("gyro", "accel", "code", "says"),
    [
        ((1, 1, -1), BOTH, "imu.axis_signs", "gyroscope's z axis"),
        ((-1, -1, -1), BOTH, "imu.axis_signs", "gyroscope's x, y and z axes"),
        ((-1, -1, 1), BOTH, "imu.axis_signs", "gyroscope's or the accelerometer's x and y axes"),
        (BOTH, (1, -1, 1), "imu.axis_signs", "accelerometer's y axis"),
        (BOTH, (-1, -1, -1), "imu.axis_signs", "accelerometer's x, y and z axes"),
        ((1, 1, -1), (1, 1, -1), "imu.axis_signs", "gyroscope's z axis, and of the accelerometer's like one,"),
        ((1, -1, 1), (1, -1, 1), "imu.axis_signs", "gyroscope's z axis, and of the accelerometer's like one,"),
        ((180 / np.pi,) * 3, BOTH, "imu.gyroscope_unit", "pass --gyroscope-unit deg_s"),
        ((np.pi / 180,) * 3, BOTH, "imu.gyroscope_unit", "pass --gyroscope-unit rad_s"),
        (BOTH, (9.80665,) * 3, "imu.accelerometer_unit", "pass --accelerometer-unit m_s2"),
        (BOTH, (1 / 9.80665,) * 3, "imu.accelerometer_unit", "pass --accelerometer-unit g"),
    ],
)
def test_a_misread_imu_is_named(
    gyro: tuple[float, ...],
    accel: tuple[float, ...],
    code: str,
    says: str,
    noisy: tuple[Recording, Truth],
) -> None:
    """Mutation: take the lag of the rotation for the reflection's; name patterns without `np.prod(signs) < 0`;

    correlate rates without bringing them to one size first (57 times slower is below the floor of a variance); one sensor's
    axes only.
    """
    recording, _ = noisy
    imu = replace(
        recording.imu,
        gyro_rad_s=recording.imu.gyro_rad_s * np.array(gyro),
        accel_m_s2=recording.imu.accel_m_s2 * np.array(accel),
    )
    result = calibrate(replace(recording, imu=imu), CalibrateSettings()).result
    assert result.status == "refused"
    assert [(m.code, says in m.text) for m in result.messages if m.level == "error"] == [(code, True)]


def test_a_mirrored_cloud_is_thought_of(noisy: tuple[Recording, Truth]) -> None:
    """A driver that counts azimuths the wrong way round. Mutation: the IMU's driver alone is told."""
    recording, _ = noisy
    scans = []
    for scan in recording.scans:
        points = scan.points.copy()
        points["xyz"][:, 1] *= -1.0
        scans.append(replace(scan, points=points))
    result = calibrate(replace(recording, scans=scans), CalibrateSettings()).result
    told = [m.text for m in result.messages if m.level == "error"]
    assert len(told) == 1
    assert "accelerometer's x, y and z axes" in told[0]
    assert "or the lidar's if its clouds are mirrored" in told[0]


def test_less_has_to_be_explained_where_gravity_is_turned_the_other_way_round(noisy: tuple[Recording, Truth]) -> None:
    """An accelerometer with a flipped axis that is shaken, so that the right signs leave much, too.

    Mutations: as much to be explained in any case; as little.
    """
    recording, _ = noisy
    rough = 4.5 * np.random.default_rng(1).standard_normal(recording.imu.accel_m_s2.shape)
    accel = recording.imu.accel_m_s2 * [1.0, -1.0, 1.0] + rough
    recording = replace(recording, imu=replace(recording.imu, accel_m_s2=accel))
    doubt = Finding(code="imu.axis_signs", level="warning", text="")
    said = [
        [(m.code, "accelerometer's y axis" in m.text) for m in calibrate(each, CalibrateSettings()).result.messages]
        for each in (recording, replace(recording, findings=(doubt,)))
    ]
    assert ("imu.axis_signs", True) not in said[0]
    assert ("imu.axis_signs", True) in said[1]
