"""Stretches of time that answer two time offsets, and what becomes of the recording they are of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core import calibrate as page
from calib_core.calibrate import calibrate
from calib_core.events import LogEvent, ignore_event
from calib_core.full.assess import disagreement
from calib_core.full.assess.clock_step import clock_step, misfit, turning_within
from calib_core.full.assess.disagreement import planes_at_once
from calib_core.full.assess.error_budget import DISAGREEMENT
from calib_core.full.assess.influence import Influences
from calib_core.message_log import MessageLog
from calib_core.method import Answer, Question
from calib_core.recording_break import break_of
from calib_core.result import CalibrationResult, Message, TimeBlock
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth, generate
from calib_core.types import FloatArray, ImuData, Recording

STD_S = 1e-4
SETTINGS = CalibrateSettings(intrinsics="off", points_per_plane_per_scan=100, crispness=False)


def _blocks(offsets_s: FloatArray, std_s: float = STD_S) -> list[TimeBlock]:
    zeros = [0.0, 0.0, 0.0]
    return [
        TimeBlock(
            rotation_shift_deg=zeros,
            translation_shift_m=zeros,
            time_offset_shift_s=float(offset),
            rotation_std_deg=zeros,
            translation_std_m=zeros,
            time_offset_std_s=std_s,
            t_start_s=2.5 * k,
            t_end_s=2.5 * (k + 1),
        )
        for k, offset in enumerate(offsets_s)
    ]


def _noise(seed: int) -> FloatArray:
    return np.asarray(STD_S * np.random.default_rng(seed).standard_normal(8), dtype=np.float64)


def test_chance_and_a_clock_that_runs_apart_are_no_step() -> None:
    """The squares about a line are chi-square with six degrees of freedom, and a drift changes nothing in them. Mutations: about
    a constant; weights that are standard deviations.
    """
    drift = 3e-3 * np.arange(8)
    squares = np.array([misfit(_blocks(_noise(seed) + drift)) for seed in range(400)])
    assert np.mean(squares) == pytest.approx(6.0, abs=4.0 * np.sqrt(12.0 / 400))
    assert not any(clock_step(_blocks(_noise(seed) + drift)) for seed in range(200))


@pytest.mark.parametrize("at", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_longer_side_of_a_step_is_kept(at: int, share: float) -> None:
    """The stretch in which it happens answers something between. A drift on top of it is none of its business. Mutations: the
    shorter side; the stretch of the step among what is kept.
    """
    offsets = _noise(at) + 1e-3 * np.arange(8) + 2e-3 * (np.arange(8) > at)
    offsets[at] += 2e-3 * share
    step = clock_step(_blocks(offsets))
    assert step is not None
    low, high = step.longer_s
    # A step between two stretches is as well said to be in either.
    edges = {0.0: (at, at + 1), 0.4: (at,), 1.0: (at - 1, at)}[share]
    assert step.within_s[0] / 2.5 in edges
    assert high - low >= 2.5 * 3.0
    assert not low < 2.5 * (at + 1.0 - share) < high
    assert step.left_out_s in {(-np.inf, low), (high, np.inf)}


def test_stretches_that_ask_for_what_no_clock_does_are_no_step() -> None:
    """Seen: ten thousand seconds, where the arithmetic had broken down; half of the recording was left out.

    Mutations: not asked; of one sign alone.
    """
    for beyond in (1.4e4, -3.0):
        offsets = _noise(3) + np.where(np.arange(8) > 3, beyond, 0.0)
        assert clock_step(_blocks(offsets)) is None


def test_disagreement_that_no_step_explains_stays_what_it_is() -> None:
    """Mutation: any disagreement is a step."""
    offsets = 1e-3 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    assert misfit(_blocks(offsets)) > 500.0
    assert clock_step(_blocks(offsets)) is None


def test_a_step_counts_beside_what_planes_disagree_about_at_the_same_time() -> None:
    """Walls that are not flat pull stretches of time apart, too. Mutations: they are not asked; less than chance makes a step."""
    offsets = _noise(3) + 2e-3 * (np.arange(8) > 3)
    beyond = misfit(_blocks(offsets))
    assert 80.0 < beyond < 400.0
    assert clock_step(_blocks(offsets), at_once=1.5) is not None
    assert clock_step(_blocks(offsets), at_once=15.0) is None
    assert misfit(_blocks(offsets), at_once=15.0) == pytest.approx(beyond / 15.0)
    assert misfit(_blocks(offsets), at_once=0.2) == pytest.approx(beyond)


def test_what_planes_disagree_about_at_the_same_time() -> None:
    """Five planes in each of eight stretches, pulls drawn by their own law: mean square 1, whatever each stretch asks for. Walls
    that ask for other offsets, each the same in all of them, show. Oracle: the draws.

    Mutations: one shift for all stretches; the pulls as they are; weights that are standard deviations.
    """
    rng = np.random.default_rng(8)
    block, plane = np.divmod(np.arange(40), 5)
    root = rng.normal(size=(40, 7, 9)) * rng.uniform(0.2, 2.0, (40, 1, 1))
    allowed = root @ np.swapaxes(root, 1, 2)
    inverse = np.linalg.inv(joint := allowed.sum(axis=0))

    def found(shifts: FloatArray) -> float:
        drawn = (root @ rng.normal(size=(40, 9, 1)))[..., 0]
        return planes_at_once(Influences(drawn + shifts[:, None] * (allowed @ inverse)[:, :, 6], allowed), block, joint)

    chance = np.sqrt(2.0 / 32.0 / 100.0)
    for asked in (0.0, 1e3):
        squares = [found(asked * rng.normal(size=8)[block]) for _ in range(100)]
        assert np.mean(squares) == pytest.approx(1.0, abs=4.0 * chance)
    assert found(1e3 * rng.normal(size=5)[plane]) > 30.0
    held = joint.copy()
    held[6] = held[:, 6] = 0.0
    assert planes_at_once(Influences(np.ones((40, 7)), allowed), block, held) == 1.0


def test_a_stretch_that_tells_no_time_has_no_say() -> None:
    """A first stretch of standstill, a hundred times less sure than the others and thirteen of its own sigmas off them: a
    gyroscope in steps of 1 deg/s asks for that. A step among the others is seen as it was. Oracle: the squares of seven stretches
    about a line are chi-square with five degrees of freedom. Mutations: a weight for every stretch; the mean for the best.
    """

    def still_first(offsets_s: FloatArray) -> list[TimeBlock]:
        still = _blocks(np.full(1, 13.0 * 100.0 * STD_S), 100.0 * STD_S)
        return [*still, *_blocks(offsets_s)[1:]]

    squares = np.array([misfit(still_first(_noise(seed))) for seed in range(400)])
    assert np.mean(squares) == pytest.approx(5.0, abs=4.0 * np.sqrt(10.0 / 400))
    assert not any(clock_step(still_first(_noise(seed))) for seed in range(200))
    step = clock_step(still_first(_noise(1) + 2e-3 * (np.arange(8) > 4)))
    assert step is not None
    assert step.longer_s == (0.0, 10.0)


def test_a_stretch_that_did_not_turn_knows_no_time_however_sure_it_seems() -> None:
    """A vehicle that stands for a quarter of its recording: what its stretches know is noise that looks like turning, at a fifth
    of the others' sureness, and they are six and eight of their own sigmas off. Such were 8 + 3, 3 + 1, 5 + 1 and 3 + 0 of four
    simulated drives, and of one the standing was left out as a clock's step. A step among the others is seen as it was.

    Oracle: the squares of six stretches about a line are chi-square with four degrees of freedom. Mutations: as sure as they
    seem; by the best stretch in place of the middle one.
    """
    turning = np.array([1e-4, 2e-4, *np.full(6, 0.3)])

    def standing_first(offsets_s: FloatArray) -> list[TimeBlock]:
        still = _blocks(5.0 * STD_S * np.array([8.0, -6.0]), 5.0 * STD_S)
        return [*still, *_blocks(offsets_s)[2:]]

    squares = np.array([misfit(standing_first(_noise(seed)), turning) for seed in range(400)])
    assert np.mean(squares) == pytest.approx(4.0, abs=4.0 * np.sqrt(8.0 / 400))
    assert not any(clock_step(standing_first(_noise(seed)), turning) for seed in range(200))
    step = clock_step(standing_first(_noise(1) + 2e-3 * (np.arange(8) > 4)), turning)
    assert step is not None
    assert step.longer_s == (0.0, 10.0)


def test_turning_is_told_stretch_by_stretch(recorded: tuple[Recording, Truth]) -> None:
    """Oracle: a sine's rms; white noise falls with the root of how many readings are taken together. Mutations: the offset taken
    from the stamps instead of added; a steady turn counted; single readings.
    """
    recording, _ = recorded
    imu, offset_s = recording.imu, 0.5
    at_s = (imu.stamps_ns - recording.scans[0].stamp_ns) * 1e-9 + offset_s
    rate = np.where(at_s < 5.0, 0.0, 0.4 * np.sqrt(2.0) * np.sin(2 * np.pi * 0.8 * at_s))
    noise = 0.02 * np.random.default_rng(1).standard_normal((len(at_s), 3))
    gyro = 0.3 + noise + rate[:, None] * np.array([0.0, 0.6, 0.8])
    moved = replace(recording, imu=replace(imu, gyro_rad_s=gyro))
    found = turning_within(_blocks(np.zeros(4)), moved, round(offset_s * 1e9))
    together = round(0.05 / float(np.median(np.diff(at_s))))
    assert found[:2] == pytest.approx(0.02 * np.sqrt(3.0 / together), rel=0.4)
    assert found[2:] == pytest.approx(0.4, rel=0.02)


@pytest.fixture(scope="module")
def recorded() -> tuple[Recording, Truth]:
    return generate("paper-normal", seed=2, duration_s=14.0)


@dataclass(frozen=True)
class Broken:
    """A recording whose IMU's stamps are 5 ms later from a part of it on, where nothing else is wrong, and its calibration.

    whole: the answer of all of it, on the way to the result.   said: until then.   apart: what its planes disagreed about at the
    same time, as often as it was asked.
    """

    recording: Recording
    result: CalibrationResult
    whole: Answer
    said: list[Message]
    apart: list[float]

    def solved_again(self, patch: pytest.MonkeyPatch, *, at_once: float | None = None) -> CalibrationResult:
        """The result from that answer on. at_once: what its planes are then said to disagree about."""
        really = page._answer

        def known(recording: Recording, question: Question) -> Answer:
            if recording is not self.recording:
                return really(recording, question)
            question.log.restore(self.said)
            return self.whole if at_once is None else replace(self.whole, at_once=at_once)

        patch.setattr(page, "_answer", known)
        return calibrate(self.recording, SETTINGS).result


@pytest.fixture(scope="module")
def broken(recorded: tuple[Recording, Truth]) -> Broken:
    """Solved once, as anybody would."""
    imu = recorded[0].imu
    later = np.where(np.arange(len(imu.stamps_ns)) > 0.4 * len(imu.stamps_ns), 5_000_000, 0)
    spoilt = replace(recorded[0], imu=replace(imu, stamps_ns=imu.stamps_ns + later))
    answers = list[tuple[Answer, list[Message], list[float]]]()
    apart = list[float]()
    really = page._answer

    def watched(recording: Recording, question: Question) -> Answer:
        answer = really(recording, question)
        answers.append((answer, question.log.snapshot(), list(apart)))
        return answer

    def asked(*given: Any) -> float:
        apart.append(planes_at_once(*given))
        return apart[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "_answer", watched)
        patch.setattr(disagreement, "planes_at_once", asked)
        result = calibrate(spoilt, SETTINGS).result
    return Broken(spoilt, result, *answers[0])


def test_a_recording_whose_clock_was_set_is_answered_by_its_longer_part(
    recorded: tuple[Recording, Truth], broken: Broken
) -> None:
    """Its later part has a time offset 5 ms less. Mutations: no second look; what was said on the way to the first answer is
    said of the second.
    """
    recording, truth = recorded
    result = broken.result
    assert result.status == "calibrated"
    said = {message.code: message.text for message in result.messages}
    assert "one of the two clocks was set, or the mount slipped, between" in said["clock.set"]
    # The whole recording's parts disagree, 5.8 times.
    assert "solve.disagreement" in {message.code for message in broken.said}
    assert "solve.disagreement" not in said
    assert 20 < result.quality.scans_used < 0.65 * len(recording.scans)
    assert result.uncertainty is not None
    assert result.T_imu_lidar is not None
    std = np.sqrt(np.diag(np.array(result.uncertainty.covariance)))
    assert result.time_offset_s == pytest.approx(truth.time_offset_ns * 1e-9 - 5e-3, abs=4.0 * std[6])
    off = np.array(result.T_imu_lidar.translation_m) - truth.p_imu_lidar
    assert np.linalg.norm(off) < 4.0 * np.linalg.norm(std[3:6])


def test_when_a_recording_broke_is_told_from_its_first_scan(recorded: tuple[Recording, Truth]) -> None:
    """A hundred seconds were skipped: a step in the fifth of eight stretches of 2.5 s, and a silence of the IMU from 4 to 8 s.
    The result's own times count so. Oracle: the sums.

    Seen: "between 10.0 s and 12.5 s" beside stretches from 100 s on. Mutation: as the sides have them, of the span of the break;
    of the longer side; of either break.
    """
    recording = replace(recorded[0], skipped_s=100.0)
    offsets = _noise(1) + np.concatenate([np.zeros(4), [2e-3], np.full(3, 4e-3)])
    parts = SimpleNamespace(time_blocks=_blocks(offsets))
    answer: Any = SimpleNamespace(evidence=SimpleNamespace(parts=parts), time_offset_ns=0, at_once=1.0)
    imu = recording.imu
    turning = replace(
        recording, imu=replace(imu, gyro_rad_s=np.random.default_rng(1).normal(size=imu.gyro_rad_s.shape))
    )
    log = MessageLog(ignore_event)
    step = break_of(answer, turning, log)
    assert step is not None
    assert "between 110.0 s and 112.5 s" in step.told("all is used").text
    assert step.longer_in_words == "between 100.0 s and 110.0 s"
    at_s = (imu.stamps_ns - recording.scans[0].stamp_ns) * 1e-9
    heard = (at_s < 4.0) | (at_s > 8.0)
    silent = ImuData(imu.stamps_ns[heard], imu.gyro_rad_s[heard], imu.accel_m_s2[heard], imu.topic, imu.frame_id)
    log(LogEvent(level="warning", code=DISAGREEMENT, text="parts disagree"))
    unknown: Any = SimpleNamespace(evidence=None, time_offset_ns=0)
    silence = break_of(unknown, replace(recording, imu=silent), log)
    assert silence is not None
    assert "the IMU is silent between 104.0 s and 108.0 s" in silence.what
    assert silence.longer_in_words.startswith("between 108.0 s and 11")


def test_walls_that_disagree_at_the_same_time_are_no_clock(broken: Broken, monkeypatch: pytest.MonkeyPatch) -> None:
    """As rough ones of a mine did. Planes of a room whose clock is set do not, so that they are made to here. Mutations: the
    answer does not have it; it is not asked.
    """
    assert broken.whole.at_once == broken.apart[-1] > 0.0
    assert max(broken.apart) < 3.0
    result = broken.solved_again(monkeypatch, at_once=1e4)
    assert "clock.set" not in {message.code for message in result.messages}


def test_a_clock_that_was_set_is_told_where_no_side_alone_answers(
    broken: Broken, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of planes that are given in the frame of a scan on the other side. Seen: not a word of it. Mutations: none; that one
    side is used.
    """
    monkeypatch.setattr(page, "_of_one_side", lambda *_: None)
    result = broken.solved_again(monkeypatch)
    said = {message.code: message.text for message in result.messages}
    assert "one of the two clocks was set, or the mount slipped, between" in said["clock.set"]
    assert "neither part alone gives an answer, so all of it is used" in said["clock.set"]
    assert result.quality.scans_used > 0.9 * len(broken.recording.scans)
