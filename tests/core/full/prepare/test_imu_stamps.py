"""Jitter on the stamps of a whole recording: what is said, what may be asked for instead, and what it does to the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.events import LogEvent
from calib_core.full.prepare.imu_stamps import _in_words, as_taken
from calib_core.imu.sampling import Sampling
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth, prepare
from calib_core.simulate.imu import exact_readings, measure
from calib_core.simulate.motion import seconds
from calib_core.types import FloatArray, ImuData, Recording

JITTER_S = 0.002


def _said(recording: Recording, settings: CalibrateSettings) -> tuple[Recording, float, list[str]]:
    heard: list[LogEvent] = []
    taken, line = as_taken(
        recording, settings, lambda event: heard.append(event) if isinstance(event, LogEvent) else None
    )
    assert {event.code for event in heard} <= {"imu.sampling"}
    assert (line.mean_std_s > 0.0) == (line.rate_std_ppm > 0.0)
    return taken, line.mean_std_s, [event.text for event in heard]


def _jittered(recording: Recording, seed: int = 0) -> tuple[Recording, FloatArray]:
    """The same readings with stamps that are wrong by up to 2 ms, and by how much [s]."""
    imu = recording.imu
    wrong_ns = np.rint(np.random.default_rng(seed).uniform(-JITTER_S, JITTER_S, len(imu.stamps_ns)) * 1e9).astype(
        np.int64
    )
    wrong_s = np.asarray(wrong_ns * 1e-9, dtype=np.float64)
    return replace(recording, imu=replace(imu, stamps_ns=imu.stamps_ns + wrong_ns)), wrong_s


def test_even_stamps_are_not_touched_and_nothing_is_said(noisy: tuple[Recording, Truth]) -> None:
    """Mutation: let the line's rounding into every recording, or tell everyone of no jitter."""
    taken, std_s, said = _said(noisy[0], CalibrateSettings())
    assert taken is noisy[0]
    assert (std_s, said) == (0.0, [])


def test_stamps_that_jitter_are_found_and_either_reading_can_be_asked_for(noisy: tuple[Recording, Truth]) -> None:
    """Mutation: ignore one of the settings, or leave the mean of the jitter out."""
    jittered, wrong_s = _jittered(noisy[0])
    taken, std_s, said = _said(jittered, CalibrateSettings())
    left_s = (taken.imu.stamps_ns - noisy[0].imu.stamps_ns) * 1e-9
    assert np.std(left_s) < 0.1 * np.std(wrong_s)
    # By a dense twin: a straight line through independent errors, its own error where the rates change.
    rates = noisy[0].imu.gyro_rad_s
    weight = np.sum((rates[10:] - rates[:-10]) ** 2, axis=1)
    line = np.column_stack([np.ones(len(left_s)), np.arange(len(left_s))])
    at = (weight / weight.sum()) @ line[5:-5]
    line_std_s = JITTER_S / np.sqrt(3.0) * float(np.sqrt(at @ np.linalg.solve(line.T @ line, at)))
    assert line_std_s > 1.05 * JITTER_S / np.sqrt(3.0 * len(left_s))
    assert 0.95 * line_std_s < std_s < 1.3 * line_std_s
    assert len(said) == 1
    assert "jitter by 1.1 ms, but the sampling does not" in said[0]
    assert "sampled evenly, every 10 ms" in said[0]
    assert _said(jittered, CalibrateSettings(imu_sampling="as-stamped"))[:2] == (jittered, 0.0)
    forced = _said(jittered, CalibrateSettings(imu_sampling="even"))
    assert (forced[0].imu.stamps_ns == taken.imu.stamps_ns).all()
    assert forced[2][0].endswith("as asked")


def test_readings_taken_when_the_stamps_say_keep_them(noisy: tuple[Recording, Truth]) -> None:
    """A sensor polled by a busy host, by the simulator's own readings at those instants. Mutation: always even."""
    simulation = prepare(noisy[1].scenario, seed=3)
    even_ns = simulation.imu_messages.true_ns
    rng = np.random.default_rng(1)
    polled_ns = even_ns + np.rint(rng.uniform(-JITTER_S, JITTER_S, len(even_ns)) * 1e9).astype(np.int64)
    imu, truth = simulation.scenario.imu, simulation.truth
    polled = exact_readings(truth.imu(seconds(polled_ns)), truth.gravity_m_s2)
    read = measure(imu, polled_ns, polled, (np.zeros(3), np.zeros(3)), rng)
    recording = replace(noisy[0], imu=ImuData(truth.epoch_ns + polled_ns, read.gyro_rad_s, read.accel_m_s2, "/imu"))
    taken, std_s, said = _said(recording, CalibrateSettings())
    assert taken is recording
    assert std_s == 0.0
    assert len(said) == 1
    assert "the stamps of /imu jitter by 1.1 ms, and so does the sampling" in said[0]
    assert len(_said(recording, CalibrateSettings(imu_sampling="even"))[0].imu.stamps_ns) == len(even_ns)


def test_asking_for_an_even_row_where_there_is_none_is_answered(noisy: tuple[Recording, Truth]) -> None:
    """Mutation: say nothing, and leave a person to believe that it was done."""
    imu = noisy[0].imu
    few = replace(noisy[0], imu=ImuData(imu.stamps_ns[:60], imu.gyro_rad_s[:60], imu.accel_m_s2[:60], "/imu"))
    taken, std_s, said = _said(few, CalibrateSettings(imu_sampling="even"))
    assert (taken, std_s) == (few, 0.0)
    assert "fit no even sampling" in said[0]


def test_stamps_in_no_row_are_said_to_be_even_when_nobody_asked(noisy: tuple[Recording, Truth]) -> None:
    """Steps of 2 to 18 ms, each by itself. Mutation: say it only to those who asked for an even row."""
    imu = noisy[0].imu
    steps_ns = np.rint(np.random.default_rng(3).uniform(2e6, 18e6, len(imu.stamps_ns))).astype(np.int64)
    uneven = replace(noisy[0], imu=replace(imu, stamps_ns=imu.stamps_ns[0] + np.cumsum(steps_ns)))
    taken, std_s, said = _said(uneven, CalibrateSettings())
    assert taken is uneven
    assert std_s == 0.0
    assert said == ["the stamps of /imu/data fit no even sampling: each reading is taken to be sampled at its stamp"]


@pytest.mark.parametrize(
    ("beta", "std", "in_rows", "compared", "words"),
    [
        (0.01, 0.02, 1.0, 600, "but the sampling does not (1.0 ± 2.0 %"),
        (0.30, 0.03, 1.0, 600, "less than half of this is in the sampling itself (30.0 ± 3.0 %"),
        (0.70, 0.03, 1.0, 600, "more than half of this is in the sampling itself (70.0 ± 3.0 %"),
        (0.98, 0.03, 1.0, 600, "and so does the sampling (98.0 ± 3.0 %"),
        (6.60, 0.10, 1.0, 600, "fit neither sampling at the stamps nor even sampling (660.0 ± 10.0 %"),
        (0.40, 0.20, 1.0, 600, "cannot be told from this motion"),
        (0.50, np.inf, 1.0, 0, "too few readings come without a loss to tell"),
        (0.01, 0.02, 0.88, 600, "every 10 ms, except 12 % of them, whose stamps fit no even sampling"),
    ],
)
def test_what_is_said_is_what_was_found(beta: float, std: float, in_rows: float, compared: int, words: str) -> None:
    """Mutations: any two of the sentences exchanged."""
    stamps = np.arange(3, dtype=np.int64)
    found = Sampling(stamps, in_rows, 0.01, 1e-3, beta, std, compared, 1e-5, 1e-5)
    assert words in _in_words(found, "/imu", forced=False)


def test_jitter_costs_the_answer_its_mean_and_no_more(noisy: tuple[Recording, Truth]) -> None:
    """Ideal sensors, so that nothing else takes it up, against the answer of the same readings with true stamps: fast motion,
    where 1.2 ms is 20 times the gyroscope's noise.

    Mutations: solve with the stamps as they are; leave the mean's variance out of the time offset's.
    """
    jittered, wrong_s = _jittered(noisy[0])
    result = calibrate(jittered, CalibrateSettings(intrinsics="off", crispness=False)).result
    plain = calibrate(noisy[0], CalibrateSettings(intrinsics="off", crispness=False)).result
    assert result.T_imu_lidar is not None
    assert plain.T_imu_lidar is not None
    assert result.uncertainty is not None
    assert plain.uncertainty is not None
    std = np.sqrt(np.diag(np.array(plain.uncertainty.covariance)))
    T, T_plain = np.array(result.T_imu_lidar.matrix), np.array(plain.T_imu_lidar.matrix)
    assert (np.abs(T[:3, 3] - T_plain[:3, 3]) < 1.0 * std[3:6]).all()
    assert np.linalg.norm(T[:3, :3] - T_plain[:3, :3]) < 1.0 * np.linalg.norm(std[:3])
    # What is left of the jitter on the line, where the rate changes fast, is what the offset cannot be told from.
    left_s = (_said(jittered, CalibrateSettings())[0].imu.stamps_ns - noisy[0].imu.stamps_ns)[1:] * 1e-9
    weight = np.sum(np.diff(noisy[0].imu.gyro_rad_s, axis=0) ** 2, axis=1)
    moved_s = float(weight @ left_s / weight.sum())
    assert result.time_offset_s is not None
    assert plain.time_offset_s is not None
    stated_s = float(np.sqrt(np.array(result.uncertainty.covariance)[6, 6]))
    mean_std_s = _said(jittered, CalibrateSettings())[1]
    assert mean_std_s > float(np.std(wrong_s) / np.sqrt(len(wrong_s)))
    assert stated_s == pytest.approx(np.hypot(std[6], mean_std_s), rel=0.05)
    assert abs(moved_s) > 3.0 * std[6]
    assert abs(result.time_offset_s - plain.time_offset_s + moved_s) < 1.0 * std[6]
    assert [message.code for message in result.messages].count("imu.sampling") == 1
