"""A room whose surfaces read long or short, each for what it is made of: the answer does not answer for it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import chi2

from calib_core import api
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.prepare.nuisance import MATERIAL, SURFACE, TONE, choose_nuisance
from calib_core.intrinsics import UNKNOWN_IMU, UNKNOWN_LIDAR
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate, parse_faults, prepare
from tests.core.full.answers import errors_of
from tests.core.full.joint.sensor_case import BENT

_FAULTS = "materials=6mm"


@pytest.mark.parametrize(("seed", "stands_out"), [(1, "ceiling"), (2, "floor")])
def test_what_walls_are_made_of_does_not_bend_the_answer_and_is_told(seed: int, stands_out: str) -> None:
    """Oracle: the simulator's own offset of each surface, and chi-square of the seven errors.

    Mutations: materials never admitted (nothing told; the answer 2 to 3 times as far off); the sentence's sign.
    """
    sim = prepare("handheld", seed=seed, duration_s=10.0, faults=parse_faults(_FAULTS))
    names = [face.name for face in sim.scenario.scene.faces]
    offsets_m = np.array(sim.faults.lidar.surface_range_offset_m[: len(names)])
    beside_mm = 1e3 * float(offsets_m[names.index(stands_out)] - offsets_m.mean())
    recording, truth = generate(SCENARIOS["handheld"], seed=seed, duration_s=10.0, faults=parse_faults(_FAULTS))
    result = api.calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.uncertainty is not None
    errors = errors_of(result, truth)
    assert errors @ np.linalg.solve(np.array(result.uncertainty.covariance), errors) < chi2.ppf(0.999, 7)
    (text,) = (said.text for said in result.messages if said.code == "planes.material")
    told = re.match(r"(\w+) reads ([\d.]+) mm (long|short) compared", text)
    assert told is not None
    assert told[1] == stands_out
    # What the others have in common nobody tells: the prior's two millimetres are left.
    assert (float(told[2]) if told[3] == "long" else -float(told[2])) == pytest.approx(beside_mm, abs=3.0)


def test_planes_that_go_take_their_material_along() -> None:
    """Mutations: the first of the planes' values left instead of those that stay; the values of what comes after lost with
    them; materials after the tones, where readings look for theirs."""
    sensors = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=2, clock_rate_std_ppm=40.0)
    every = sensors.with_materials(4).with_tone(11.0, 0.1, 0.0)
    assert [each.block for each in every.blocks[-2:]] == [MATERIAL, TONE]
    assert every.with_materials(4) is every
    values = np.arange(every.size, dtype=np.float64)
    kept = every.of_planes(np.array([True, False, True, False]))
    left = SensorState(every, values).onto(kept)
    assert kept.size == every.size - 2
    np.testing.assert_array_equal(left.of(MATERIAL), every.values(values, MATERIAL)[[0, 2]])
    np.testing.assert_array_equal(left.of(TONE), every.values(values, TONE))
    assert sensors.of_planes(np.ones(4, bool)) is sensors
    again = left.onto(kept.of_planes(np.array([False, True])))
    np.testing.assert_array_equal(again.of(MATERIAL), every.values(values, MATERIAL)[2])
    np.testing.assert_array_equal(
        kept.values(kept.prior_std, MATERIAL), every.values(every.prior_std, "incidence")[[0, 0]]
    )


def test_without_an_incidence_there_are_no_materials() -> None:
    """Whoever takes the lidar for ideal, or asks for other parameters alone, has none. Mutation: the incidence's prior taken for
    granted."""
    only = choose_nuisance(UNKNOWN_IMU, UNKNOWN_LIDAR, lasers=2, clock_rate_std_ppm=40.0, wanted=("clock_rate",))
    assert only.with_materials(3) is only
    bent = BENT.with_materials(3)
    assert [each.block for each in bent.blocks[-2:]] == [MATERIAL, SURFACE]
    assert bent.sensors.blocks == BENT.sensors.blocks
