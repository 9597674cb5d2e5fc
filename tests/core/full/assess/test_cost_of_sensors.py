"""What it costs not to know the sensors exactly: one sentence, held against a solve that takes them for exact."""

from __future__ import annotations

import re

import numpy as np

from calib_core.calibrate import calibrate
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate
from tests.core.full.conftest import SHORT

CODE = "sensor.priors"


def told(result: CalibrationResult) -> str:
    """The sentence; empty where there is none."""
    return " ".join(message.text for message in result.messages if message.code == CODE)


def groups(result: CalibrationResult) -> np.ndarray:
    """Standard deviation of rotation, translation and time offset (3,)."""
    assert result.uncertainty is not None
    variance = np.diag(np.array(result.uncertainty.covariance))
    return np.sqrt([variance[:3].sum(), variance[3:6].sum(), variance[6]])


def test_what_unknown_sensors_cost_is_said_in_one_sentence() -> None:
    """Oracle: the same recording with sensors taken for exact. Mutations: the planes' columns taken out for the sensors'; no word
    of who is not named; said where nothing was unknown.
    """
    recording = generate(SHORT, seed=4)[0]
    auto = calibrate(recording, CalibrateSettings(crispness=False)).result
    exact = calibrate(recording, CalibrateSettings(intrinsics="off", crispness=False)).result
    assert told(exact) == ""
    text = told(auto)
    assert text.startswith("the models of IMU and lidar are not known")
    ratio = groups(auto) / groups(exact)
    assert ratio[0] > 1.5
    said = {name: float(times) for times, name in re.findall(r"([\d.]+) times in (rotation|translation)", text)}
    assert abs(said["rotation"] / ratio[0] - 1.0) < 0.1
    named = calibrate(recording, CalibrateSettings(imu_noise="xsens-mti-3", lidar="vlp-16", crispness=False)).result
    assert told(named).startswith("the sensors may be off by as much as their data sheets allow: ")
    assert "to narrow" not in told(named)
