"""Readings that are cut to steps: what integrals of them are off by, beside what is said."""

from __future__ import annotations

import numpy as np

from calib_core.gp.regression import Hyper
from calib_core.imu.preintegration import NoiseDensity, UpsampledImu, upsample
from calib_core.imu.quantisation import allowed_for_steps, coarse_density2, coarse_text, resolution
from calib_core.types import FloatArray, ImuData

STEP = 0.05
PERIOD_S = 0.01


def _imu(accel: FloatArray, gyro: FloatArray | None = None) -> ImuData:
    stamps_ns = np.rint(np.arange(len(accel)) * PERIOD_S * 1e9).astype(np.int64)
    rng = np.random.default_rng(0)
    return ImuData(stamps_ns, 1e-3 * rng.standard_normal(accel.shape) if gyro is None else gyro, accel)


def _density2(accel: FloatArray) -> FloatArray:
    return coarse_density2(np.arange(len(accel)) * PERIOD_S, _imu(accel))


def _linked(imu: ImuData) -> UpsampledImu:
    t = np.arange(len(imu.stamps_ns)) * PERIOD_S
    hyper = Hyper(np.full(6, 0.2), np.ones(6), np.full(6, 0.01))
    up = upsample(t, imu.gyro_rad_s, imu.accel_m_s2, np.arange(0.0, t[-1], 2 * PERIOD_S), hyper)
    return allowed_for_steps(up, t, coarse_density2(t, imu))


def test_integrals_over_stays_are_off_by_as_much_as_links_allow() -> None:
    """300 sensors at rest for a second, each at a place of its own between steps: chi-square of what their integrals are off by.

    Mutations: of white noise of a reading's own; a uniform law of half the width; a step's whole width for its error.
    """
    rng = np.random.default_rng(1)
    normal = []
    for _ in range(300):
        force = rng.uniform(-1.0, 1.0, 3) + np.zeros((101, 3))
        force[-1] += STEP  # so that it has a step at all
        read = np.rint(force / STEP) * STEP
        off = (read - force)[:100].sum(axis=0) * PERIOD_S
        density2 = _density2(read)[:100, 3:] + STEP**2 / 12.0 * PERIOD_S
        normal.append(off / np.sqrt(density2.sum(axis=0) * PERIOD_S))
    # 99.9 % of the mean of 900 squares of uniform laws, whose fourth moment is 1.8.
    assert abs(np.mean(np.square(normal)) - 1.0) < 3.3 * np.sqrt(0.8 / 900)


def test_links_take_the_mean_of_their_readings_and_read_ones_that_move_add_nothing() -> None:
    """Mutations: the sum in the place of the mean; added to the link before."""
    accel = np.rint(np.outer(np.arange(200), [1.0, 2.0, 3.0])) * STEP
    accel[100:121, 1] = accel[100, 1]
    more = _linked(_imu(accel)).excess_density2 - _linked(_imu(accel + np.arange(200)[:, None])).excess_density2
    assert np.flatnonzero(more.any(axis=0)).tolist() == [4]
    assert np.flatnonzero(more[:, 4]).tolist() == list(range(50, 61))
    stays = (2.0 * STEP) ** 2 / 12.0 * 0.2
    assert np.allclose(more[50:60, 4], stays)
    assert np.allclose(more[60, 4], 0.5 * stays)


def test_what_noise_takes_over_many_steps_is_white_already() -> None:
    """A sensor whose noise is its step. Mutation: stays counted though their readings differ by a step."""
    rng = np.random.default_rng(2)
    accel = np.rint(rng.standard_normal((5000, 3))) * STEP
    assert np.all(_density2(accel)[:, 3:].mean(axis=0) < 0.1 * STEP**2 * PERIOD_S)


def test_steps_coarser_than_noise_are_said_and_those_of_round_off_are_none() -> None:
    """Mutations: said of any steps; the gyroscope's unit; the wrong sensor."""
    t = np.arange(5000) * PERIOD_S
    rng = np.random.default_rng(3)
    noise = NoiseDensity(np.full(3, 1e-4), np.full(3, 1e-3))
    force = np.sin(0.5 * t)[:, None] * [1.0, 0.5, 0.2] + 1e-3 * rng.standard_normal((5000, 3))
    turns = np.sin(0.4 * t)[:, None] * [0.1, 0.2, 0.3] + 1e-4 * rng.standard_normal((5000, 3))
    coarse = _imu(np.rint(force / STEP) * STEP, turns)
    assert "the accelerometer's readings come in steps of 0.05 m/s²" in coarse_text(t, coarse, noise)
    assert "gyroscope" not in coarse_text(t, coarse, noise)
    step = np.radians(0.5)
    coarse = _imu(force, np.rint(turns / step) * step)
    assert "the gyroscope's readings come in steps of 0.5 deg/s, and stay" in coarse_text(t, coarse, noise)
    assert coarse_text(t, _imu(force, turns), noise) == ""
    assert coarse_text(t, _imu(np.rint(force / 1e-3) * 1e-3, turns), noise) == ""
    assert np.array_equal(resolution(np.array([[1.0, 2.0], [1.5, 2.0], [4.0, 2.0]])), [0.5, 0.0])
