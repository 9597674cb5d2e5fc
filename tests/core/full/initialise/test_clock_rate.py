"""Clocks that run at different rates, told by turns: motions in closed form, stamps that part."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.initialise.clock_rate import (
    ClocksApart,
    OffsetLine,
    is_line,
    line_of_a_part,
    offset_line,
    require_one_rate,
)
from calib_core.full.initialise.start import LidarTrack
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.types import FloatArray

R_C = exp(np.array([0.4, -1.1, 0.7]))
OFFSET_S, SWEEP_S = 0.031, 0.1
NOISE_RAD_S = 0.01


def _swung(t_s: FloatArray) -> FloatArray:
    """(N, 3) turn of the lidar [rad], of tempos that never come together again."""
    hz = np.array([[0.31, 0.83], [0.47, 0.71], [0.39, 1.07]])
    phase = 2.0 * np.pi * t_s[:, None, None] * hz
    return np.sum(np.array([0.2, 0.08]) * np.sin(phase + np.arange(6.0).reshape(3, 2)), axis=2)


def _turns(duration_s: float, noise_rad_s: float = NOISE_RAD_S, until_s: float = np.inf) -> LidarTurns:
    """What a lidar sees of it, sweep by sweep, so much off until then and a hundredth of a radian a second from then on."""
    start_s = np.arange(0.0, duration_s, SWEEP_S)
    rate = log(np.swapaxes(exp(_swung(start_s)), 1, 2) @ exp(_swung(start_s + SWEEP_S))) / SWEEP_S
    std_rad_s = np.where(start_s < until_s, noise_rad_s, NOISE_RAD_S)
    rate += std_rad_s[:, None] * np.random.default_rng(5).normal(size=rate.shape)
    return LidarTurns(start_s, start_s + SWEEP_S, rate)


def _rates(lidar_s: FloatArray) -> FloatArray:
    """(N, 3) what the gyroscope reads at these instants of the lidar's clock."""
    h = 1e-5
    turned = log(np.swapaxes(exp(_swung(lidar_s - h)), 1, 2) @ exp(_swung(lidar_s + h))) / (2.0 * h)
    return np.asarray(turned @ R_C.T)


def _apart(duration_s: float, rate: float, step_s: float = 0.0) -> tuple[FloatArray, GyroTurns]:
    """Stamps that the contract's line takes to the lidar's clock, and set by step_s in the middle."""
    lidar_s, middle_s = np.arange(-2.0, duration_s + 2.0, 0.005), 0.5 * duration_s
    imu_s = lidar_s - OFFSET_S - rate * (lidar_s - middle_s) + step_s * (lidar_s > 0.4 * duration_s)
    return imu_s, GyroTurns(imu_s, _rates(lidar_s))


def _near(turns: LidarTurns, rate: float = 0.0) -> OffsetLine:
    return OffsetLine(OFFSET_S, rate, 0.5 * float(turns.start_s[0] + turns.end_s[-1]), R_C, np.zeros(3))


@pytest.mark.parametrize("rate", [0.0, 3e-5, 1e-3, -3e-3])
def test_offset_and_rate_of_half_a_minute_are_those_put_in_within_their_sigma(rate: float) -> None:
    """Oracle: the stamps' own line. Mutations: the rate's sign; times not counted from the middle."""
    turns, (_, gyro) = _turns(30.0), _apart(30.0, rate)
    line = offset_line(turns, gyro, _near(turns))
    assert line is not None
    assert abs(line.rate - rate) < 4.0 * line.rate_std
    assert line.rate_std < 5e-5
    assert abs(line.offset_s - OFFSET_S) < 1e-3
    assert np.degrees(np.linalg.norm(log(R_C.T @ line.R_imu_lidar))) < 0.3


def test_the_rates_sigma_is_what_the_rates_of_many_draws_scatter_by() -> None:
    """Oracle: chi-square with 60 degrees of freedom: one draw in a thousand is beyond 0.55 and 1.6. Mutation: half the sigma."""
    found = []
    for seed in range(60):
        turns, (_, gyro) = _turns(15.0), _apart(15.0, 1e-3)
        noise = NOISE_RAD_S * np.random.default_rng(100 + seed).normal(size=turns.rate_rad_s.shape)
        line = offset_line(LidarTurns(turns.start_s, turns.end_s, turns.rate_rad_s + noise), gyro, _near(turns))
        assert line is not None
        found.append((line.rate, line.rate_std / np.sqrt(2.0)))  # half of the noise is the same in all draws
    rates, stds = np.array(found).T
    assert 0.55 < np.var(rates) / np.mean(stds**2) < 1.6


def test_one_per_cent_over_two_minutes_is_found_though_no_lag_fits_the_whole() -> None:
    """The offset goes from -0.57 to 0.63 s, and the end goes with the gyroscope best. Oracle: the stamps' own line. Mutations: a
    part's offset for the whole's; its first part for its best.
    """
    turns, (imu_s, gyro) = _turns(120.0, 0.25, until_s=110.0), _apart(120.0, 1e-2)
    line = line_of_a_part(turns, gyro, imu_s)
    assert line is not None
    assert abs(line.rate - 1e-2) < 4.0 * line.rate_std
    assert is_line(turns, gyro, line)


@pytest.mark.parametrize("step_s", [0.01, -0.04])
def test_a_clock_that_was_set_is_no_rate(step_s: float) -> None:
    """It has one beyond all chance, as a line. Mutations: no step asked beside the line; the line beside no slope alone."""
    turns, (_, gyro) = _turns(30.0), _apart(30.0, 0.0, step_s)
    line = offset_line(turns, gyro, _near(turns))
    assert line is not None
    assert abs(line.rate) > 6.0 * line.rate_std
    assert not is_line(turns, gyro, line)


def test_a_rate_is_a_line() -> None:
    """Mutation: any step is nearer."""
    turns, (_, gyro) = _turns(30.0), _apart(30.0, 1e-3)
    line = offset_line(turns, gyro, _near(turns))
    assert line is not None
    assert is_line(turns, gyro, line)


def test_turns_that_are_not_the_gyroscopes_have_no_line() -> None:
    """They are off by a quarter of the motion. Mutation: the best part of them, however little it goes with the gyroscope."""
    imu_s, gyro = _apart(30.0, 1e-2)
    assert line_of_a_part(_turns(30.0, 0.17), gyro, imu_s) is None


@pytest.mark.parametrize(
    ("rate", "step_s", "noise_rad_s", "is_apart"),
    [(1e-3, 0.0, NOISE_RAD_S, True), (-1e-3, 0.0, NOISE_RAD_S, True), (1.5e-4, 0.0, 1e-3, False),
     (1e-3, 0.0, 0.1, False), (0.0, 0.04, NOISE_RAD_S, False)],
)  # fmt: skip
def test_clocks_part_beyond_crystals_and_chance_along_a_line(
    rate: float, step_s: float, noise_rad_s: float, is_apart: bool
) -> None:
    """Otherwise the joint estimation finds a rate, and where a clock was set is told elsewhere. The stamp about which they part
    is the middle's. Oracle: the stamps' own line. Mutations: less than crystals do; chance; a step; about the lidar's stamp.
    """
    turns, (imu_s, _) = _turns(30.0, noise_rad_s), _apart(30.0, rate, step_s)
    # Turns within the sweeps alone: from scan to scan it stands still.
    still = np.zeros_like(turns.rate_rad_s)
    R, unseen = np.tile(np.eye(3), (len(still), 1, 1)), np.zeros((len(still), 3, 3))
    track = LidarTrack(turns.start_s, turns.end_s - turns.start_s, R, still, turns.rate_rad_s, still, unseen)
    run: Any = SimpleNamespace(
        settings=CalibrateSettings(),
        clocks=SimpleNamespace(imu_s=imu_s, imu_epoch_ns=7, middle_s=15.0),
        recording=SimpleNamespace(imu=SimpleNamespace(gyro_rad_s=_rates(np.arange(-2.0, 32.0, 0.005)))),
    )
    if not is_apart:
        require_one_rate(run, track)
        return
    with pytest.raises(ClocksApart) as apart:
        require_one_rate(run, track)
    assert abs(apart.value.rate - rate) < 2.0 * apart.value.rate_std
    assert abs(apart.value.about_ns - 7 - 1e9 * (15.0 - OFFSET_S)) < 1e6
