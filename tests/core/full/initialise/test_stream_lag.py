"""The lag of turns of which each is known by itself: closed-form rates, some of them told badly about one axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.initialise.agreement import agreement_of
from calib_core.full.initialise.rotation import fit_lags
from calib_core.full.initialise.settings import AGREEING, VECTORS
from calib_core.full.initialise.stream_lag import lags_by_vectors
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns
from calib_core.geometry import log
from tests.core.full.initialise.late_gyroscope import LAG_S, R_C, late_gyroscope, turning_rate

START_S = np.arange(0.0, 12.0, 0.2)


def _half_blind() -> LidarTurns:
    """Of every second turn the component about one axis is anything: one plane tells the two others."""
    rng = np.random.default_rng(3)
    rate = turning_rate(START_S + 0.05) + rng.normal(0.0, 0.02, (len(START_S), 3))
    up = np.array([0.6, 0.0, 0.8])
    rate[::2] += rng.normal(0.0, 0.7, (len(rate[::2]), 1)) * up
    worth = np.where(np.arange(len(rate)) % 2 == 0, 1.0 / 0.03**2, 1.0 / 0.004**2)
    return LidarTurns(START_S, START_S + 0.1, rate, worth)


def test_three_axes_tell_the_lag_where_sizes_do_not() -> None:
    """The sizes are spoilt by the blind turns, and go together nowhere as those of one body do.

    Mutation: every turn counts alike (`worth=None`).
    """
    turns, (imu_s, gyro) = _half_blind(), late_gyroscope()
    assert agreement_of(turns, imu_s, gyro).correlation < AGREEING.trusted
    lags = lags_by_vectors(turns, imu_s, gyro)
    assert abs(lags[0][0] - LAG_S) < 0.03
    assert lags[0][1] > VECTORS.alike
    best = fit_lags(turns, GyroTurns(imu_s, gyro), lags)[0]
    assert abs(best.time_offset_s - LAG_S) < 0.01
    assert np.degrees(np.linalg.norm(log(R_C.T @ best.R_imu_lidar))) < 2.0
    assert lags_by_vectors(replace(turns, worth=None), imu_s, gyro)[0][1] < VECTORS.alike


def test_another_motion_is_not_believed() -> None:
    """The same kind of swinging at other tempos, at the best of all lags. Mutation: no share in common is asked for."""
    turns = LidarTurns(START_S, START_S + 0.1, turning_rate(START_S + 0.05))
    for tempo in (0.55, 0.8, 1.3, 1.9):
        found = lags_by_vectors(turns, *late_gyroscope(tempo))
        assert found[0][1] < VECTORS.alike


def test_a_gyroscope_in_other_units_is_as_much_alike() -> None:
    """So that the unit is named later on, not the planes blamed. Mutation: divide by the lidar's size alone."""
    imu_s, gyro = late_gyroscope()
    turns = LidarTurns(START_S, START_S + 0.1, turning_rate(START_S + 0.05))
    for unit in (1.0, 180.0 / np.pi, np.pi / 180.0):
        lag_s, alike = lags_by_vectors(turns, imu_s, unit * gyro)[0]
        assert abs(lag_s - LAG_S) < 0.03
        assert alike > 0.99


def test_too_few_turns_say_nothing() -> None:
    """Mutation: compare whatever is there: three turns fit any rotation."""
    few = slice(0, 10)
    assert (
        lags_by_vectors(LidarTurns(START_S[few], START_S[few] + 0.1, turning_rate(START_S[few])), *late_gyroscope())
        == []
    )
