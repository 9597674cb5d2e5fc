"""Shaking faster than the IMU samples: heard where it is, not heard where there is chance alone, and taken out of an answer."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.factors.imu import LinkFactors
from calib_core.full.joint import tones
from calib_core.full.joint.schedule import FORECAST, FULL
from calib_core.full.joint.tones import Periodogram, admit_tones, score_periodogram, standing_out, with_tone
from calib_core.full.prepare.nuisance import TONE, Nuisance
from calib_core.geometry import log
from calib_core.imu.tones import PARAMETERS
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Scenario, generate
from calib_core.simulate.faults.engine import Shaken
from calib_core.simulate.motion import Wave
from calib_core.simulate.sensors import Spinning
from tests.core.full.joint.conftest import Half
from tests.core.full.joint.test_problem import _problem
from tests.core.full.joint.test_sensors import BENT

RULES = FULL.tones


def test_the_loudest_first_of_what_stands_out_and_has_turned() -> None:
    """Mutations: no lower end; no upper end; the sum over channels for the greatest of them; `least` ignored; nothing silenced
    beside a tone, or at its images."""
    hz = np.arange(0.0, 50.0, 0.0125)  # 20 s, read four times as finely

    def heard(*tones: tuple[float, int, float], least: float = 20.0, known: tuple[float, ...] = ()) -> list[float]:
        power = np.ones((len(hz), 6))
        for at, channel, size in tones:
            power[round(at / 0.0125), channel] = size
        return [round(each, 6) for each in standing_out(Periodogram(hz, power), RULES, least, known, 10.0)]

    assert heard((1.45, 3, 60.0), (8.0, 1, 50.0)) == [1.45, 8.0]
    assert heard((1.45, 3, 60.0), (8.0, 1, 50.0), (8.0, 2, 45.0)) == [1.45, 8.0]
    assert heard((1.45, 3, 19.0)) == []
    assert heard((1.45, 3, 60.0), least=200.0) == []
    assert heard((0.05, 3, 900.0)) == []  # one turn in 20 s
    assert heard((45.0, 3, 900.0)) == []
    assert heard((1.45, 3, 60.0), (1.3, 3, 50.0), (8.55, 1, 50.0), (21.45, 1, 50.0)) == [1.45]
    assert heard((1.45, 3, 60.0), (8.55, 1, 50.0), known=(1.4,)) == []


def test_chance_has_a_mean_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals drawn as the links' own covariance has them. Mutations: the score not scaled by the information, or by that of
    the other channels; no taper in the scale."""
    problem, estimate = _problem(3)
    drawn = np.random.default_rng(5)
    whole = tones.link_factors

    def by_chance(*arguments: Any) -> LinkFactors:
        factors = whole(*arguments)
        return replace(factors, residual=drawn.normal(size=factors.residual.shape))

    monkeypatch.setattr(tones, "link_factors", by_chance)
    mean = np.mean([score_periodogram(problem, estimate, RULES).power.mean(axis=0) for _ in range(400)], axis=0)
    np.testing.assert_allclose(mean, 1.0, atol=0.15)


@pytest.mark.parametrize(
    ("intrinsics", "shaken", "least"),
    [
        ("auto", False, 20.0),
        ("auto", True, 20.0),
        ("consider", False, RULES.shouts),
        ("off", False, RULES.shouts),
        ("off", True, 20.0),
    ],
)
def test_what_held_sensors_make_of_the_motion_is_no_tone(
    half: Half, intrinsics: Literal["auto", "consider", "off"], shaken: bool, least: float
) -> None:
    """Seen: a calm industrial IMU taken for ideal by request was said to be shaken faster than it samples, in five tones of the
    hand's own motion. Mutations: `shaken` ignored; held by "off" alone."""
    run = half.data.run
    settings = run.settings.model_copy(update={"intrinsics": intrinsics})
    run = replace(run, settings=settings, noise=replace(run.noise, shaken=shaken))
    sensors = Nuisance() if intrinsics == "off" else half.data.sensors
    assert tones.admitted_from(replace(half.data, run=run, sensors=sensors), RULES, 20.0) == least


def test_who_wants_no_tone_does_not_listen(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """A forecast's schedule. Oracle: the way to the periodogram, barred. Mutation: listen before it is asked how many."""
    monkeypatch.setattr(tones, "listen", None)
    none = FORECAST.tones
    assert none.most == 0
    assert admit_tones(half.data, half.state, none, FULL.sensors, FULL.sampling, least=0.0) is half.state


def test_a_tone_comes_before_what_is_the_rooms(half: Half) -> None:
    """Two tones one after the other, and the heights of patches stay where their columns are. Mutation: append at the end."""
    values = np.arange(float(BENT.size))
    state = replace(half.state, nuisance=BENT, estimate=replace(half.state.estimate, nuisance=values))
    for hz in (1.4, 3.0):
        state = with_tone(half.data, state, hz, RULES)
    assert state.nuisance.tones_hz == (1.4, 3.0)
    assert state.nuisance.size == len(state.estimate.nuisance) == BENT.size + 2 * PARAMETERS
    assert len(state.priors.nuisance_std) == state.nuisance.size
    assert (state.nuisance.values(state.estimate.nuisance, TONE) == 0.0).all()
    for block in BENT.blocks:
        np.testing.assert_array_equal(
            state.nuisance.values(state.estimate.nuisance, block.block), BENT.values(values, block.block)
        )
    assert state.nuisance.sensors.size == BENT.sensors.size


def test_shaken_at_98_6_hertz_the_answer_is_as_good_as_in_calm(short: Scenario) -> None:
    """An IMU read 100 times a second, shaken at 98.6 Hz along two of the room's axes: at 1.4 Hz nothing moved.

    Mutations: `admit_tones` never called (MEASURED); amplitudes that go with the IMU alone.
    """
    across = (Wave(0.3 / (2 * np.pi * 98.6) ** 2, 98.6, 0.4),)
    assert isinstance(short.lidar.pattern, Spinning)
    few = replace(
        short.lidar, pattern=replace(short.lidar.pattern, column_period_ns=2 * short.lidar.pattern.column_period_ns)
    )
    shaken = replace(short, motion=Shaken(short.motion, (across, (), across), ((), (), ())), lidar=few, duration_s=10.0)
    recording, truth = generate(shaken, seed=3)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    heard = [message.text for message in result.messages if message.code == "imu.tone"]
    assert len(heard) == 1
    found = re.search(r"tone of (\S+) Hz \((\S+) m/s2", heard[0])
    assert found is not None
    assert float(found[1]) == pytest.approx(1.4, abs=0.02)
    assert float(found[2]) == pytest.approx(0.3, rel=0.1)  # two axes of 0.3, root mean square
    assert result.T_imu_lidar is not None
    T = np.array(result.T_imu_lidar.matrix)
    turn = np.degrees(log(truth.R_imu_lidar.T @ T[:3, :3]))
    assert (np.abs(T[:3, 3] - truth.p_imu_lidar) < 4.0 * np.array(result.uncertainty.translation_std_m)).all()
    assert (np.abs(turn) < 4.0 * np.array(result.uncertainty.rotation_std_deg)).all()
    assert np.linalg.norm(result.uncertainty.translation_std_m) < 0.0016
