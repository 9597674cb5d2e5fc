"""How well turns tell a rotation, and what the tracker makes of it, against drawn turns whose rotation is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib_core.full.initialise.inertial_guide import _no_surer
from calib_core.full.initialise.inertial_motion import GyroAndSteps, GyroTurning, OwnTurns, Unturned
from calib_core.full.initialise.rotation import fit_lags
from calib_core.full.initialise.start import RotationStart
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns
from calib_core.full.odometry.register import Registered, register
from calib_core.full.odometry.settings import TrackSettings
from calib_core.full.odometry.track import track
from calib_core.full.planes.propose import find_reference, named_planes
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import Truth
from calib_core.types import FloatArray, Recording
from tests.core.full.tracks import TrueTurning

PERIOD_S = 0.1
TURNS = 200
R_C = exp(np.array([0.4, -1.1, 0.7]))
BIAS = np.array([0.01, -0.02, 0.005])
NOISE_RAD_S = 0.03


def _lasting(rng: np.random.Generator, alike: float) -> FloatArray:
    """(TURNS, 3) of unit size, neighbours correlated by so much."""
    out = rng.standard_normal((TURNS, 3))
    for k in range(1, TURNS):
        out[k] = alike * out[k - 1] + np.sqrt(1.0 - alike**2) * out[k]
    return out


def _drawn(seed: int, alike: float) -> RotationStart:
    """The start by a hand's turns of 0.4 rad/s about each axis, wrong by what is so much alike."""
    rng = np.random.default_rng(seed)
    return _start(0.4 * _lasting(rng, 0.8), NOISE_RAD_S * _lasting(rng, alike))


def _start(rate: FloatArray, wrong: FloatArray) -> RotationStart:
    """The start by turns at rates (TURNS, 3) that the lidar tells wrong by so much."""
    start_s, imu_s = PERIOD_S * np.arange(TURNS), np.arange(0.0, TURNS * PERIOD_S + 0.005, 0.001)
    gyro = rate[np.minimum((imu_s / PERIOD_S + 1e-6).astype(int), TURNS - 1)] @ R_C.T + BIAS
    turns = LidarTurns(start_s, start_s + PERIOD_S, rate + wrong)
    (found,) = fit_lags(turns, GyroTurns(imu_s, gyro), [(0.0, 1.0)])
    return found


@pytest.mark.parametrize(
    ("alike", "rotation", "bias"), [(0.0, (0.65, 1.15), (0.7, 1.3)), (0.8, (0.35, 1.0), (0.8, 1.7))]
)
def test_a_rotation_and_a_bias_are_off_by_what_is_stated(
    alike: float, rotation: tuple[float, float], bias: tuple[float, float]
) -> None:
    """Over 60 drawings of 20 s, as means of 180 squares in units of what is stated, which for the rotation's worst axis is rather
    too much.

    Mutations: noise of three axes taken for one's; what lasts for half a second counts scan by scan; the bias without its own
    noise.
    """
    found = [_drawn(seed, alike) for seed in range(60)]
    turned = np.mean([np.sum(log(R_C.T @ f.R_imu_lidar) ** 2) / (3.0 * f.std_rad**2) for f in found])
    shifted = np.mean([np.sum((f.gyro_bias - BIAS) ** 2) / (3.0 * f.bias_std_rad_s**2) for f in found])
    assert rotation[0] < turned < rotation[1]
    assert bias[0] < shifted < bias[1]


def test_turns_about_one_axis_tell_next_to_nothing_of_the_rest() -> None:
    """Mutation: of the axes that tell best."""
    rng = np.random.default_rng(1)
    rate = 0.4 * _lasting(rng, 0.8)[:, :1] * np.array([0.0, 0.0, 1.0])
    found = _start(rate, 1e-3 * rng.standard_normal((TURNS, 3)))
    assert found.std_rad > 10 * _drawn(0, 0.0).std_rad * 1e-3 / NOISE_RAD_S


def test_turns_are_as_sure_as_the_rotation_they_are_made_with() -> None:
    """Mutations: a bias counts as long as it lasts not at all; what is led by steps is as unsure as ever; none tell nothing."""
    start = RotationStart(0.0, R_C, BIAS, 0.1, 1.0, None, std_rad=0.02, bias_std_rad_s=0.003)
    assert start.turn_std_rad(0.5, 0.1) == pytest.approx(0.01 + 0.0003)
    imu_s = np.arange(0.0, 1.0, 0.01)
    turning = GyroTurning(GyroTurns(imu_s, np.zeros((100, 3))), start, 0)
    assert turning.turn_std_rad(0.5, 0.1) == GyroAndSteps(turning, {}).turn_std_rad(0.5, 0.1) == pytest.approx(0.0103)
    assert Unturned().turn_std_rad(0.0, 0.1) == OwnTurns().turn_std_rad(0.0, 0.1) == np.inf
    assert replace(start, std_rad=np.pi, bias_std_rad_s=1.0) == RotationStart(0.0, R_C, BIAS, 0.1, 1.0, None)


def test_what_leads_itself_is_no_surer_for_it() -> None:
    """Mutations: as sure as it says; never surer than before."""
    before = RotationStart(0.0, R_C, BIAS, 0.1, 1.0, None, std_rad=0.1, bias_std_rad_s=0.01)
    again = _no_surer(replace(before, std_rad=0.001, bias_std_rad_s=0.02), before)
    assert again.std_rad == pytest.approx(0.1 / np.sqrt(2.0), rel=0.01)
    assert again.bias_std_rad_s == 0.02


class _Sure(TrueTurning):
    """The true turns, said to be wrong by so much of what they turn."""

    of_turn = 0.0

    def turn_std_rad(self, turn_rad: float, _over_s: float, /) -> float:
        return self.of_turn * turn_rad


@pytest.mark.parametrize("of_turn", [0.0, 0.05, np.inf])
def test_a_scan_is_held_to_its_turn_by_how_sure_that_is(
    noisy: tuple[Recording, Truth], monkeypatch: pytest.MonkeyPatch, of_turn: float
) -> None:
    """No closer than a lag lets it, and no looser than a mounting that is roughly known.

    Mutations: held as ever; as if nothing could be wrong with a turn; a rate held as its turn.
    """
    recording, truth = noisy
    s, ties = TrackSettings(), dict[int, FloatArray]()

    def spy(*arguments: Any, tie: FloatArray, position: int, **options: Any) -> Registered:
        ties[position] = tie.copy()
        return register(*arguments, tie=tie, position=position, **options)

    monkeypatch.setattr("calib_core.full.odometry.track.register", spy)
    scans = recording.scans[30:35]
    _, fits = find_reference(scans, CalibrateSettings())
    turning = _Sure(truth, coasts=False)
    turning.of_turn = of_turn
    track(scans, named_planes(fits), 0, turning=turning)
    for position in range(1, 5):
        turn = log(turning.between(scans[position - 1].stamp_ns, scans[position].stamp_ns))
        span_ns = int(scans[position].points["offset_ns"].max())
        rate = log(turning.between(scans[position].stamp_ns, scans[position].stamp_ns + span_ns)) / (span_ns * 1e-9)
        period_s = (scans[position].stamp_ns - scans[position - 1].stamp_ns) * 1e-9
        longer = max(1.0, period_s / s.tie_s) ** 0.5
        turn_std = min(0.01 * longer, np.hypot(0.002 * longer, of_turn * np.linalg.norm(turn)))
        rate_std = min(0.1, np.hypot(0.03, of_turn * np.linalg.norm(rate)))
        np.testing.assert_allclose(ties[position][:3], 1 / turn_std**2, rtol=1e-3)
        np.testing.assert_allclose(ties[position][6:9], 1 / rate_std**2, rtol=1e-3)
