"""Which reason is told where the planes failed: theirs, or that nothing moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.tracking_failures import of_rest
from calib_core.full.prepare.prepare import prepare
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording


@pytest.mark.parametrize("code", ["planes.lost", "planes.none", "points.unit"])
@pytest.mark.parametrize("rests", [True, False])
def test_nothing_moved_is_told_of_planes_alone_and_of_an_imu_at_rest(
    noisy: tuple[Recording, Truth], code: str, rests: bool
) -> None:
    """Mutations: of any refusal; of a moving IMU; of one of the two codes."""
    recording, _ = noisy
    imu, rng = recording.imu, np.random.default_rng(1)
    if rests:
        gyro = 1e-3 * rng.normal(size=imu.gyro_rad_s.shape)
        accel = 0.01 * rng.normal(size=imu.accel_m_s2.shape) + [0.0, 0.0, 9.8]
        recording = replace(recording, imu=replace(imu, gyro_rad_s=gyro, accel_m_s2=accel))
    refusal = Refused(code, "the planes failed")
    told = of_rest(prepare(recording, CalibrateSettings(), ignore_event, never_cancel), refusal)
    if rests and code != "points.unit":
        assert (told.code, str(told)[:20]) == ("motion.none", "the rig stood still:")
    else:
        assert told is refusal
