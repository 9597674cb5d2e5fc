"""The turning over time offsets around an answer: closed-form rates whose lag is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.full.initialise.offset_profile import offset_profile
from calib_core.full.initialise.settings import PROFILE
from calib_core.full.initialise.start import LidarTrack
from calib_core.geometry import exp
from calib_core.result import OffsetProfile
from calib_core.types import FloatArray
from tests.core.full.initialise.late_gyroscope import LAG_S, late_gyroscope, turning_rate

START_S = np.arange(0.0, 12.0, 0.1)


def _track(rate_rad_s: FloatArray) -> LidarTrack:
    """Sweeps of 0.1 s, each with the rate of its middle."""
    R = np.empty((len(START_S), 3, 3))
    R[0] = np.eye(3)
    for k in range(len(START_S) - 1):
        R[k + 1] = R[k] @ exp(0.1 * rate_rad_s[k])
    nothing = np.zeros((len(START_S), 3))
    return LidarTrack(START_S, np.full(len(START_S), 0.1), R, nothing, rate_rad_s, nothing, np.zeros_like(R))


def _profile(answer_s: float) -> OffsetProfile:
    found = offset_profile(_track(turning_rate(START_S + 0.05)), *late_gyroscope(), answer_s)
    assert found is not None
    return found


def test_it_is_highest_at_the_true_offset_wherever_the_answer_is() -> None:
    """Mutations: the answer's sign, best_s without the parabola, measured from zero instead of the answer."""
    for wrong_s in (0.0, 0.034, -0.127):
        found = _profile(LAG_S + wrong_s)
        assert abs(found.best_s + wrong_s) < 1e-3
        values = np.array([np.nan if value is None else value for value in found.likeness])
        assert len(values) == 1 + round(2 * PROFILE.reach_s / PROFILE.step_s)
        at = found.first_s + found.step_s * np.arange(len(values))
        assert abs(at[np.nanargmax(values)] + wrong_s) <= found.step_s
        assert 0.99 < np.nanmax(values) <= 1.0
        assert np.nanmin(values) < 0.8


def test_nothing_is_told_without_a_sign_of_its_own() -> None:
    """Mutation: a shift of less than is written, either way, is told as it is rounded: "-0.0 ms"."""
    found = [_profile(LAG_S + wrong_s) for wrong_s in np.linspace(-2e-4, 2e-4, 17)]
    nothing = [each for each in found if -5e-5 < each.best_s < 0.0]
    assert nothing
    assert all("is at +0.0 ms" in each.text for each in nothing)


def _meant(answer_s: float, tempo: float = 1.0, noise: float = 0.0) -> str:
    rate = turning_rate(START_S + 0.05, tempo) + noise * np.random.default_rng(4).normal(size=(len(START_S), 3))
    found = offset_profile(_track(rate), *late_gyroscope(tempo), answer_s)
    assert found is not None
    return found.text.split("ms", maxsplit=1)[1]


def test_a_clear_peak_agrees_or_disagrees_and_a_flat_one_says_nothing() -> None:
    """The same swings at their tempo and nine times slower, when 0.1 s change the likeness by less than 0.001.

    Mutations: any peak beyond a step disagrees; a flat one at zero agrees; noise does not count.
    """
    assert _meant(LAG_S) == ", which agrees with the answer."
    assert "the rotation rates disagree with the answer" in _meant(LAG_S + 0.08)
    for away_s in (0.0, 0.03, -0.08):
        assert "too smooth to tell the time offset by rotation rates alone" in _meant(LAG_S + away_s, 0.11)
    # 80 ms are within what this noise makes: the same curve, but that its highest value is no longer 1.
    assert "disagree" not in _meant(LAG_S + 0.08, noise=0.4)


def test_a_body_that_hardly_turned_has_none() -> None:
    """Mutation: noise compared with noise."""
    rng = np.random.default_rng(0)
    imu_s, gyro = late_gyroscope()
    assert offset_profile(_track(0.001 * rng.normal(size=(len(START_S), 3))), imu_s, 0.001 * gyro, LAG_S) is None


def test_where_too_little_is_in_common_there_is_no_value() -> None:
    """An answer at the end of what both have seen. Mutation: minus infinity written to the document."""
    imu_s, gyro = late_gyroscope()
    track = _track(turning_rate(START_S + 0.05))
    short = replace(track, start_s=track.start_s + 6.6)
    found = offset_profile(short, imu_s, gyro, LAG_S)
    assert found is not None
    assert None in found.likeness
    assert any(value is not None for value in found.likeness)
    assert offset_profile(replace(track, start_s=track.start_s + 100.0), imu_s, gyro, LAG_S) is None
