"""Clouds that come a few times a second, as a recorder throttles them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.errors import Refused
from calib_core.full.initialise import by_pairs
from calib_core.full.initialise.by_pairs import _require_measured_points
from calib_core.full.initialise.start import RotationStart
from calib_core.settings import CalibrateSettings
from calib_core.simulate import generate
from tests.core.full.answers import errors_of


@pytest.mark.parametrize(
    ("scenario", "seed", "every", "duration_s"), [("paper-fast", 3, 5, 16.0), ("handheld", 5, 7, 20.0)]
)
def test_clouds_that_come_twice_a_second_are_enough(scenario: str, seed: int, every: int, duration_s: float) -> None:
    """Each sweep as long as ever, and nothing in between. 24.3 is passed once in a thousand.

    Mutation: scans so far apart say nothing (the arithmetic broke down).
    """
    recording, truth = generate(scenario, seed=seed, duration_s=duration_s)
    throttled = replace(recording, scans=recording.scans[::every])
    result = calibrate(throttled, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    assert result.uncertainty is not None
    errors = errors_of(result, truth)
    assert errors @ np.linalg.solve(np.array(result.uncertainty.covariance), errors) < 24.3


def test_sweeps_of_which_turns_tell_nothing_are_not_called_straightened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no rotation is found once they are straightened, nothing is told of them. Mutation: none is the worst of all."""
    raw = RotationStart(0.0, np.eye(3), np.zeros(3), 0.08, 0.99, None)
    run: Any = None
    _require_measured_points(run, raw, [])
    bent = replace(raw, residual=1.0)
    told: Any = SimpleNamespace(recording=SimpleNamespace(scans=()))
    monkeypatch.setattr(by_pairs, "_by_pairs", lambda *_: ([], None))
    monkeypatch.setattr(by_pairs, "GyroTurning", SimpleNamespace(of=lambda *_: None))
    with pytest.raises(Refused, match="motion was taken out of the clouds before they were recorded"):
        _require_measured_points(told, raw, [bent])
