"""Readings that were cut off, against what an IMU of a wide range would have read."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib_core.calibrate import calibrate
from calib_core.imu.clipped_readings import unclipped
from calib_core.imu.clipping import cut_off
from calib_core.imu.lost_readings import Restored
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Scenario, generate
from calib_core.simulate.motion import Kinematics, Motion
from calib_core.types import FloatArray, ImuData
from tests.core.full.answers import errors_of

RATE_HZ = 200.0
RANGE_RAD_S, RANGE_M_S2 = 2.18, 19.61


def _imu(gyro_rad_s: FloatArray, accel_m_s2: FloatArray) -> ImuData:
    stamps_ns = (1e9 / RATE_HZ * np.arange(len(gyro_rad_s))).astype(np.int64)
    return ImuData(stamps_ns, gyro_rad_s, accel_m_s2)


def _turning(peak_rad_s: float) -> FloatArray:
    """(600, 3) to and fro about x, twice in three seconds."""
    gyro = np.zeros((600, 3))
    gyro[:, 0] = peak_rad_s * np.sin(2.0 * np.pi * np.arange(600) / 300.0)
    return gyro


def test_a_turn_that_was_cut_off_is_told_by_how_it_went_in_and_came_out() -> None:
    """A tenth over the range: 0.22 rad/s were lost at the peak. Mutations: left as cut; the other way; half of the slopes."""
    true, still = _turning(1.1 * RANGE_RAD_S), np.tile([0.0, 0.0, 9.8], (600, 1))
    found = unclipped(_imu(np.clip(true, -RANGE_RAD_S, RANGE_RAD_S), still))
    assert found is not None
    cut = np.flatnonzero(np.abs(true[:, 0]) > RANGE_RAD_S)
    np.testing.assert_array_equal(found.index, cut)
    np.testing.assert_allclose(found.imu.gyro_rad_s, true, atol=0.03)
    std = np.sqrt(found.variance[:, 0])
    assert (np.abs(found.imu.gyro_rad_s[cut, 0] - true[cut, 0]) < std + 1e-3).all()
    assert std.max() == pytest.approx(0.1 * RANGE_RAD_S, rel=0.15)
    assert not found.variance[:, 1:].any()
    assert set(found.run.tolist()) == {len(cut) // 4}
    np.testing.assert_array_equal(found.imu.accel_m_s2, still)


def test_a_knock_says_nothing_next_to_it_either() -> None:
    """Two readings at one end, two at the other, on one axis, one on another. Nobody knows how hard it was: a line
    stands there, and ten ranges are allowed for. Mutations: three alike on one axis, and at one end, asked for; the neighbours
    trusted; what was read stays.
    """
    accel = np.tile([0.0, 0.0, 9.8], (600, 1))
    accel[300:304, 0] = RANGE_M_S2 * np.array([-1.0, -1.0, 1.0, 1.0])
    accel[301, 1] = -RANGE_M_S2
    found = unclipped(_imu(np.zeros((600, 3)), accel))
    assert found is not None
    np.testing.assert_array_equal(found.index, np.arange(299, 305))
    std = np.sqrt(found.variance)
    expected = np.zeros((6, 6))
    expected[:, 3] = expected[1:4, 4] = 10.0 * RANGE_M_S2
    np.testing.assert_allclose(std, expected)
    np.testing.assert_array_equal(found.imu.accel_m_s2, np.tile([0.0, 0.0, 9.8], (600, 1)))


def test_each_axis_has_an_end_of_its_own() -> None:
    """As a driver's scales and biases leave them: x ends at 19.7 and at -19.4, y at 20.1. Mutation: the farthest end alone."""
    accel = np.tile([0.0, 0.0, 9.8], (600, 1))
    accel[100:103, 0], accel[200:204, 0], accel[300:305, 1] = 19.7, -19.4, 20.1
    found = unclipped(_imu(np.zeros((600, 3)), accel))
    assert found is not None
    np.testing.assert_array_equal(found.index, [*range(99, 104), *range(199, 205), *range(299, 306)])


def test_an_end_nearer_than_any_in_common_use_is_the_end_of_knocks_too() -> None:
    """Of 12 m/s2, which long shoves show: what a knock reads there, one reading or two, and next to it, is not known either.
    Oracle: the readings before they were cut. Mutations: 2 g and more alone; the runs that show it alone.
    """
    rng, t = np.random.default_rng(4), np.arange(600) / RATE_HZ
    accel = 0.02 * rng.normal(size=(600, 3)) + [0.0, 0.0, 9.8]
    accel[:, 0] += 15.0 * np.sin(2.0 * np.pi * 2.0 * t) * (t < 1.0)
    accel[[400, 500, 501], 0] += 30.0
    beyond = np.abs(accel[:, 0]) > 12.0
    found = unclipped(_imu(1e-3 * rng.normal(size=(600, 3)), np.clip(accel, -12.0, 12.0)))
    assert found is not None
    np.testing.assert_array_equal(found.index, np.flatnonzero(np.convolve(beyond, np.ones(3), "same") > 0.0))
    np.testing.assert_allclose(np.sqrt(found.variance[:, 3]), 120.0)


@pytest.mark.parametrize("of", ["whole", "a steady rate", "a peak"])
def test_what_was_not_cut_off_is_left(of: str) -> None:
    """Mutations: any extreme is a range's end; steep edges are enough below ranges in common use."""
    gyro, accel = _turning(1.5), np.tile([0.0, 0.0, 9.8], (600, 1))
    if of == "a steady rate":
        gyro[:, 0] = np.clip(np.abs(np.arange(600) % 300 - 150.0) / 50.0 - 1.5, -1.0, 1.0)
    if of == "a peak":
        accel[300] = [25.0, 12.0, 3.0]
    assert unclipped(_imu(gyro, accel)) is None
    assert not cut_off(accel, 17.6)[0].any()


def test_cut_off_and_lost_readings_are_both_allowed_for() -> None:
    """A lost one before the cut moves its place. Mutation: places of before."""
    whole = _imu(np.zeros((5, 3)), np.zeros((5, 3)))
    kept = ImuData(np.delete(whole.stamps_ns, 1), np.zeros((4, 3)), np.zeros((4, 3)))
    lost = Restored(whole, np.array([1]), np.full((1, 6), 4.0), np.array([1]))
    cut = Restored(kept, np.array([2]), np.full((1, 6), 9.0), np.array([3]))
    both = lost.after(cut)
    assert both.index.tolist() == [1, 3]
    assert both.variance[:, 0].tolist() == [4.0, 9.0]
    assert both.run.tolist() == [1, 3]
    assert lost.after(None) is lost


@dataclass(frozen=True)
class Knocked:
    """A motion with a knock of a quarter of a metre a second at an instant, over in 30 ms."""

    motion: Motion
    at_s: float

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        """With a bump of 4 mm along all three axes, in closed form."""
        calm, width_s, high_m = self.motion.kinematics(t_s), 0.01, 0.004
        u = (t_s - self.at_s) / width_s
        bump = high_m * np.exp(-0.5 * u**2)
        p, v, a = bump, -u * bump / width_s, (u**2 - 1.0) * bump / width_s**2
        along = [each[:, None] * np.ones(3) for each in (p, v, a)]
        return replace(calm, p_m=calm.p_m + along[0], v_m_s=calm.v_m_s + along[1], a_m_s2=calm.a_m_s2 + along[2])


def test_a_knock_that_was_cut_off_leaves_the_answer_where_it_is(short: Scenario) -> None:
    """Of 40 m/s2, of which 2 g are read: 0.2 m/s too few otherwise. Mutations: weighed like any other reading; the line alone."""
    knocked = replace(short, motion=Knocked(short.motion, 3.0), imu=replace(short.imu, rate_hz=200.0))
    recording, truth = generate(knocked, seed=3)
    imu = recording.imu
    clipped = np.clip(imu.accel_m_s2, -RANGE_M_S2, RANGE_M_S2)
    assert np.count_nonzero(np.abs(imu.accel_m_s2) > RANGE_M_S2) >= 5
    given = replace(recording, imu=replace(imu, accel_m_s2=clipped))
    result = calibrate(given, CalibrateSettings(crispness=False)).result
    assert result.status == "calibrated"
    assert result.uncertainty is not None
    errors = errors_of(result, truth)
    assert errors @ np.linalg.solve(np.array(result.uncertainty.covariance), errors) < 24.3
    assert "imu.clipped" in [each.code for each in result.messages]
