"""An IMU behind a low-pass filter of its own that is not fast against the motion: whole recordings against their truth."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate, parse_faults
from tests.core.full.answers import errors_of


@pytest.mark.parametrize(
    ("faults", "blocks", "said"),
    [
        ("poles=5ms", {"low_pass_spread", "low_pass_skew"}, "sensor.low_pass"),
        ("low-pass=15", {"low_pass_skew"}, "sensor.low_pass_skew"),
    ],
)
def test_what_a_filter_does_beside_delaying_is_found_and_taken_out(faults: str, blocks: set[str], said: str) -> None:
    """24.3 is passed once in a thousand.

    Mutations: none allowed for; the sign of what is taken out.
    """
    recording, truth = generate("paper-fast", seed=6, duration_s=12.0, faults=parse_faults(faults))
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    assert result.uncertainty is not None
    errors = errors_of(result, truth)
    assert errors @ np.linalg.solve(np.array(result.uncertainty.covariance), errors) < 24.3
    own = {(each.block, each.name): each for each in result.intrinsics if each.block in blocks}
    true = {(each.block, each.name): each.value for each in truth.intrinsics}
    assert {block for block, _ in own} == blocks
    for which, parameter in own.items():
        assert abs(parameter.value - true[which]) < 4.0 * parameter.std
    assert said in {each.code for each in result.messages}
