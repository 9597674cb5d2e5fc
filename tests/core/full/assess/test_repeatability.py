"""The parts of a recording against each other: agreement where only noise is at work, and the errors of real sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calib_core.full.assess.repeatability import Repeatability, determined_part

from calib_core.calibrate import Calibration, calibrate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording


def _messages(calibration: Calibration) -> list[str]:
    return [message.code for message in calibration.result.messages]


def test_a_recording_with_noise_alone_agrees_with_itself(calibrated: Calibration) -> None:
    """Fails when the pulls are compared without letting the shared unknowns follow: planes and gravity pull each block."""
    assert "solve.disagreement" not in _messages(calibrated)


def test_a_gyroscope_that_reads_too_much_widens_every_error_bar(
    noisy: tuple[Recording, Truth], calibrated: Calibration
) -> None:
    """Fails when `inflation` is left at 1.

    One per cent of scale is no state of the solve: nothing but the parts' disagreement can tell of it.
    """
    recording, _ = noisy
    scaled = replace(recording, imu=replace(recording.imu, gyro_rad_s=recording.imu.gyro_rad_s * 1.01))
    found = calibrate(scaled, CalibrateSettings())
    assert "solve.disagreement" in _messages(found)
    assert found.result.uncertainty is not None
    assert calibrated.result.uncertainty is not None
    now, before = (np.array(c.result.uncertainty.covariance) for c in (found, calibrated) if c.result.uncertainty)
    assert (np.sqrt(np.diag(now)) > 1.5 * np.sqrt(np.diag(before))).all()


@pytest.mark.parametrize(("ratio", "inflation"), [(0.7, 1.0), (1.9, 1.0), (4.0, 2.0)])
def test_nothing_is_inflated_below_the_limit(ratio: float, inflation: float) -> None:
    """Fails when the ratio is taken below its limit too, or as a factor on standard deviations."""
    assert Repeatability(ratio, 2.0).inflation == inflation


def test_what_is_open_is_no_disagreement() -> None:
    """Fails when the stated covariance is taken as it is: along an open lever arm it is a prior's, ten metres wide."""
    std = np.array([1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-5])
    way = np.array([0.0, 0.0, 0.0, 0.0, 0.6, 0.8, 0.0])
    known, rank = determined_part(np.diag(std**2))
    assert rank == 7
    np.testing.assert_allclose(known, np.diag(std**2), rtol=1e-6, atol=1e-18)
    known, rank = determined_part(np.diag(std**2) + 100.0 * np.outer(way, way))
    assert rank == 6
    across = np.array([0.0, 0.0, 0.0, 0.0, 0.8, -0.6, 0.0])
    assert way @ known @ way == pytest.approx(0.0, abs=1e-9)
    assert across @ known @ across == pytest.approx(1e-6, rel=1e-3)
    assert known[0, 0] == pytest.approx(1e-8, rel=1e-3)


def test_an_accelerometer_that_cannot_be_is_refused_with_its_bias(noisy: tuple[Recording, Truth]) -> None:
    """Fails when the biases of the best answer are not looked at."""
    recording, _ = noisy
    force = recording.imu.accel_m_s2 + np.array([0.0, 3.0, 0.0])
    result = calibrate(replace(recording, imu=replace(recording.imu, accel_m_s2=force)), CalibrateSettings()).result
    assert result.status == "refused"
    assert "IMU that is off by" in result.messages[-1].text


def test_what_the_data_leave_open_does_not_come_back_by_round_off() -> None:
    """Fails when the open direction is projected out in all seven: an inverse of what is left lets metres back in."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        open_way = np.zeros(7)
        open_way[3:6] = rng.standard_normal(3)
        open_way /= np.linalg.norm(open_way)
        stds = np.array([1e-4, 1e-4, 1e-4, 5e-4, 5e-4, 5e-4, 1.6e-5])
        mix = np.linalg.qr(rng.standard_normal((7, 7)))[0]
        small = np.diag(stds) @ mix @ np.diag(rng.uniform(0.3, 3.0, 7)) @ mix.T @ np.diag(stds)
        known, rank = determined_part(small + 100.0 * np.outer(open_way, open_way))
        assert rank == 6
        assert open_way @ known @ open_way < 1e-6
        assert np.trace(known[3:6, 3:6]) < 1e-5
