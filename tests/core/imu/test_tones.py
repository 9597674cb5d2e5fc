"""Tones in the readings: made by the formula, taken out again, and their derivatives differenced."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.imu.preintegration import UpsampledImu
from calib_core.imu.tones import PARAMETERS, attitudes, in_other_room, tone_columns, tone_readings, without_tone
from calib_core.types import FloatArray

KNOTS, H_S, ZERO_S, HZ = 41, 0.01, 0.13, 7.0


def _case(seed: int) -> tuple[UpsampledImu, FloatArray, FloatArray]:
    """Readings that stand still, attitudes at the knots, and a tone's values."""
    rng = np.random.default_rng(seed)
    links = KNOTS - 1
    readings = UpsampledImu(
        H_S * np.arange(KNOTS), H_S, np.zeros((links, 4, 3)), np.zeros((links, 4, 3)),
        np.zeros((KNOTS, 3)), np.zeros((KNOTS, 3)), np.zeros((links, 6)), np.ones(links, bool),
    )  # fmt: skip
    values = rng.normal(size=PARAMETERS)
    values[-1] *= 0.1
    return readings, Rotation.random(KNOTS, random_state=seed).as_matrix(), values


def test_a_tone_is_what_two_sines_make_of_it() -> None:
    """Written out sine by sine. Mutations: sine for cosine; the room's axes turned the other way; its own frequency left out."""
    _, R, values = _case(1)
    t = np.linspace(-0.4, 0.7, KNOTS)
    got = tone_readings(HZ, values, t, R)
    for k in range(KNOTS):
        s, c = np.sin(2 * np.pi * (HZ + values[24]) * t[k]), np.cos(2 * np.pi * (HZ + values[24]) * t[k])
        for sensor in (0, 1):
            own = s * values[3 * sensor : 3 * sensor + 3] + c * values[6 + 3 * sensor : 9 + 3 * sensor]
            room = s * values[12 + 3 * sensor : 15 + 3 * sensor] + c * values[18 + 3 * sensor : 21 + 3 * sensor]
            np.testing.assert_allclose(got[k, 3 * sensor : 3 * sensor + 3], own + R[k].T @ room, atol=1e-12)


def test_every_parameters_column_is_its_difference() -> None:
    """Mutations: the frequency's column with the signs of its two halves exchanged; the room's columns by R for its transpose."""
    readings, R, values = _case(2)
    at = attitudes(readings, R, ZERO_S)
    columns = tone_columns(HZ, values, at)
    assert columns.shape == (KNOTS - 1, 6, PARAMETERS)
    for k in range(PARAMETERS):
        step = np.zeros(PARAMETERS)
        step[k] = 1e-6
        plus, minus = (tone_readings(HZ, values + sign * step, at.middles_s, at.in_links) for sign in (1.0, -1.0))
        np.testing.assert_allclose(columns[:, :, k], (plus - minus) / 2e-6, atol=1e-7)


def test_taken_out_is_gone_wherever_the_readings_are_asked() -> None:
    """Mutations: Gauss points half a link late; knots left as they are; the tone added."""
    readings, _, values = _case(3)
    steady = np.tile(Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), (KNOTS, 1, 1))
    calm = without_tone(readings, HZ, values, attitudes(readings, steady, ZERO_S))
    np.testing.assert_allclose(
        np.concatenate([calm.knot_gyro, calm.knot_accel], axis=1),
        -tone_readings(HZ, values, readings.knots_s - ZERO_S, steady),
        atol=1e-12,
    )
    # Gauss's rule of two points on a half link each integrates the tone to what Simpson's does on a fine grid.
    fine = np.linspace(readings.knots_s[0], readings.knots_s[-1], 8001)
    whole = tone_readings(HZ, values, fine - ZERO_S, np.tile(steady[0], (len(fine), 1, 1)))
    weight = np.tile([2.0, 4.0], 4000)
    weight = np.append(weight, 1.0)
    weight[0] = 1.0
    expected = -(weight @ whole) * (fine[1] - fine[0]) / 3.0
    got = np.concatenate([calm.gyro, calm.accel], axis=2).mean(axis=1).sum(axis=0) * H_S
    np.testing.assert_allclose(got, expected, atol=1e-5)


def test_another_map_frame_hears_the_same() -> None:
    """Mutation: turn the room's axes the other way, or the IMU's own too."""
    _, R, values = _case(4)
    turn = Rotation.from_rotvec([0.4, 1.1, -0.6]).as_matrix()
    t = np.linspace(0.0, 1.0, KNOTS)
    there = tone_readings(HZ, in_other_room(values, turn), t, turn.T @ R)
    np.testing.assert_allclose(there, tone_readings(HZ, values, t, R), atol=1e-12)
