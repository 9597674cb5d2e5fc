"""A motion that repeats itself: every round of it is as good a match, and the stamps tell which is meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.events import Event, LogEvent, never_cancel
from calib_core.full.initialise.initialise import initialise, of_the_turns_lag
from calib_core.full.initialise.rotation import acceleration_start, fit_lags, rotation_start
from calib_core.full.initialise.start import LidarTrack, LinearStart, RotationStart, Start
from calib_core.full.initialise.stream_lag import lags_by_vectors
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, generate
from calib_core.simulate.motion import Sway, Wave
from calib_core.types import FloatArray
from tests.core.full.joint.conftest import true_motions

R_C = exp(np.array([0.4, -1.1, 0.7]))
ROUND_S = 2.5
SWEEP_S = 0.1


def _swung(t_s: FloatArray, slow: float = 1.0) -> FloatArray:
    """(N, 3) turn of the lidar [rad], two tempos an axis, which all go into a round: the same after each, and not before."""
    phase = 2.0 * np.pi * t_s[:, None] / ROUND_S * slow
    once, more = np.array([1.0, 2.0, 1.0]), np.array([2.0, 3.0, 4.0])
    return 0.2 * np.sin(phase * once + np.array([0.0, 1.0, 2.0])) + 0.1 * np.sin(
        phase * more + np.array([2.0, 0.0, 1.0])
    )


def _track(first_s: float, last_s: float, slow: float = 1.0) -> LidarTrack:
    start_s = np.arange(first_s, last_s, SWEEP_S)
    R, after = exp(_swung(start_s, slow)), exp(_swung(start_s + SWEEP_S, slow))
    rate = log(np.swapaxes(R, 1, 2) @ after) / SWEEP_S
    still = np.zeros((len(start_s), 3))
    return LidarTrack(start_s, np.full(len(start_s), SWEEP_S), R, still, rate, still, np.zeros_like(R))


def _gyro(first_s: float, last_s: float, slow: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Stamps, the lidar's own clock, and rates in the IMU's axes."""
    t, h = np.arange(first_s, last_s, 0.005), 1e-5
    turned = log(np.swapaxes(exp(_swung(t - h, slow)), 1, 2) @ exp(_swung(t + h, slow))) / (2.0 * h)
    return t, turned @ R_C.T


@pytest.mark.parametrize("offset_s", [0.031, -0.9, 1.1])
@pytest.mark.parametrize("longer_s", [0.0, 12.0])
def test_the_round_nearest_to_the_stamps_is_taken_and_the_others_are_named(offset_s: float, longer_s: float) -> None:
    """Oracle: the round's own length. The IMU may go on before and after for many rounds, more than are tried.

    Mutations: the best by residual first; the nearest peaks not among those that are tried; the nearest alone.
    """
    stamps_s, rates = _gyro(-longer_s, 20.0 + longer_s)
    rates += 1e-3 * np.random.default_rng(3).normal(size=rates.shape)
    best, *_ = rotation_start(_track(0.0, 20.0), stamps_s - offset_s, rates)
    assert abs(best.time_offset_s - offset_s) < 5e-3
    assert np.degrees(np.linalg.norm(log(R_C.T @ best.R_imu_lidar))) < 0.5
    rounds = (np.array(best.repeats_s) - best.time_offset_s) / ROUND_S
    assert len(rounds) >= 3
    np.testing.assert_allclose(rounds, np.round(rounds), atol=5e-3)
    assert np.abs(np.round(rounds)).min() == 1


def test_turns_that_are_told_each_by_itself_have_the_nearest_round_among_their_lags_too() -> None:
    """Oracle: the round's own length. Mutation: the most alike alone, which lie five rounds away."""
    stamps_s, rates = _gyro(-12.0, 32.0)
    track = _track(0.0, 20.0)
    turns = LidarTurns(track.start_s, track.start_s + SWEEP_S, track.omega_rad_s)
    rates += 1e-3 * np.random.default_rng(3).normal(size=rates.shape)
    lags = lags_by_vectors(turns, stamps_s - 0.031, rates)
    assert min(abs(lag_s - 0.031) for lag_s, _ in lags) < 0.03
    best, *_ = fit_lags(turns, GyroTurns(stamps_s - 0.031, rates), lags)
    assert abs(best.time_offset_s - 0.031) < 5e-3


def _slid(t_s: FloatArray) -> FloatArray:
    """(N, 3) where a rail that never turns has the lidar [m], over and over."""
    phase = 2.0 * np.pi * t_s[:, None] / ROUND_S
    amplitude_m, more_m = np.array([0.3, 0.2, 0.1]), np.array([0.05, 0.06, 0.04])
    return amplitude_m * np.sin(phase + np.array([0.0, 1.0, 2.0])) + more_m * np.sin(2.0 * phase)


@pytest.mark.parametrize("offset_s", [0.031, -0.9])
def test_a_rail_that_goes_to_and_fro_without_turning_has_rounds_too(offset_s: float) -> None:
    """By its accelerations alone. Oracle: the round's own length. Mutations: the nearest peaks not tried; the best first;
    a track's ends smoothed beyond, where a lag that leaves one out fits better.
    """
    start_s, h = np.arange(0.0, 20.0, SWEEP_S), 1e-3
    rng = np.random.default_rng(3)
    still, every = np.zeros((len(start_s), 3)), np.repeat(np.eye(3)[None], len(start_s), axis=0)
    seen_m = _slid(start_s) + 5e-4 * rng.normal(size=still.shape)
    speed_m_s = (_slid(start_s + SWEEP_S) - _slid(start_s)) / SWEEP_S
    track = LidarTrack(start_s, np.full(len(start_s), SWEEP_S), every, seen_m, still, speed_m_s, np.zeros_like(every))
    t = np.arange(-40.0, 60.0, 0.005)
    felt = (_slid(t + h) - 2.0 * _slid(t) + _slid(t - h)) / h**2 + np.array([0.0, 0.0, 9.8])
    felt = felt @ R_C.T + 0.02 * rng.normal(size=felt.shape)
    best, *_ = acceleration_start(track, t - offset_s, felt)
    assert abs(best.time_offset_s - offset_s) < 0.02
    rounds = (np.array(best.repeats_s) - best.time_offset_s) / ROUND_S
    assert len(rounds) >= 2
    np.testing.assert_allclose(rounds, np.round(rounds), atol=0.02)
    assert np.abs(np.round(rounds)).min() == 1


def test_accelerations_tell_the_rotation_without_what_no_plane_has_seen() -> None:
    """Two walls tell no height: what the track has of it is false. The rotation is that of what is seen, and exact.

    Mutations: the track's heights believed; what is not seen taken for zero (no `fillings`).
    """
    start_s, h = np.arange(0.0, 20.0, SWEEP_S), 1e-3
    rng = np.random.default_rng(5)
    every = np.repeat(np.eye(3)[None], len(start_s), axis=0)
    up = np.array([0.48, 0.6, 0.64])
    seen_m = _slid(start_s) + 5e-4 * rng.normal(size=(len(start_s), 3))
    seen_m += np.cumsum(0.05 * rng.normal(size=len(start_s)))[:, None] * up
    speed_m_s, unseen = (_slid(start_s + SWEEP_S) - _slid(start_s)) / SWEEP_S, np.outer(up, up) + np.zeros_like(every)
    track = LidarTrack(start_s, np.full(len(start_s), SWEEP_S), every, seen_m, np.zeros_like(seen_m), speed_m_s, unseen)
    t = np.arange(-5.0, 25.0, 0.005)
    felt = (_slid(t + h) - 2.0 * _slid(t) + _slid(t - h)) / h**2 + np.array([0.0, 0.0, 9.8])
    felt = felt @ R_C.T + 0.02 * rng.normal(size=felt.shape)
    best, *_ = acceleration_start(track, t - 0.031, felt)
    assert abs(best.time_offset_s - 0.031) < 0.02
    assert np.degrees(np.linalg.norm(log(R_C.T @ best.R_imu_lidar))) < 2.0


def test_a_slow_motion_is_no_repetition_of_itself() -> None:
    """A match that is nearly as good a quarter of a second beside is no round: the best is taken, however far from the stamps.

    Mutation: what lies between the two lags not looked at: 1.44 s in place of 1.87.
    """
    stamps_s, rates = _gyro(-5.0, 25.0, slow=0.02)
    rates += 2e-3 * np.random.default_rng(3).normal(size=rates.shape)
    track = _track(0.0, 20.0, slow=0.02)
    rng = np.random.default_rng(4)
    noisy = replace(track, omega_rad_s=track.omega_rad_s + 0.004 * rng.normal(size=track.omega_rad_s.shape))
    best, *others = rotation_start(noisy, stamps_s - 1.87, rates)
    assert min(other.residual for other in others) < 1.15 * best.residual  # nearly as good
    assert best.residual <= min(other.residual for other in others)
    assert best.repeats_s == ()


def _rounds(motion: Sway, tempo_hz: float) -> Sway:
    """The motion at tempos that all go into one."""

    def at_tempo(wave: Wave) -> Wave:
        return replace(wave, frequency_hz=tempo_hz * max(1, round(wave.frequency_hz / tempo_hz)))

    position = tuple(tuple(at_tempo(wave) for wave in axis) for axis in motion.position)
    turns = tuple(replace(turn, waves=tuple(at_tempo(wave) for wave in turn.waves)) for turn in motion.turns)
    return replace(motion, position=position, turns=turns)


def test_a_machine_that_does_the_same_over_and_over_is_said() -> None:
    """Without a standstill nothing else tells the rounds apart. Oracle: simulated truth, 4 s a round.

    Mutations: the best of all linear starts taken; nothing said. Seen: 8.004 s for 0.004, and called calibrated.
    """
    plain = SCENARIOS["no-static-start"]
    assert isinstance(plain.motion, Sway)
    recording, truth = generate(replace(plain, motion=_rounds(plain.motion, 0.25)), seed=1, duration_s=20.0)
    heard: list[Event] = []
    run = prepare(recording, CalibrateSettings(), heard.append, never_cancel)
    motions = true_motions(truth, run.clocks.lidar_epoch_ns, run.clocks.scan_s)
    _, start = initialise(run, motions, truth.planes, None)
    assert abs(start.rotation.time_offset_s - plain.time_offset_s) < 5e-3
    (said,) = [event for event in heard if isinstance(event, LogEvent) and event.code == "start.repeats"]
    assert said.level == "warning"
    assert "4.00 s" in said.text


def test_of_a_motion_that_comes_once_nothing_is_said() -> None:
    """Mutation: any other candidate taken for a round."""
    recording, truth = generate(SCENARIOS["no-static-start"], seed=1, duration_s=12.0)
    heard: list[Event] = []
    run = prepare(recording, CalibrateSettings(), heard.append, never_cancel)
    initialise(run, true_motions(truth, run.clocks.lidar_epoch_ns, run.clocks.scan_s), truth.planes, None)
    assert not [event for event in heard if isinstance(event, LogEvent) and event.code == "start.repeats"]


def _trial(lag_s: float, residual: float, rms: float) -> Start:
    rotation = RotationStart(lag_s, np.eye(3), np.zeros(3), residual, 0.97, None)
    return Start(rotation, LinearStart(np.zeros(3), np.zeros(3), np.zeros(3), rms))


@pytest.mark.parametrize(
    ("other", "lags_s"),
    [
        ((-8.4, 0.086, 1.31), [-0.2]),  # clearly worse of the turns, hardly better of the accelerations
        ((-8.4, 0.054, 1.31), [-0.2, -8.4]),  # the turns tell nothing
        ((-8.4, 0.086, 0.9), [-0.2, -8.4]),  # the accelerations do
        ((-8.4, 0.086, 1.5), [-0.2, -8.4]),  # worse of both: none that would be taken
    ],
)
def test_turns_tell_the_lag_where_accelerations_hardly_do(
    other: tuple[float, float, float], lags_s: list[float]
) -> None:
    """Mutations: accelerations always asked; turns always."""
    kept = of_the_turns_lag([_trial(*other), _trial(-0.2, 0.051, 1.37)])
    assert sorted((t.rotation.time_offset_s for t in kept), reverse=True) == lags_s
