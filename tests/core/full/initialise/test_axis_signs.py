"""An IMU whose signs or unit are not what they seem is named, and the calibration refused: never a wrong answer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.full.initialise.axis_signs import axis_complaint, gravity_complaint
from calib_core.full.initialise.start import LinearStart
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Finding, ImuData, Recording

BOTH = (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("gyro", "accel", "code", "says"),
    [
        ((1, 1, -1), BOTH, "imu.axis_signs", "gyroscope's z axis"),
        ((-1, -1, -1), BOTH, "imu.axis_signs", "gyroscope's x, y and z axes"),
        ((-1, -1, 1), BOTH, "imu.axis_signs", "gyroscope's or the accelerometer's x and y axes"),
        (BOTH, (1, -1, 1), "imu.axis_signs", "accelerometer's y axis"),
        (BOTH, (-1, -1, -1), "imu.axis_signs", "accelerometer's x, y and z axes"),
        ((1, 1, -1), (1, 1, -1), "imu.axis_signs", "gyroscope's z axis and of the accelerometer's z axis"),
        ((1, -1, 1), (1, -1, 1), "imu.axis_signs", "gyroscope's z axis and of the accelerometer's z axis"),
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


@pytest.mark.parametrize(
    ("swing_m_s2", "turns_rad_s", "unit", "says"),
    [
        (50.0, 0.0, 1.0, ""),
        (5.0, 6.0, 1.0, ""),
        (50.0, 0.0, 9.80665, "m_s2"),
        (5.0, 0.0, 9.80665, "m_s2"),
        (5.0, 0.0, 1 / 9.80665, "unit g"),
    ],
)
def test_gravity_is_told_of_a_rig_that_is_shaken_and_of_one_that_turns(
    swing_m_s2: float, turns_rad_s: float, unit: float, says: str
) -> None:
    """Shaken to and fro five times a second by 50 m/s2, or turned over once a second. Seen: "3.35 times gravity", refused.

    Mutations: reading by reading alone; on average alone.
    """
    t_s = np.arange(0.0, 12.0, 0.005)
    turned = turns_rad_s * t_s
    gravity = 9.81 * np.stack([np.sin(turned), np.zeros_like(t_s), np.cos(turned)], axis=1)
    accel = gravity + swing_m_s2 * np.sin(2 * np.pi * 5.0 * t_s)[:, None] * np.array([1.0, 0.0, 0.0])
    imu = ImuData((t_s * 1e9).astype(np.int64), np.zeros_like(accel), accel * unit)
    complaint = gravity_complaint(t_s, imu, 9.81)
    assert bool(complaint) == bool(says)
    assert says in complaint


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


@pytest.mark.parametrize("rms", [np.nan, np.inf])
def test_of_what_came_to_no_number_nothing_is_said(rms: float) -> None:
    """Seen: flipped, "its accelerations and turns fit nan times as well". Mutation: no number passes for a large one."""
    unused: Any = None
    zero = np.zeros(3)
    assert axis_complaint(unused, unused, unused, unused, LinearStart(zero, zero, zero, rms), 9.8) == ""


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
