"""What a person gave beforehand, held against the recording."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.full.assess.given import CONTRADICTED, contradictions
from calib_core.full.joint.priors import PriorRow
from calib_core.settings import CalibrateSettings, Prior
from calib_core.simulate import Truth
from calib_core.types import Recording


@pytest.mark.parametrize(
    ("given", "std", "alone", "alone_std", "is_told"),
    [
        (0.31, 0.005, 0.1035, 0.0012, True),
        (0.31, 0.005, 0.335, 0.001, False),  # 4.9 of both together
        (0.31, 0.005, 0.337, 0.001, True),  # 5.3, on the other side
        (0.31, 1e-4, 0.2, 0.05, False),  # what is given is known far better: 2.2
        (0.31, 1e-4, 0.03, 0.05, True),  # and all the same wrong: 5.6
        (0.31, 0.005, 3.0, 10.0, False),  # the recording says nothing
    ],
)
def test_two_gaussians_that_do_not_agree(
    given: float, std: float, alone: float, alone_std: float, is_told: bool
) -> None:
    """Oracle: both made one by hand, and their distance in the root of both variances.

    Mutations: the answer's own sigma; the prior's; the answer's distance for the recording's; the signed distance.
    """
    weight, alone_weight = std**-2, alone_std**-2
    at, stds = np.zeros(7), np.ones(7)
    at[4] = (weight * given + alone_weight * alone) / (weight + alone_weight)
    stds[4] = (weight + alone_weight) ** -0.5
    found = contradictions([PriorRow(4, given, std), PriorRow(0, 0.0, 2.0)], at, stds)
    assert len(found) == is_told
    for each in found:
        assert each.sigmas == pytest.approx(abs(alone - given) / np.hypot(std, alone_std), rel=1e-6)
        assert each.away == pytest.approx(alone - given, rel=1e-6)


def test_a_prior_that_the_recording_contradicts_is_named(noisy: tuple[Recording, Truth]) -> None:
    """And one that it does not is not. Mutations: the covariance in another unit; `calibrated` all the same; standing priors
    judged, too.
    """
    recording, truth = noisy
    x_m = float(truth.p_imu_lidar[0])
    for away_m, status in ((0.0, "calibrated"), (0.2, "weak")):
        settings = CalibrateSettings(
            intrinsics="off",
            priors=(Prior(axis="ty", value=0.0, std=5.0), Prior(axis="tx", value=x_m + away_m, std=0.01)),
        )
        result = calibrate(recording, settings, planes=truth.planes).result
        told = [message.text for message in result.messages if message.code == CONTRADICTED]
        assert (result.status, len(told)) == (status, int(away_m > 0.0))
        for text in told:
            assert text.startswith(
                "what was given for the translation along the IMU's x axis contradicts the recording"
            )
            stated_mm = float(text.split("would have it ")[1].split(" mm")[0])
            assert stated_mm == pytest.approx(1e3 * away_m, rel=0.1)
