"""The stress set of bench/rigs.py at the size that a suite can carry: one cluttered room, three choices of planes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.rigs import LIDARS, PLACES, cluttered, draw, true_planes
from bench.runs import compare
from calib_core import api
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth, generate, sensors
from calib_core.simulate.patterns import Spinning
from calib_core.types import Recording

#: Worst of seven errors in their sigmas: beyond 5 once in a million.
WORST_SIGMAS = 5.0


@pytest.fixture(scope="module")
def crowded() -> tuple[Recording, Truth]:
    """Two persons and ten boxes for eight seconds, 7000 points a sweep."""
    pattern = sensors.VLP_16.pattern
    assert isinstance(pattern, Spinning)
    small = replace(sensors.VLP_16, pattern=replace(pattern, column_period_ns=4 * pattern.column_period_ns))
    return generate(replace(cluttered(duration_s=8.0), lidar=small), seed=2)


@pytest.fixture(scope="module")
def answers(crowded: tuple[Recording, Truth]) -> tuple[CalibrationResult, CalibrationResult]:
    """Without a choice, and with the six true walls alone."""
    recording, truth = crowded
    settings = CalibrateSettings()
    return api.calibrate(recording, settings).result, api.calibrate(
        recording, settings, planes=true_planes(truth)
    ).result


def test_any_choice_is_answered_within_its_sigmas(
    crowded: tuple[Recording, Truth], answers: tuple[CalibrationResult, CalibrationResult]
) -> None:
    """A choice says what counts in the solve and never where to start.

    Mutation: follow the lidar by the given planes only: the track is lost to boxes and persons, and a unit is blamed.
    """
    for result in answers:
        errors, stds, _ = compare(result, crowded[1])
        assert result.status == "calibrated", result.messages
        assert (np.abs(errors) < WORST_SIGMAS * np.array(stds)).all()
    assert len(answers[1].quality.planes) == len(crowded[1].planes)


def test_clutter_is_left_out_by_name_and_costs_nothing(
    crowded: tuple[Recording, Truth], answers: tuple[CalibrationResult, CalibrationResult]
) -> None:
    """At most 1.3 times what the walls alone tell, block by block.

    Mutation: no plane is ever left out (`drop_planes` that gives its state back): none is named.
    """
    free, walls = (np.array(compare(result, crowded[1])[1]) for result in answers)
    for block in (slice(0, 3), slice(3, 6), slice(6, 7)):
        assert np.linalg.norm(free[block]) < 1.3 * np.linalg.norm(walls[block])
    left_out = [m for m in answers[0].messages if m.text.endswith("left out")]
    assert {m.code for m in left_out} & {"planes.bent", "planes.moved", "planes.mixed", "planes.dropped"}


def test_every_place_and_lidar_is_drawn_and_a_seed_is_one_recording() -> None:
    """Mutation: a generator that is shared between draws."""
    drawn = [draw(seed) for seed in range(60)]
    assert {place for place, _, _ in drawn} == set(PLACES)
    assert {name for _, name, _ in drawn} == set(LIDARS)
    assert repr(draw(7)) == repr(drawn[7])
