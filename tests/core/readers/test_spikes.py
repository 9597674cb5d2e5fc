"""Damaged readings of an IMU, among those of a body that moves, is struck, is shaken or rests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.readers.imu.spikes import spikes
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray
from tests.core.readers import build

RATE_HZ = 100.0
T_S = np.arange(3000) / RATE_HZ


def _moved(seed: int = 0, *, noise: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """(3000, 3) each: a hand's motion of some hertz, with a sensor's noise."""
    rng = np.random.default_rng(seed)
    hz, phase = np.array([0.7, 1.3, 2.9]), rng.uniform(0, 6, 3)
    swing = np.sin(2 * np.pi * hz * T_S[:, None] + phase)
    gyro = 0.6 * swing + noise * rng.normal(0, 0.002, (len(T_S), 3))
    return gyro, 3.0 * swing + np.array([0, 0, 9.81]) + noise * rng.normal(0, 0.02, (len(T_S), 3))


@pytest.mark.parametrize(("channel", "size"), [(0, 3.0), (2, -0.8), (4, 30.0), (5, -4.0)])
def test_a_lone_leap_is_found(channel: int, size: float) -> None:
    """Those and no others, also two of them three readings apart. Mutations: one sensor not looked at; the usual leap by
    the largest."""
    readings = np.hstack(_moved())
    damaged = np.array([400, 403, 777, 2500])
    readings[damaged, channel] += size
    found = spikes(readings[:, :3], readings[:, 3:])
    assert np.flatnonzero(found).tolist() == damaged.tolist()


@pytest.mark.parametrize("case", ["moved", "at rest", "shaken", "struck", "a coarse sensor", "like that", "few"])
def test_what_a_body_does_is_no_damage(case: str) -> None:
    """Mutations: no share beyond which a sensor is like that; the neighbours not asked (a blow that swings on); no least leap
    (a coarse sensor's steps at rest)."""
    gyro, accel = _moved(3)
    rng = np.random.default_rng(1)
    match case:
        case "at rest":
            gyro, accel = rng.normal(0, 0.002, gyro.shape), rng.normal(0, 0.02, accel.shape)
        case "shaken":
            accel += 20.0 * np.sin(2 * np.pi * 47.3 * T_S)[:, None]
        case "struck":
            for at in (300, 900, 1500):
                after = T_S[: len(T_S) - at]
                accel[at:] += (25.0 * np.exp(-after / 0.02) * np.cos(2 * np.pi * 30.0 * after))[:, None]
        case "a coarse sensor":
            gyro = np.round(rng.normal(0, 0.0026, gyro.shape) / 0.0175) * 0.0175
            accel = np.round(rng.normal(0, 0.02, accel.shape) / 0.15) * 0.15
        case "like that":
            accel[np.flatnonzero(rng.random(len(T_S)) < 0.015)] += 30.0
        case "few":
            gyro, accel = gyro[:40], accel[:40]
            accel[20] += 30.0
        case _:
            pass
    assert not spikes(gyro, accel).any()


def test_a_recording_is_read_without_them_and_says_so(tmp_path: Path) -> None:
    """Mutation: told and kept."""
    messages = build.still_imu(4.2, cdr=True)
    whole = load(
        build.write_ros2(tmp_path / "whole", build.in_order(build.velodyne_messages(40, cdr=True), messages)),
        ReadSettings(),
    )
    topic, kind, at_ns, _ = messages[200]
    struck = build.imu_message(at_ns - 500_000, (0.0, 5.0, 0.0), (0.0, 0.0, 60.0), cdr=True)
    damaged = [*messages[:200], (topic, kind, at_ns, struck), *messages[201:]]
    read = load(
        build.write_ros2(tmp_path / "r", build.in_order(build.velodyne_messages(40, cdr=True), damaged)), ReadSettings()
    )
    assert len(read.imu.stamps_ns) == len(whole.imu.stamps_ns) - 1
    assert np.abs(read.imu.gyro_rad_s).max() < 1.0
    told = {f.code: f.text for f in read.findings}
    assert told["imu.spikes"].startswith("1 of ")
    assert "imu.spikes" not in {f.code for f in whole.findings}
