"""Whether the IMU has read a tone: against sines that were put into its readings, or were not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.full.joint import tone_heard, tones
from calib_core.full.joint.estimation import Estimation
from calib_core.full.joint.schedule import FULL
from calib_core.full.joint.sensor_state import SensorState
from calib_core.full.joint.state import no_bins
from calib_core.full.joint.tone_choice import Explaining
from calib_core.full.joint.tone_heard import goes_on_at_rest, is_heard, is_in_standstill, loudest_near
from calib_core.full.joint.tones import admit_rest, admit_tones, with_tone
from tests.core.full.joint.conftest import Half

HZ = 23.0


def _toned(half: Half, accel_m_s2: float) -> Estimation:
    """With a tone of the accelerometer's x axis of this amplitude, and of the gyroscope's, which nobody has read in any case."""
    state = with_tone(half.data, half.state, HZ, FULL.tones)
    values = np.zeros(25)
    values[3], values[0] = accel_m_s2, 0.2
    return replace(state, estimate=replace(state.estimate, sensors=SensorState(state.nuisance, values)))


def _shaken(half: Half, accel_m_s2: float) -> Half:
    """Whose readings have it."""
    run = half.data.run
    accel = run.recording.imu.accel_m_s2.copy()
    accel[:, 0] += accel_m_s2 * np.sin(2.0 * np.pi * HZ * run.clocks.imu_s)
    imu = replace(run.recording.imu, accel_m_s2=accel)
    return replace(half, data=replace(half.data, run=replace(run, recording=replace(run.recording, imu=imu))))


@pytest.mark.parametrize(
    ("claimed", "read", "heard"), [(5.0, 0.0, False), (5.0, 4.5, True), (5.0, 0.5, False), (0.5, 5.0, True)]
)
def test_what_is_taken_out_of_readings_is_in_them(half: Half, claimed: float, read: float, heard: bool) -> None:
    """Either sensor's suffices: what the other one adds is hardly known. Mutations: asked at another frequency; the gyroscope's
    alone; less than what was read told for none."""
    shaken = _shaken(half, read)
    assert is_heard(shaken.data, _toned(half, claimed)) == heard


@pytest.mark.parametrize(
    ("hz", "claimed", "at_rest", "scatter", "seen"),
    [
        (0.5, 1.0, 0.0, 0.01, False),  # what a hand moves by, taken for a tone
        (0.5, 1.0, 1.0, 0.01, True),
        (0.5, 1.0, -1.0, 0.01, False),  # as large, and against it
        (0.5, 1.0, 0.6, 0.01, True),  # its size is not known yet
        (0.5, 0.01, 0.0, 0.05, True),  # chance may hide it
        (0.05, 0.02, 0.0, 0.01, True),  # and of so slow a one a bias what is left
        (0.5, 0.5, 0.0, 0.0, False),  # readings of a step that noise does not reach
    ],
)
def test_a_slow_tone_goes_on_through_a_standstill(
    hz: float, claimed: float, at_rest: float, scatter: float, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen: two parallel walls of a room chosen, 3.5 m/s2 of a hand's motion along them taken out as a tone of 0.43 Hz, and an
    answer 7.7 of its sigmas off.   Oracle: sines of known size in the readings of three seconds at rest.

    Mutations: the size without the sign; no room for chance; the mean left in; every channel alike; no floor under the scatter; a
    standstill before the first knot; none.
    """
    rng = np.random.default_rng(5)
    imu_s = np.arange(0.0, 20.0, 0.005)
    still = slice(0, 600)
    sine = np.sin(2.0 * np.pi * hz * imu_s)
    values = np.zeros((len(imu_s), 6))
    values[:, :3] = 5.0 * scatter * rng.normal(size=(len(imu_s), 3))  # another sensor's unit
    values[:, 3:] = scatter * rng.normal(size=(len(imu_s), 3)) + np.array([-0.3, 0.0, 9.8])
    values[:, 3] += claimed * sine
    values[still, 3] += (at_rest - claimed) * sine[still]
    monkeypatch.setattr(tone_heard, "longest_still", lambda *_: still)
    imu = SimpleNamespace(gyro_rad_s=values[:, :3], accel_m_s2=values[:, 3:])
    noise = SimpleNamespace(sample_std=np.full(6, 0.001))
    run = SimpleNamespace(recording=SimpleNamespace(imu=imu), clocks=SimpleNamespace(imu_s=imu_s), noise=noise)
    data: Any = SimpleNamespace(run=run)
    knots_s = np.arange(0.0, 20.0, 0.01)
    tone = np.zeros((len(knots_s), 6))
    tone[:, 3] = claimed * np.sin(2.0 * np.pi * hz * knots_s)
    assert is_in_standstill(data, knots_s, tone) == seen
    assert is_in_standstill(data, knots_s + 100.0, tone)  # a standstill before the first knot tells nothing
    monkeypatch.setattr(tone_heard, "longest_still", lambda *_: None)
    assert is_in_standstill(data, knots_s, tone)


@pytest.mark.parametrize(
    ("slow_hz", "shaken", "goes_on"), [(30.0, False, False), (30.0, True, True), (2.0, False, True)]
)
def test_only_what_is_as_slow_as_a_hand_is_looked_for_in_a_standstill(
    half: Half, slow_hz: float, shaken: bool, goes_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rotor that starts later shakes faster. Mutations: whatever its frequency; an engine that is heard; never; at the wrong
    time."""
    loud = _shaken(half, 5.0)
    knots_s = loud.data.readings.knots_s
    monkeypatch.setattr(tone_heard, "is_in_standstill", lambda _, at_s, __: not np.allclose(at_s, knots_s[: len(at_s)]))
    run = replace(loud.data.run, noise=replace(loud.data.run.noise, shaken=shaken))
    assert goes_on_at_rest(replace(loud.data, run=run), _toned(half, 5.0), slow_hz) == goes_on


@pytest.mark.parametrize("away_hz", [0.0, 0.6, -0.9, 3.0])
def test_the_loudest_sine_nearby_is_told_by_its_amplitude_beside_a_hand(away_hz: float) -> None:
    """Stamps that jitter, a hand's slow and far larger motion, a tone whose axes turn with the IMU. Oracle: the amplitude put in.

    Mutation: everything counts as near.
    """
    rng = np.random.default_rng(3)
    times_s = np.sort(np.arange(4000) * 5e-3 + 1e-4 * rng.normal(size=4000))
    hand = 3.0 * np.sin(2.0 * np.pi * 0.8 * times_s)[:, None] + np.array([0.0, 0.0, 9.8])
    sine = 0.3 * np.sin(2.0 * np.pi * (HZ + away_hz) * times_s)[:, None] * np.array([0.6, 0.0, 0.8])
    told = loudest_near(times_s, hand + sine, HZ)
    if abs(away_hz) < 1.0:
        assert told == pytest.approx(0.3, rel=0.03)
    else:
        assert told < 0.02


@pytest.mark.parametrize(("beside_m_s2", "near"), [(0.3, True), (0.0, False)])
def test_neither_gravity_nor_a_sway_passes_for_a_slow_tone(beside_m_s2: float, near: bool) -> None:
    """At two hertz, of twenty seconds. Mutations: no taper; the mean left in."""
    times_s = np.arange(4000) * 5e-3
    sway = 3.0 * np.sin(2.0 * np.pi * 0.31 * times_s)
    accel = np.stack([sway, beside_m_s2 * np.sin(2.0 * np.pi * 2.0 * times_s), np.full(4000, 9.8)], axis=1)
    told = loudest_near(times_s, accel, 2.0)
    assert told == pytest.approx(0.3, rel=0.03) if near else told < 0.003
    assert loudest_near(times_s, accel[:, 2:], 0.9) < 0.003


def test_a_slow_tone_that_is_not_in_a_standstill_is_left_in_the_readings(
    half: Half, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As what happens once is: the error bars count it. Mutations: admitted all the same, while planes are judged or at rest; the
    search merely ends."""
    monkeypatch.setattr(
        tones, "found_tones", lambda _, state, *__, **___: [] if state.untuned else [Explaining(HZ, 900.0)]
    )
    monkeypatch.setattr(tones, "told", lambda _data, state, *_: _toned(half, 5.0) if state.nuisance.tones_hz else state)
    monkeypatch.setattr(tones, "goes_on_at_rest", lambda *_: False)
    loud, rules = _shaken(half, 5.0).data, FULL.tones
    for after in (
        admit_tones(loud, half.state, rules, FULL.sensors, FULL.sampling, least=50.0),
        admit_rest(loud, half.state, rules, FULL.sensors, FULL.sampling, no_bins(0.0)),
    ):
        assert after.untuned
        assert after.nuisance.tones_hz == ()


def test_a_tone_that_nobody_read_is_not_admitted(half: Half, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutations: admitted all the same, while planes are judged or at rest."""
    found = [Explaining(HZ, 900.0)]
    monkeypatch.setattr(tones, "found_tones", lambda *_, **__: found)
    monkeypatch.setattr(tones, "told", lambda _data, state, *_: _toned(half, 5.0) if state.nuisance.tones_hz else state)
    bins, rules = no_bins(0.0), FULL.tones
    assert admit_tones(half.data, half.state, rules, FULL.sensors, FULL.sampling, least=50.0) is half.state
    assert admit_rest(half.data, half.state, rules, FULL.sensors, FULL.sampling, bins) is half.state
    shaken = _shaken(half, 5.0)
    after = admit_rest(shaken.data, half.state, rules, FULL.sensors, FULL.sampling, bins)
    assert after.nuisance.tones_hz == (HZ,)
