"""An axis that is stuck, beside sensors that have reasons to read one number twice."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.readers.imu.messages import RawImu
from calib_core.readers.imu.readings import clean_imu
from calib_core.readers.imu.stuck import stuck_axis
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray

T = np.arange(1000) * 0.01
#: Of a quick sensor.
STEP_S = 0.002


def _said(gyro: FloatArray, accel: FloatArray, *, step_s: float = 0.01) -> str:
    stamps_ns = np.rint(np.arange(len(T)) * step_s * 1e9).astype(np.int64)
    found = stuck_axis(stamps_ns, gyro, accel, "/imu", begin_ns=0)
    return "" if found is None else found.text


def _noisy(seed: int, size: float) -> FloatArray:
    return np.asarray(size * np.random.default_rng(seed).standard_normal((len(T), 3)))


def test_the_axis_is_named_and_since_when() -> None:
    """Mutations: another axis; the longest run of readings that do change; the sensor's other axes not asked."""
    gyro, accel = _noisy(1, 1e-3), _noisy(2, 1e-2)
    assert _said(gyro, accel) == ""
    accel[300:, 1] = accel[300, 1]
    assert _said(gyro, accel).startswith(
        f"The accelerometer's y axis on /imu reads {accel[300, 1]:.4g} m/s² without any change for 7.0 s, from 3.0 s"
    )
    gyro[:, 2] = 0.0
    assert _said(gyro, accel).startswith(
        "The gyroscope's z axis on /imu reads 0 rad/s without any change for 10.0 s, from 0.0 s on"
    )


def test_when_is_told_from_the_recordings_start() -> None:
    """The recording began 100 s before what is read of it, and the IMU's clock is 7 s behind the recorder's. Oracle: the sums.

    Mutations: from the first reading; the recorder's start on the clock of the stamps as it is.
    """
    gyro, accel = _noisy(1, 1e-3), _noisy(2, 1e-2)
    gyro[300:, 2] = gyro[300, 2]
    accel[:, 2] += 9.81
    stamps_ns = np.rint(1e9 * (T + 500.0)).astype(np.int64)
    raw = RawImu(stamps_ns, stamps_ns + 7_000_000_000, gyro, accel, "imu", 0)
    found = clean_imu(raw, ReadSettings(), "/imu", start_ns=407_000_000_000).findings
    (text,) = (finding.text for finding in found if finding.code == "imu.stuck")
    assert "for 7.0 s, from 103.0 s on" in text


def test_readings_that_are_held_coarse_or_stuck_for_a_moment_are_none() -> None:
    """Mutations: half a second is enough; asked of no other axis; of its own readings otherwise nothing."""
    gyro, accel = _noisy(3, 1e-3), _noisy(4, 1e-2)
    moment = gyro.copy()
    moment[200:290, 0] = moment[200, 0]
    assert _said(moment, accel) == ""
    held = gyro.copy()
    held[200:500] = held[200]
    assert _said(held, accel) == ""
    coarse = accel.copy()
    coarse[:, 2] = np.rint(np.sin(0.3 * T) * 4.0) * 0.05  # turns slowly past a step every half second
    assert _said(gyro, coarse) == ""


def _moving(seed: int, size: float, noise: float, *, hz: float = 0.4) -> FloatArray:
    """As a hand turns it, about all axes."""
    phases = np.array([0.0, 1.0, 2.0])
    return np.asarray(size * np.sin(2.0 * np.pi * hz * T[:, None] + phases) + _noisy(seed, noise))


@pytest.mark.parametrize("axes", [[0, 2], [0, 1, 2]])
@pytest.mark.parametrize("sensor", ["gyroscope", "accelerometer"])
@pytest.mark.parametrize("since", [0, 400])
def test_axes_that_are_stuck_together_are_told_by_the_other_sensor(sensor: str, axes: list[int], since: int) -> None:
    """Two or three of one sensor while the rig moves. Seen: nothing said, as each was compared with its neighbours alone.

    Mutations: the same sensor's axes asked alone; one axis named.
    """
    gyro, accel = _moving(5, 0.5, 1e-3), _moving(6, 2.0, 1e-2)
    assert _said(gyro, accel) == ""
    stuck = gyro if sensor == "gyroscope" else accel
    stuck[since:, axes] = stuck[since, axes]
    said = _said(gyro, accel)
    assert said.startswith(f"The {sensor}'s {'x and z' if len(axes) == 2 else 'x, y and z'} axes on /imu read ")
    assert f"without any change for {10.0 - since / 100:.1f} s, from {since / 100:.1f} s on" in said
    assert said.endswith("they are stuck, or not measured.")


@pytest.mark.parametrize("filter_hz", [0.0, 10.0])
def test_a_sensor_that_is_held_at_rest_is_not_stuck(filter_hz: float) -> None:
    """Beside white noise, and noise behind a low-pass filter of 500 readings a second. Mutations: any reading that changes
    tells of motion; readings compared as they are instead of means.
    """
    gyro, accel = _moving(7, 0.5, 1e-3), _noisy(8, 1e-2)
    gyro[300:] = gyro[300]
    kept = np.exp(-2.0 * np.pi * filter_hz * STEP_S) if filter_hz else 0.0
    for k in range(1, len(T)):
        accel[k] += kept * (accel[k - 1] - accel[k])
    assert _said(gyro, accel, step_s=STEP_S) == ""


def test_a_coarse_sensor_that_moves_is_not_stuck() -> None:
    """Its steps hide a slow turn, of whatever the other sensor tells. Mutation: what it reads otherwise not asked of several."""
    gyro, accel = np.rint(_moving(9, 0.3, 0.0, hz=0.1) / 0.25) * 0.25, _moving(10, 2.0, 1e-2)
    assert _said(np.asarray(gyro), accel) == ""
