"""Whether two sensors' turning is one: rates in closed form, with every unit, lag and mounting."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.full.initialise import agreement as agreement_module
from calib_core.full.initialise.agreement import Agreement, agreeing_part, agreement, agreement_of
from calib_core.full.initialise.inertial_motion import GyroTurning
from calib_core.full.initialise.settings import AGREEING
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns
from calib_core.geometry import exp, log
from calib_core.types import FloatArray

R_C = np.asarray(Rotation.from_euler("xyz", [40.0, -70.0, 130.0], degrees=True).as_matrix())
LAG_S = -0.37


def _rate(t_s: FloatArray) -> FloatArray:
    """The lidar's rate, (N, 3) [rad/s]."""
    return np.stack([0.6 * np.sin(2.1 * t_s), 0.5 * np.sin(3.3 * t_s + 1.0), 0.4 * np.sin(1.3 * t_s + 2.0)], axis=1)


def _turns(rate: FloatArray, t_s: FloatArray) -> LidarTurns:
    return LidarTurns(t_s, t_s + 0.1, rate)


def _gyro(unit: float) -> tuple[FloatArray, FloatArray]:
    """Stamps on the IMU's clock and readings, 200 Hz, through the mounting."""
    t = np.arange(-1.0, 32.0, 0.005)
    return t - LAG_S, unit * (_rate(t) @ R_C.T)


@pytest.mark.parametrize("unit", [1.0, 180.0 / np.pi, np.pi / 180.0])
def test_rates_in_any_unit_go_together(unit: float) -> None:
    """The mean over 0.1 s of waves below 0.6 Hz is the rate in the middle to 1 %.

    Mutation: do not bring the rates to one size: readings 57 times too small fall below the floor of a variance.
    """
    t = np.arange(0.0, 30.0, 0.1)
    got = agreement_of(_turns(_rate(t + 0.05), t), *_gyro(unit))
    assert got.correlation > 0.99
    assert got.ratio == pytest.approx(unit, rel=0.02)
    assert got.ratio_spread < 0.05


def test_a_lost_track_does_not_agree_whatever_its_ratio() -> None:
    """Turns of noise thirty times as fast as the gyroscope: a correlation that is not believed.

    Mutation: judge by the ratio of percentiles alone (0.03 times as fast).
    """
    t = np.arange(0.0, 30.0, 0.1)
    noise = np.random.default_rng(3).normal(0.0, 12.0, (len(t), 3))
    got = agreement_of(_turns(noise, t), *_gyro(1.0))
    assert got.correlation < AGREEING.believed < AGREEING.trusted


def test_a_few_leaps_leave_the_agreement() -> None:
    """Mutation: no bound on a span's rate: ten leaps of 60 rad/s are all there is to correlate."""
    t = np.arange(0.0, 30.0, 0.1)
    rate = _rate(t + 0.05)
    rate[::30] += 60.0
    assert agreement_of(_turns(rate, t), *_gyro(1.0)).correlation > 0.75


def _track(t_s: FloatArray, lost: FloatArray, *, seed: int) -> LidarTrack:
    """A scan each 0.1 s whose rates and turns are the lidar's, but for those that are lost, (N,) bool, which leap about."""
    rate = _rate(t_s + 0.05)
    rate[lost] = np.random.default_rng(seed).normal(0.0, 3.0, (int(lost.sum()), 3))
    R = [np.eye(3)]
    for each in rate[:-1]:
        R.append(R[-1] @ exp(0.1 * each))
    nowhere = np.zeros((len(t_s), 3))
    return LidarTrack(t_s, np.full(len(t_s), 0.1), np.array(R), nowhere, rate, nowhere, np.zeros((len(t_s), 3, 3)))


def test_the_part_that_agrees_is_found_where_a_track_is_lost_elsewhere() -> None:
    """Somebody stood before the lidar from 12 to 30 s of a half minute; and where nothing agrees, nothing is found.

    Mutations: the first part instead of the best; parts below what is trusted; only the first of the halves and thirds.
    """
    t = np.arange(0.0, 30.0, 0.1)
    late, early = _track(t, t > 12.0, seed=1), _track(t, t < 16.0, seed=2)
    for track, within in ((late, (0.0, 10.0)), (early, (15.0, 30.0))):
        assert agreement(track, *_gyro(1.0)).correlation < AGREEING.trusted
        part, agreed = agreeing_part(track, *_gyro(1.0))
        assert part is not None
        assert within[0] <= part.start_s[0] + 1.1
        assert part.start_s[-1] <= within[1] + 1.1
        assert agreed.correlation > AGREEING.trusted
        assert agreed.ratio_spread < 0.05
        assert len(part.R) == len(part.sweep_s) == len(part.start_s)
    nowhere, _ = agreeing_part(_track(t, np.ones(len(t), np.bool_), seed=3), *_gyro(1.0))
    assert nowhere is None
    short = late.part(slice(50))
    assert agreeing_part(short, *_gyro(1.0))[0] is None


@pytest.mark.parametrize(
    ("ratio", "told"),
    [
        (0.96, True),
        (1.9, True),
        (57.0, True),
        (0.0175, True),
        (0.045, False),
        (2.1, False),
        (20.0, False),
        (0.0, False),
    ],
)
def test_rates_that_go_together_by_chance_are_no_agreement(
    monkeypatch: pytest.MonkeyPatch, ratio: float, told: bool
) -> None:
    """Seen: the leaps at the end of a lost track lay upon a swing 4.7 s away, 0.91 alike and 22 times as fast; the solve set out
    from there and the walls were blamed. Mutations: any ratio is a unit's; a part is taken whatever its ratio."""
    found = Agreement(0.95, ratio, 0.3)
    assert found.is_of_a_unit == told
    monkeypatch.setattr(agreement_module, "agreement", lambda *_: found)
    t = np.arange(0.0, 30.0, 0.1)
    part, _ = agreeing_part(_track(t, np.zeros(len(t), np.bool_), seed=1), *_gyro(1.0))
    assert (part is not None) == told


def test_the_gyroscope_turns_the_lidar() -> None:
    """A constant rate about a skew axis of the lidar for 0.4 s, seen through mounting, lag and bias.

    Mutation: R_c for its transpose, the lag's sign, the bias left in.
    """
    rate, bias = np.array([0.7, -0.4, 0.5]), np.array([0.02, -0.01, 0.03])
    imu_s = np.arange(0.0, 4.0, 0.01)
    gyro = GyroTurns(imu_s, np.tile(R_C @ rate, (len(imu_s), 1)))
    rotation = RotationStart(LAG_S, R_C, bias, 0.0, 1.0, None)
    turning = GyroTurning(gyro, rotation, 10**18)
    turn = turning.between(10**18 + 10**9, 10**18 + 1_400_000_000)
    assert turn is not None
    np.testing.assert_allclose(log(turn), 0.4 * rate, atol=1e-9)
    np.testing.assert_allclose(turn, exp(0.4 * rate), atol=1e-9)
    assert turning.between(10**18 - 10**9, 10**18) is None
    assert turning.between(10**18 + 3 * 10**9, 10**18 + 3_700_000_000) is None  # 4.07 s on the IMU's clock
