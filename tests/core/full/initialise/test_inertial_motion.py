"""What the IMU felt of the lidar's motion: steps summed in closed form, leaps of turns counted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from calib_core.full.initialise.inertial_motion import GyroAndSteps, GyroTurning, TrackCheck, leaps
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.initialise.start import RotationStart
from calib_core.full.initialise.time_offset import GyroTurns
from calib_core.full.odometry.register import ScanMotion
from calib_core.geometry import exp, log

RATE = np.array([0.3, -0.2, 0.4])
IMU_S = np.arange(0.0, 3.0, 0.005)
R_C = exp(np.array([0.4, -1.1, 0.7]))
ROTATION = RotationStart(0.0, R_C, np.zeros(3), 0.0, 1.0, None)


def _turning() -> GyroTurning:
    gyro = GyroTurns(IMU_S, np.tile(R_C @ RATE, (len(IMU_S), 1)))
    return GyroTurning(gyro, ROTATION, 0)


def test_steps_add_up_either_way_and_end_where_one_is_not_known() -> None:
    """Mutations: the sign of the way back; one step for several; a gap skipped."""
    nothing = np.zeros(3)
    at = [ScanMotion(k, np.eye(3), nothing, nothing, nothing) for k in range(5)]
    felt = GyroAndSteps(
        _turning(), {0: np.array([1.0, 0.0, 0.0]), 1: np.array([0.0, 2.0, 0.0]), 3: np.array([0.0, 0.0, 4.0])}
    )
    np.testing.assert_array_equal(felt.step([at[0]], 2), [1.0, 2.0, 0.0])
    np.testing.assert_array_equal(felt.step([at[0], at[2]], 0), [-1.0, -2.0, 0.0])
    assert felt.step([at[1]], 3) is None
    assert felt.step([at[4]], 2) is None
    assert felt.step([at[1]], 1) is None
    assert _turning().step([at[0]], 1) is None
    np.testing.assert_allclose(felt.between(0, 10**9), exp(RATE), atol=1e-9)


def test_the_longest_run_between_faults_is_the_sound_stretch() -> None:
    """Faults after the motions 3, 9 and 15 of 20: those from 4 to 9, or with one after 4 as well those from 10 to 15. Both kinds
    count. Mutations: leaps alone, steps alone; cut before what went wrong; the last stretch left out.
    """
    nothing = np.zeros(3)
    motions = [ScanMotion(k, np.eye(3), nothing, nothing, nothing) for k in range(20)]

    def stretch(leapt: list[int], astray: list[int]) -> list[int]:
        wrong = np.isin(np.arange(19), astray)
        steps: Any = SimpleNamespace(step=np.arange(19), astray=wrong)
        return [m.position for m in TrackCheck(ROTATION, steps, motions, np.array(leapt, np.int64)).sound_stretch]

    assert stretch([3], [9, 15]) == [4, 5, 6, 7, 8, 9]
    assert stretch([3, 4, 15], [9]) == [10, 11, 12, 13, 14, 15]
    assert stretch([], [7]) == list(range(8, 20))
    assert stretch([], []) == list(range(20))


def test_turns_are_told_of_spans_in_which_the_imu_was_not_silent() -> None:
    """Readings from 0 to 3 s but for half a second: before and after it, whichever way round, and nothing of a span that shares
    any of it, or ends after them. Mutations: only the recording's ends asked; the silence's ends in the wrong order.
    """
    imu_s = IMU_S[(IMU_S <= 1.0) | (IMU_S >= 1.5)]
    turning = GyroTurning(GyroTurns(imu_s, np.tile(R_C @ RATE, (len(imu_s), 1))), ROTATION, 0)
    spans_ms = {(200, 900): True, (900, 200): True, (1600, 2800): True, (900, 1100): False, (1700, 1400): False}
    for (start_ms, end_ms), told in {**spans_ms, (2800, 3100): False}.items():
        turned = turning.between(start_ms * 10**6, end_ms * 10**6)
        assert (turned is not None) is told
        if turned is not None:
            np.testing.assert_allclose(turned, exp(1e-3 * (end_ms - start_ms) * RATE), atol=1e-9)


def test_leaps_are_turns_that_the_gyroscope_has_not_felt() -> None:
    """Twenty scans at a constant rate, one pose from the tenth on turned by twice what is allowed: one leap; none between
    bridged scans. Mutations: the lidar's turn taken the other way; bridged scans count.
    """
    run: Any = SimpleNamespace(
        recording=SimpleNamespace(imu=SimpleNamespace(gyro_rad_s=np.tile(R_C @ RATE, (len(IMU_S), 1)))),
        clocks=SimpleNamespace(imu_s=IMU_S, scan_s=0.1 * np.arange(20), lidar_epoch_ns=0),
    )
    aside = exp(np.array([0.0, 2.0 * AGREEING.leap_rad, 0.0]))
    nothing = np.zeros(3)
    for share, expected in ((1.0, [9]), (0.0, [])):
        motions = [
            ScanMotion(k, exp(0.1 * k * RATE) @ (aside if k >= 10 else np.eye(3)), nothing, RATE, nothing, share)
            for k in range(20)
        ]
        np.testing.assert_array_equal(leaps(run, motions, ROTATION), expected)
        np.testing.assert_array_equal(_leaps_one_by_one(run, motions), expected)


def _leaps_one_by_one(run: Any, motions: list[ScanMotion]) -> list[int]:
    """The twin: turn after turn, as the tracker asks for them."""
    turning, found = GyroTurning.of(run, ROTATION), []
    for k in range(len(motions) - 1):
        one, other = motions[k], motions[k + 1]
        felt = turning.between(one.position * 100_000_000, other.position * 100_000_000)
        if felt is not None and min(one.share, other.share) > 0:
            turned = np.linalg.norm(log(felt.T @ one.R.T @ other.R))
            found += [k] if turned > AGREEING.leap_rad else []
    return found


def test_leaps_are_told_within_the_gyroscope_recording_alone() -> None:
    """Every second motion of a track that outlasts the IMU by a second stands still: leaps all over, but for where nothing was
    felt. Mutation: spans told that leave the recording.
    """
    run: Any = SimpleNamespace(
        recording=SimpleNamespace(imu=SimpleNamespace(gyro_rad_s=np.tile(R_C @ RATE, (len(IMU_S), 1)))),
        clocks=SimpleNamespace(imu_s=IMU_S, scan_s=0.1 * np.arange(40), lidar_epoch_ns=0),
    )
    nothing = np.zeros(3)
    motions = [
        ScanMotion(k, exp((0.1 * k + (4.0 * AGREEING.leap_rad if k % 2 else 0.0)) * RATE), nothing, RATE, nothing)
        for k in range(40)
    ]
    found = leaps(run, motions, ROTATION)
    np.testing.assert_array_equal(found, _leaps_one_by_one(run, motions))
    assert 20 < len(found) < 30
