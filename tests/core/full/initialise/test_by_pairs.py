"""What pairs of scans tell of the times of their points, where no track does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.by_pairs import _by_pairs as by_pairs
from calib_core.full.initialise.by_pairs import pairs_start
from calib_core.full.odometry.scan_pairs import PairTurns, pair_turns
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
    # Of a rotor whose scans are cut at packets its stamps tell it first.
    settings = CalibrateSettings(lidar_sampling="as-stamped")
    run = prepare(replace(recording, scans=scans), settings, ignore_event, never_cancel)
    with pytest.raises(Refused) as refused:
        pairs_start(run)
    assert refused.value.code == code


def test_a_few_pairs_that_went_wrong_do_not_hide_what_all_others_say(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen in a room behind sixteen lasers: likeness 0.89 of pairs that a rotation left two hundredths of; refused after minutes.

    Mutation: told by likeness alone.
    """
    recording, _ = noisy
    drawn = np.random.default_rng(5)

    def with_wrong_ones(*args: Any, **kwargs: Any) -> PairTurns:
        pairs = pair_turns(*args, **kwargs)
        wrong = drawn.random(len(pairs.first)) < 0.25
        return replace(
            pairs, rotvec_rad=np.where(wrong[:, None], drawn.normal(0.0, 0.1, (len(wrong), 3)), pairs.rotvec_rad)
        )

    monkeypatch.setattr("calib_core.full.initialise.by_pairs.pair_turns", with_wrong_ones)
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    starts, agreed = pairs_start(run)
    assert starts[0].correlation < 0.9
    assert starts[0].residual < 0.2
    assert agreed.correlation > 0.95
    elsewhere = replace(recording.imu, gyro_rad_s=recording.imu.gyro_rad_s[::-1].copy())
    run = prepare(replace(recording, imu=elsewhere), CalibrateSettings(), ignore_event, never_cancel)
    assert pairs_start(run)[1].correlation < 0.9


def test_sweeps_are_straightened_by_what_fits_though_most_pairs_went_wrong(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen in a furnished room behind a rosette that was turned fast: likeness 0.31 of pairs under whose best rotation sweeps are
    straight, and then 0.997; refused before.

    Mutation: not straightened where likeness is below 0.6.
    """
    recording, truth = noisy
    drawn = np.random.default_rng(7)

    def bent(*args: Any, turning: Any = None, **kwargs: Any) -> PairTurns:
        pairs = pair_turns(*args, turning=turning, **kwargs)
        if turning is not None:
            return pairs
        wrong = drawn.random(len(pairs.first)) < 0.5
        return replace(
            pairs, rotvec_rad=np.where(wrong[:, None], drawn.normal(0.0, 0.3, (len(wrong), 3)), pairs.rotvec_rad)
        )

    monkeypatch.setattr("calib_core.full.initialise.by_pairs.pair_turns", bent)
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    raw, _ = by_pairs(run, run.recording.scans, None)
    assert raw[0].correlation < 0.6
    starts, agreed = pairs_start(run)
    assert agreed.correlation > 0.95
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ starts[0].R_imu_lidar))) < 1.0
