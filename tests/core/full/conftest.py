"""Short simulated recordings that several tests share: a small lidar, so that a calibration takes seconds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from calib_core.calibrate import Calibration, calibrate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Scenario, Truth, generate
from calib_core.simulate.motions import PAPER_FAST
from calib_core.simulate.sensors import VLP_16, Spinning
from calib_core.types import Recording

_PATTERN = VLP_16.pattern
assert isinstance(_PATTERN, Spinning)
#: A 16-beam lidar with a quarter of the columns: 7000 points a sweep.
SMALL_LIDAR = replace(VLP_16, pattern=replace(_PATTERN, column_period_ns=4 * _PATTERN.column_period_ns))
#: Fast motion in the paper's room after a second of standing still.
SHORT = replace(SCENARIOS["paper-normal"], motion=PAPER_FAST, lidar=SMALL_LIDAR, duration_s=6.0, time_offset_s=-0.0173)


@pytest.fixture(scope="session")
def short() -> Scenario:
    return SHORT


@pytest.fixture(scope="session")
def clean() -> tuple[Recording, Truth]:
    """Six seconds without noise."""
    return generate(SHORT, noise=False)


@pytest.fixture(scope="session")
def noisy() -> tuple[Recording, Truth]:
    """The same with noise and biases."""
    biased = replace(SHORT, gyro_bias_rad_s=(0.004, -0.003, 0.002), accel_bias_m_s2=(0.05, -0.08, 0.06))
    return generate(biased, seed=3)


@pytest.fixture(scope="session")
def calibrated(noisy: tuple[Recording, Truth]) -> Calibration:
    """The noisy recording calibrated with every default."""
    return calibrate(noisy[0], CalibrateSettings())
