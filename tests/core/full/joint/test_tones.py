"""Shaking faster than the IMU samples: heard where it is, not heard where there is chance alone, and taken out of an answer."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.factors.imu import LinkFactors
from calib_core.full.joint import tones
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.policies import Tones
from calib_core.full.joint.round import gathered
from calib_core.full.joint.schedule import FORECAST, FULL
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.tone_choice import Explaining
from calib_core.full.joint.tones import (
    Periodogram,
    admit_rest,
    admit_tones,
    candidates,
    is_the_motions,
    score_periodogram,
    still_pulled,
    with_tone,
)
from calib_core.full.prepare.nuisance import SURFACE, TONE, Nuisance
from calib_core.geometry import log
from calib_core.imu.tones import PARAMETERS
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Scenario, generate
from calib_core.simulate.faults.engine import Shaken
from calib_core.simulate.motion import Kinematics, Motion, Wave
from calib_core.simulate.scenarios import named
from calib_core.simulate.sensors import Spinning
from calib_core.types import FloatArray
from tests.core.full.joint.conftest import Half
from tests.core.full.joint.misfit_problem import problem_of
from tests.core.full.joint.sensor_case import BENT

RULES = FULL.tones


HZ = np.arange(0.0, 50.0, 0.0125)  # 20 s, read four times as finely


def with_lines(*lines: tuple[float, int, float], floor: float = 1.0) -> Periodogram:
    """(hz, channel, power) in an even floor."""
    power = np.full((len(HZ), 6), floor)
    for at, channel, size in lines:
        power[round(at / 0.0125), channel] = size
    return Periodogram(HZ, power)


def test_what_stands_out_and_has_turned() -> None:
    """Mutations: no lower end; no upper end; the sum over channels for the greatest of them."""
    assert with_lines((1.45, 3, 60.0)).of_tones(RULES).max() == 60.0
    assert with_lines((8.0, 1, 50.0), (8.0, 2, 45.0)).of_tones(RULES).max() == 50.0
    assert with_lines((0.05, 3, 900.0)).of_tones(RULES).max() == 1.0  # one turn in 20 s
    assert with_lines((45.0, 3, 900.0)).of_tones(RULES).max() == 1.0


def test_a_line_stands_out_beside_its_neighbours_however_little_is_left_there() -> None:
    """A floor of chance that falls by ten thousand from 1 to 20 Hz, as the motion takes it up, and a line a hundredth as loud as
    the loudest of it. Oracle: the exponential law's own tail. Mutations: power for its share of the median; the median without
    the law's ln 2; one of all channels.
    """
    chance = np.random.default_rng(3).exponential(size=(len(HZ) // 4 + 1, 6)).repeat(4, axis=0)[: len(HZ)]
    floor = np.maximum(HZ, 0.5)[:, None] ** -3.0 * np.array([1.0, 10.0, 1.0, 1.0, 0.1, 1.0])
    calm = Periodogram(HZ, chance * floor).beside_neighbours(RULES)
    told = (HZ > 0.1) & (HZ < 30.0)
    assert 8.0 < calm.max() < 20.0
    assert calm[told].mean() == pytest.approx(np.sum(1.0 / np.arange(1, 7)), rel=0.15)  # of the greatest of six
    power = chance * floor
    at = round(8.6 / 0.0125)
    power[at - 1 : at + 2, 4] = 60.0 * floor[at, 4]
    shaken = Periodogram(HZ, power)
    assert abs(np.argmax(shaken.beside_neighbours(RULES)) - at) <= 1
    assert shaken.beside_neighbours(RULES).max() == pytest.approx(60.0, rel=0.5)
    assert power[at, 4] < 0.01 * power[told].max()


def test_where_a_tone_may_be() -> None:
    """The loudest first, what is seen of one as the lidar's view comes round, and half the distance of two such; but nothing
    that the view itself brings, each tenth of a second.

    Mutations: half distances left out; nothing silenced beside one; known ones tried again; a sweep's harmonics tried.
    """

    def tried(*lines: tuple[float, int, float], known: tuple[float, ...] = ()) -> list[float]:
        return candidates(with_lines(*lines), RULES, known, 10.0)

    seen = (1.4625, 3, 60.0), (8.6, 1, 50.0), (11.4, 1, 40.0)
    assert [each for each in tried(*seen) if 1.3 < each < 1.6] == pytest.approx([1.4625, 1.4])
    assert not any(abs(each - 1.4) < 0.02 for each in tried(*seen, known=(1.4,)))
    near = (1.45, 3, 60.0), (1.4625, 3, 50.0)
    assert tried(*near)[:1] == pytest.approx([1.45])
    assert not any(1.455 < each < 1.475 for each in tried(*near))
    assert not any(each > 8.5 for each in tried((9.6, 1, 900.0), (20.0, 3, 800.0), (29.6, 2, 700.0)))


def test_chance_has_a_mean_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals drawn as the links' own covariance has them. Mutations: the score not scaled by the information, or by that of
    the other channels; no taper in the scale."""
    problem, estimate = problem_of(3)
    drawn = np.random.default_rng(5)
    whole = tones.link_factors

    def by_chance(*arguments: Any) -> LinkFactors:
        factors = whole(*arguments)
        return replace(factors, residual=drawn.normal(size=factors.residual.shape))

    monkeypatch.setattr(tones, "link_factors", by_chance)
    mean = np.mean([score_periodogram(problem, estimate, RULES).power.mean(axis=0) for _ in range(400)], axis=0)
    np.testing.assert_allclose(mean, 1.0, atol=0.15)


@pytest.mark.parametrize(
    ("intrinsics", "shaken", "power", "tried"),
    [
        ("auto", False, 850.0, True),
        ("auto", False, 15.0, False),
        ("consider", False, 850.0, False),
        ("off", False, 850.0, False),
        ("off", False, 20_000.0, True),
        ("off", True, 850.0, True),
    ],
)
def test_what_held_sensors_make_of_the_motion_is_no_tone(
    half: Half,
    monkeypatch: pytest.MonkeyPatch,
    intrinsics: Literal["auto", "consider", "off"],
    shaken: bool,
    power: float,
    tried: bool,
) -> None:
    """Seen: a calm industrial IMU taken for ideal by request was said to be shaken faster than it samples, in five tones of the
    hand's own motion. Mutations: `shaken` ignored; held by "off" alone; tried whatever stands out."""
    run = half.data.run
    settings = run.settings.model_copy(update={"intrinsics": intrinsics})
    run = replace(run, settings=settings, noise=replace(run.noise, shaken=shaken))
    sensors = Nuisance() if intrinsics == "off" else half.data.sensors
    monkeypatch.setattr(tones, "listen", lambda *_: with_lines((1.45, 3, power)))
    monkeypatch.setattr(tones, "explaining", lambda *_: [Explaining(1.45, 500.0)])
    data = replace(half.data, run=run, sensors=sensors)
    found = tones.found_tones(data, half.state, RULES, FULL.sensors, FULL.sampling, least=100.0)
    assert found == ([Explaining(1.45, 500.0)] if tried else [])


@pytest.mark.parametrize("shaken", [False, True])
def test_what_comes_and_goes_once_is_a_tone_where_an_engine_runs(
    half: Half, monkeypatch: pytest.MonkeyPatch, shaken: bool
) -> None:
    """Three quarters of a turn: elsewhere the biases' own drift. Seen: lines within 0.03 Hz of the IMU's rate led the answer 1 to
    4 deg away. Mutations: never a tone; always one; not for the loudest.
    """
    data = replace(half.data, run=replace(half.data.run, noise=replace(half.data.run.noise, shaken=shaken)))
    monkeypatch.setattr(tones, "listen", lambda *_: with_lines((0.0375, 3, 900.0)))
    monkeypatch.setattr(tones, "explaining", lambda *asked: [Explaining(0.0375, 500.0)])
    found = tones.found_tones(data, half.state, RULES, FULL.sensors, FULL.sampling, least=100.0)
    assert found == ([Explaining(0.0375, 500.0)] if shaken else [])
    assert tones.loudest(data, half.state, RULES) == (900.0 if shaken else 1.0)


@pytest.mark.parametrize("coarse", [False, True])
def test_coarse_readings_have_no_tones(half: Half, monkeypatch: pytest.MonkeyPatch, coarse: bool) -> None:
    """Seen: steps of 1 deg/s on a walk were eight tones of up to 14 m/s2, and the rotation unknown by 57 deg. Mutation: asked all
    the same.
    """
    data = replace(half.data, run=replace(half.data.run, noise=replace(half.data.run.noise, coarse=coarse)))
    monkeypatch.setattr(tones, "listen", lambda *_: with_lines((4.45, 3, 20_000.0)))
    monkeypatch.setattr(tones, "explaining", lambda *_: [Explaining(4.45, 500.0)])
    found = tones.found_tones(data, half.state, RULES, FULL.sensors, FULL.sampling, least=100.0)
    assert found == ([] if coarse else [Explaining(4.45, 500.0)])


@pytest.mark.parametrize("by_one", [False, True])
def test_what_one_plane_alone_tells_is_left_out_with_all_that_is_as_slow(
    half: Half, monkeypatch: pytest.MonkeyPatch, by_one: bool
) -> None:
    """An engine's quicker lines stay. Mutations: the best alone left out; the quick ones, too; never asked."""
    every = [Explaining(1.45, 500.0), Explaining(0.8, 400.0), Explaining(4.45, 300.0)]
    monkeypatch.setattr(tones, "listen", lambda *_: with_lines((1.45, 3, 20_000.0)))
    monkeypatch.setattr(tones, "explaining", lambda *_: every)
    monkeypatch.setattr(tones, "is_one_planes", lambda *_: by_one)
    found = tones.found_tones(half.data, half.state, RULES, FULL.sensors, FULL.sampling, least=100.0)
    assert found == (every[2:] if by_one else every)


@pytest.mark.parametrize("fault", ["", "mixed"])
def test_what_a_chosen_plane_that_is_none_makes_of_the_motion_is_no_tone(
    half: Half, monkeypatch: pytest.MonkeyPatch, fault: Literal["", "mixed"]
) -> None:
    """Seen: two surfaces chosen as one plane, from scan to scan one or the other, were four tones of 0.2 to 0.4 Hz, in 67 rounds
    where 20 do. One that shouts is one still. Mutations: faults ignored; nothing heard beside one.
    """
    first, *others = half.state.planes
    state = replace(half.state, planes=(replace(first, fault=fault), *others))
    run = replace(half.data.run, noise=replace(half.data.run.noise, shaken=True))
    data = replace(half.data, run=run)
    monkeypatch.setattr(tones, "explaining", lambda *_: [Explaining(1.45, 500.0)])
    for power in (2000.0, 20_000.0):
        monkeypatch.setattr(tones, "listen", lambda *_, power=power: with_lines((1.45, 3, power)))
        found = tones.found_tones(data, state, RULES, FULL.sensors, FULL.sampling, least=100.0)
        assert bool(found) is (not fault or power > RULES.shouts)


def test_points_are_laid_on_planes_where_nobody_has_since_some_were_dropped(half: Half) -> None:
    """Seen: a shaken recording whose clutter was left out ended in an assertion. Mutation: the observations taken as they are."""
    state = replace(half.state, observations=None)
    every = replace(RULES, beside=0.0)
    found = tones.found_tones(half.data, state, every, FULL.sensors, FULL.sampling, least=-1.0)
    assert found
    assert state.observations is None


def test_a_tone_after_which_more_is_to_be_explained_was_none(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """And each has to be as loud as the first, where that is asked for. Mutations: gone on with; the one before given up too; any
    is heard after the first."""
    asked: list[float] = []
    left = iter([[Explaining(1.4, 900.0)], [Explaining(3.0, 300.0)], [Explaining(0.5, 400.0)]])

    def found(*_: object, least: float, loud: float) -> list[Explaining]:
        assert least == 50.0
        asked.append(loud)
        return next(left)

    monkeypatch.setattr(tones, "found_tones", found)
    monkeypatch.setattr(tones, "told", lambda _data, state, *_: state)
    after = admit_tones(half.data, half.state, RULES, FULL.sensors, FULL.sampling, least=50.0, loud=7.0)
    assert after.nuisance.tones_hz == (1.4,)
    assert asked == [7.0, 7.0, 7.0]


def test_tones_are_heard_anew_from_rounds_without_any(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the state is as it is where there were none. Mutations: from rounds with them; one that is no louder than bent walls is
    taken; none is ever heard again once they were given up; how loud they have to be is lost on the way.
    """
    toned = tones.with_tone(half.data, half.state, 1.4, RULES)
    asked: list[tuple[float, float]] = []

    def admitted(_data: object, state: Estimation, *_: object, least: float, loud: float) -> Estimation:
        assert not state.nuisance.tones_hz
        assert not state.untuned
        assert state.nuisance == half.state.nuisance
        asked.append((least, loud))
        return replace(state, rounds=78)

    monkeypatch.setattr(tones, "admit_tones", admitted)
    monkeypatch.setattr(tones, "told", lambda _data, state, *_: state)
    assert tones.heard_anew(half.data, half.state, RULES, FULL.sensors, FULL.sampling) is half.state
    assert tones.heard_anew(half.data, toned, RULES, FULL.sensors, FULL.sampling).rounds == 78
    assert tones.heard_anew(half.data, toned, RULES, FULL.sensors, FULL.sampling, loud=9.0).rounds == 78
    assert asked == [(RULES.explains_at_once, 0.0), (RULES.explains_at_once, 9.0)]


def test_three_lines_with_overlapping_feet_are_no_lines(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three seconds: a turn is a third of a hertz. Mutations: two are too many; those far away count; an engine's too,
    quicker than hands; an engine's never; looked for again afterwards.
    """
    turn_hz = 1.0 / float(np.ptp(half.data.readings.knots_s[: half.state.knots]))
    monkeypatch.setattr(tones, "told", lambda _data, state, *_: state)

    def admitted(*turns: float, shaken: bool = False) -> Estimation:
        left = iter([*([Explaining(each * turn_hz, 900.0 - k)] for k, each in enumerate(turns)), []])
        monkeypatch.setattr(tones, "found_tones", lambda *_, **__: next(left))
        run = replace(half.data.run, noise=replace(half.data.run.noise, shaken=shaken))
        data = replace(half.data, run=run)
        return admit_tones(data, half.state, RULES, FULL.sensors, FULL.sampling, least=50.0)

    assert len(admitted(3.0, 5.0).nuisance.tones_hz) == 2
    assert len(admitted(3.0, 5.0, 9.5).nuisance.tones_hz) == 3
    assert admitted(9.5, 3.0, 6.5).nuisance.tones_hz == ()
    assert admitted(1.0, 2.5, 4.5, shaken=True).nuisance.tones_hz == ()
    assert len(admitted(43.0, 45.0, 46.5, 1.0, shaken=True).nuisance.tones_hz) == 4
    assert len(admitted(3.0, 19.0, 21.0, shaken=True).nuisance.tones_hz) == 3
    assert admitted(43.0, 45.0, 46.5).nuisance.tones_hz == ()
    hump = admitted(3.0, 5.0, 6.5)
    assert hump.nuisance == half.state.nuisance
    assert hump.nuisance.tones_hz == ()
    monkeypatch.undo()
    assert tones.found_tones(half.data, hump, replace(RULES, beside=0.0), FULL.sensors, FULL.sampling, least=-1.0) == []


def test_what_has_pulled_at_a_rough_motion_is_asked_of_the_one_at_rest(half: Half) -> None:
    """Seen: a motion that began 10 deg off was left with a warning of rooms that move, long after it had come to where it was.

    Mutations: it stays as it was found; it is forgotten in any case.
    """
    bins = gathered(half.data, half.state).bins
    pulled = replace(half.state, untuned=True)

    def at_rest(state: Estimation, rules: Tones) -> Estimation:
        return still_pulled(half.data, state, rules, FULL.sensors, FULL.sampling, bins)

    assert not at_rest(pulled, RULES).untuned
    assert at_rest(pulled, replace(RULES, beside=0.0, explains=-1.0)) is pulled
    assert at_rest(half.state, RULES) is half.state


@dataclass(frozen=True)
class Lift:
    """A motion in a cabin that itself speeds up by 0.1 m/s2 for two seconds and slows down again; told in the cabin's frame."""

    motion: Motion

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        """What an IMU in it feels."""
        inside = self.motion.kinematics(t_s)
        pulse = [np.clip(np.minimum(t_s - a, a + 2.0 - t_s) / 0.4, 0.0, 1.0) for a in (3.0, 8.0)]
        up = 0.1 * (pulse[0] - pulse[1])
        return replace(inside, a_m_s2=inside.a_m_s2 + up[:, None] * np.array([0.0, 0.0, 1.0]))


def test_a_lift_is_no_row_of_tones() -> None:
    """Seen: eight tones of 0.1 to 1.1 Hz took the start and the stop of a cabin away, and an answer four and a half sigmas off
    was `calibrated` without a word; at a tenth of it, one of three and a half. Left in, the parts of the recording contradict
    each other, as they do. Mutation: `is_hump` says no.
    """
    hand = named("paper-normal")
    recording, _ = generate(replace(hand, motion=Lift(hand.motion), duration_s=12.0), seed=5)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    codes = [message.code for message in result.messages]
    assert "imu.tone" not in codes
    assert {"motion.unseen", "solve.disagreement"} <= set(codes)
    assert result.status == "weak"


@pytest.mark.parametrize(
    ("found", "shaken", "the_motions"),
    [
        ([(0.28, 981.0), (1.35, 631.0), (0.23, 396.0)], False, True),  # ranges that bend by centimetres, 20 s by hand
        ([(0.28, 93.0), (0.44, 73.0), (0.23, 46.0)], False, True),  # an accelerometer that lags
        ([(0.30, 4787.0), (0.36, 999.0), (0.25, 114.0)], False, False),  # 0.05 m/s2 at 100.3 Hz
        ([(0.80, 3237.0), (0.53, 337.0)], False, False),  # fabric that sags, and a line
        ([(1.40, 300.0), (1.48, 290.0)], False, False),  # two motors that turn nearly alike
        ([(0.28, 981.0), (1.35, 631.0)], True, False),  # an engine is heard
        ([(3.50, 153.0), (6.51, 156.0)], False, False),  # quicker than hands
        ([(0.80, 90.0), (3.50, 80.0)], False, False),
        ([(3.50, 90.0), (0.80, 80.0)], False, False),
    ],
)
def test_what_explains_little_more_than_others_all_along_is_no_tone(
    half: Half, monkeypatch: pytest.MonkeyPatch, found: list[tuple[float, float]], shaken: bool, the_motions: bool
) -> None:
    """Twenty seconds: the best first. As measured. Mutations: any rival; any that is as slow, its own foot too; of engines as
    well; of quick ones as well; how much a rival explains not asked.
    """
    run = replace(half.data.run, noise=replace(half.data.run.noise, shaken=shaken))
    readings = replace(half.data.readings, knots_s=np.linspace(0.0, 20.0, half.state.knots))
    data = replace(half.data, run=run, readings=readings)
    best = [Explaining(hz, decrease) for hz, decrease in found]
    assert is_the_motions(data, half.state, best, RULES) is the_motions
    monkeypatch.setattr(tones, "found_tones", lambda *_, **__: best)
    monkeypatch.setattr(tones, "told", lambda _data, state, *_: state)
    monkeypatch.setattr(tones, "is_heard", lambda *_: True)
    monkeypatch.setattr(tones, "goes_on_at_rest", lambda *_: True)
    bins: Any = None
    after = admit_rest(data, half.state, RULES, FULL.sensors, FULL.sampling, bins)
    assert after.nuisance.tones_hz == (() if the_motions else (found[0][0],))


def test_who_wants_no_tone_does_not_listen(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """A forecast's schedule. Oracle: the way to the periodogram, barred. Mutation: listen before it is asked how many."""
    monkeypatch.setattr(tones, "listen", None)
    none = FORECAST.tones
    assert none.most == 0
    assert admit_tones(half.data, half.state, none, FULL.sensors, FULL.sampling, least=0.0) is half.state


def test_a_tone_comes_before_what_is_the_rooms(half: Half) -> None:
    """Two tones one after the other, and the heights of patches stay where their columns are. Mutation: append at the end."""
    values = np.arange(float(BENT.size))
    state = replace(half.state, estimate=replace(half.state.estimate, sensors=SensorState(BENT, values)))
    for hz in (1.4, 3.0):
        state = with_tone(half.data, state, hz, RULES)
    assert state.nuisance.tones_hz == (1.4, 3.0)
    assert state.nuisance.size == BENT.size + 2 * PARAMETERS
    assert state.nuisance.start(SURFACE) == state.nuisance.size - 2
    assert (state.estimate.sensors.of(TONE) == 0.0).all()
    for block in BENT.blocks:
        np.testing.assert_array_equal(state.estimate.sensors.of(block.block), BENT.values(values, block.block))
    assert state.nuisance.sensors.size == BENT.sensors.size


def test_shaken_at_98_6_hertz_the_answer_is_as_good_as_in_calm(short: Scenario) -> None:
    """An IMU read 100 times a second, shaken at 98.6 and 98.45 Hz along two of the room's axes: at 1.4 and 1.55 Hz nothing moved,
    and one turn and a half in the recording is all that they are apart.

    Mutations: `admit_tones` never called (MEASURED); amplitudes that go with the IMU alone; tones four turns apart at the least;
    the loudest for what explains most.
    """
    across, up = ((Wave(0.3 / (2 * np.pi * hz) ** 2, hz, 0.4),) for hz in (98.6, 98.45))
    assert isinstance(short.lidar.pattern, Spinning)
    few = replace(
        short.lidar, pattern=replace(short.lidar.pattern, column_period_ns=2 * short.lidar.pattern.column_period_ns)
    )
    shaken = replace(short, motion=Shaken(short.motion, (across, (), up), ((), (), ())), lidar=few, duration_s=10.0)
    recording, truth = generate(shaken, seed=3)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    heard = [message.text for message in result.messages if message.code == "imu.tone"]
    found = [re.search(r"tone of (\S+) Hz \((\S+) m/s²", each) for each in heard]
    assert sorted(float(each[1]) for each in found if each) == pytest.approx([1.4, 1.55], abs=0.02)
    assert [float(each[2]) for each in found if each] == pytest.approx([0.3 / np.sqrt(2.0)] * 2, rel=0.15)
    assert result.T_imu_lidar is not None
    T = np.array(result.T_imu_lidar.matrix)
    turn = np.degrees(log(truth.R_imu_lidar.T @ T[:3, :3]))
    assert (np.abs(T[:3, 3] - truth.p_imu_lidar) < 4.0 * np.array(result.uncertainty.translation_std_m)).all()
    assert (np.abs(turn) < 4.0 * np.array(result.uncertainty.rotation_std_deg)).all()
    assert np.linalg.norm(result.uncertainty.translation_std_m) < 0.0016
