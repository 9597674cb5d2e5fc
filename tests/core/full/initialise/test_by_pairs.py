"""What pairs of scans tell of the times of their points, where no track does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.by_pairs import pairs_start
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import Recording
from tests.core.full.tracks import backwards, straightened


def test_pairs_of_raw_scans_tell_lag_and_rotation(noisy: tuple[Recording, Truth]) -> None:
    """Nothing is refused. Mutation: refused where straightening leaves less than it did."""
    recording, truth = noisy
    starts, agreed = pairs_start(prepare(recording, CalibrateSettings(), ignore_event, never_cancel))
    assert agreed.correlation > 0.9
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ starts[0].R_imu_lidar))) < 1.0


@pytest.mark.parametrize(
    ("seen_at", "code"), [(0.0, "points.straightened"), (1.0, "points.straightened"), (None, "points.times_backwards")]
)
def test_scans_that_turning_taken_out_bends_are_refused(
    noisy: tuple[Recording, Truth], seen_at: float | None, code: str
) -> None:
    """Straightened to where the lidar was at the beginning or at the end of each sweep, and raw ones whose times run backwards.

    Mutations: refused nowhere; as straightened in any case, or as backwards; straightened by twice the turns.
    """
    recording, truth = noisy
    scans = [backwards(s) if seen_at is None else straightened(s, truth, seen_at) for s in recording.scans]
    run = prepare(replace(recording, scans=scans), CalibrateSettings(), ignore_event, never_cancel)
    with pytest.raises(Refused) as refused:
        pairs_start(run)
    assert refused.value.code == code
