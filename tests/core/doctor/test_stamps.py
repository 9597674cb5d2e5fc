"""Stamps that jitter: nothing is missing then, nothing is jerky, and every number is the one that a solve says."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core import api
from calib_core.doctor import DoctorReport
from calib_core.doctor.imu_report import excitation, imu_report
from calib_core.doctor.stamps import stamp_report
from calib_core.doctor.topics import counted_rates
from calib_core.events import LogEvent
from calib_core.full.prepare.prepare import prepare
from calib_core.readers.container.storage import RawMessage, TopicSummary
from calib_core.readers.imu.readings import CleanedImu
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.settings import CalibrateSettings
from calib_core.stamp_rate import rate_hz
from calib_core.types import ImuData, Recording
from tests.core.readers import build

STEP_NS = 10_000_000


def stamps(count: int = 3000) -> np.ndarray:
    return build.EPOCH_NS + STEP_NS * np.arange(count, dtype=np.int64)


def hosts(given: np.ndarray, seed: int) -> np.ndarray:
    """As a host stamps them: late by half a millisecond, one in a hundred by up to seven."""
    rng = np.random.default_rng(seed)
    late = rng.exponential(5e5, len(given)) + np.where(
        rng.random(len(given)) < 0.01, rng.uniform(0, 7e6, len(given)), 0
    )
    return np.maximum.accumulate(given + late.astype(np.int64) + np.arange(len(given)))


@pytest.mark.parametrize("seed", range(3))
def test_what_jitters_is_not_missing_and_what_is_missing_is_counted(seed: int) -> None:
    """Mutation: steps between the stamps as given counted, as it was."""
    late = hosts(stamps(), seed)
    assert int(np.sum(np.diff(late) > 1.6 * STEP_NS)) > 0
    assert stamp_report(late, late).dropped == 0
    lost = np.delete(late, [500, 501, 1200, 2100, *range(2500, 2540)])
    report = stamp_report(lost, lost)
    assert (report.dropped, report.gaps) == (44, 1)
    assert report.rate_hz == pytest.approx(100.0, rel=3e-4)


def test_few_stamps_are_counted_step_by_step() -> None:
    """Ninety, too few for a line. Mutation: nothing counted without one; a spread of steps said to be one of stamps."""
    few = np.delete(stamps(92), [40, 41])
    assert stamp_report(few, few).dropped == 2
    shaken = stamps(90) + np.random.default_rng(0).normal(0.0, 3e5, 90).astype(np.int64)
    assert stamp_report(shaken, shaken).jitter_s == pytest.approx(3e-4, rel=0.3)
    assert (stamp_report(few[:1], few[:1]).dropped, stamp_report(few[:1], few[:1]).rate_hz) == (0, 0.0)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same hand with the IMU's own stamps and with a host's."""
    folder = tmp_path_factory.mktemp("pair")
    for name, faults in (("own", ""), ("host", "stamp-latency")):
        api.simulate("handheld", folder / f"{name}.bag", seed=1, duration_s=12.0, faults=faults)
    return folder / "own.bag", folder / "host.bag"


def test_stamps_change_no_number_of_the_motion(pair: tuple[Path, Path]) -> None:
    """Oracle: the recording whose stamps are the sensor's. Mutations: differences of neighbouring readings over the stamps as
    given (25,000 deg/s2); the noise of readings at those stamps.
    """
    own, host = (api.inspect(bag).imu for bag in pair)
    assert own is not None
    assert host is not None
    assert host.stamps.dropped == own.stamps.dropped == 0
    for name in ("angular_acceleration_peak_deg_s2", "rotation_peak_deg_s", "rotation_rms_deg_s"):
        of_host, of_own = getattr(host.excitation, name), getattr(own.excitation, name)
        assert of_host == pytest.approx(of_own, rel=0.05), name
    assert host.measured_noise is not None
    assert own.measured_noise is not None
    for name in ("gyroscope_noise_density_rad_s_sqrt_hz", "accelerometer_noise_density_m_s2_sqrt_hz"):
        assert getattr(host.measured_noise.noise, name) == pytest.approx(
            getattr(own.measured_noise.noise, name), rel=0.1
        )


def test_stamps_that_no_line_mends_make_no_jerk() -> None:
    """Swings of 30 deg/s at 0.8 Hz, 151 deg/s2 at the most, whose stamps come late: taken as they are. Mutation: differences of
    neighbouring readings over their stamps.
    """
    t = np.arange(3000) * 1e-2
    rates = np.deg2rad(30.0) * np.sin(2 * np.pi * 0.8 * t)[:, None] * np.array([1.0, 0.5, 0.25])
    late = ImuData(hosts(stamps(), 1), rates, np.tile([0.0, 0.0, 9.81], (3000, 1)))
    peaks = excitation(late, ()).angular_acceleration_peak_deg_s2
    assert peaks == pytest.approx([151.0, 75.4, 37.7], rel=0.3)


def solves(recording: Recording) -> tuple[float, float, float]:
    """Jitter [ms] as a solve says it, and the gyroscope's and accelerometer's noise that it uses."""
    said: list[LogEvent] = []
    run = prepare(
        recording, CalibrateSettings(), lambda e: said.append(e) if isinstance(e, LogEvent) else None, lambda: False
    )
    (jitter,) = (float(m[1]) for e in said if (m := re.search(r"jitter by ([\d.]+) ms", e.text)))
    return jitter, run.noise.density.gyro_rad_s_sqrt_hz[0], run.noise.density.accel_m_s2_sqrt_hz[0]


def test_jitter_and_noise_are_those_of_a_solve(pair: tuple[Path, Path]) -> None:
    """Standing still and in motion alone, where jitter makes noise. Mutations: the median deviation of the steps; the noise
    measured at the stamps as given.
    """
    recording = api.load(pair[1], fingerprint=False)
    imu = recording.imu
    moving = imu.stamps_ns > imu.stamps_ns[0] + 4_500_000_000
    cut = replace(
        imu, stamps_ns=imu.stamps_ns[moving], gyro_rad_s=imu.gyro_rad_s[moving], accel_m_s2=imu.accel_m_s2[moving]
    )
    for one in (imu, cut):
        headers = HeaderTimes(one.stamps_ns, one.stamps_ns)
        report = imu_report(CleanedImu(one, headers, "m_s2", "rad_s", ()), recording_start_ns=0)
        jitter_ms, gyro, accel = solves(replace(recording, imu=one))
        assert 1e3 * report.stamps.jitter_s == pytest.approx(jitter_ms, abs=0.005)
        assert report.measured_noise is not None
        noise = report.measured_noise.noise
        assert noise.gyroscope_noise_density_rad_s_sqrt_hz == pytest.approx(gyro, rel=1e-6)
        assert noise.accelerometer_noise_density_m_s2_sqrt_hz == pytest.approx(accel, rel=1e-6)


def test_a_topic_has_one_rate(pair: tuple[Path, Path]) -> None:
    """The list of topics and the sensors beside it. Mutation: messages by the recording's duration, 9.6 Hz of a lidar's 10."""

    def rates(report: DoctorReport) -> dict[str, float]:
        return {topic.name: topic.rate_hz for topic in report.topics}

    told: list[DoctorReport] = []
    report = api.inspect(pair[0], on_report=told.append)
    assert report.lidar is not None
    assert report.imu is not None
    for part in (report.lidar, report.imu):
        assert rates(report)[part.topic] == part.stamps.rate_hz
    assert rates(report)[report.lidar.topic] == pytest.approx(10.0, rel=2e-3)
    assert set(rates(told[0]).values()) == {0.0}  # not another one before it is known
    solved = api.load(pair[0], fingerprint=False)
    assert rate_hz(solved.imu.stamps_ns) == report.imu.stamps.rate_hz


def test_a_lidar_that_is_not_chosen_has_its_own_rate() -> None:
    """Two lidars of 10 Hz that began half a second late were 9.7 Hz both, and the one that was chosen 10.

    Oracle: the times the messages are made at. Mutations: by number alone; what is read anyhow read twice; other topics read.
    """
    received_ns = 7_000_000_000 + np.arange(500_000_000, 15_500_000_000, 100_000_000)
    received_ns[::7] += 4_000_000
    topics = [
        TopicSummary("/front", "sensor_msgs/msg/PointCloud2", 150, "cdr"),
        TopicSummary("/rear", "sensor_msgs/msg/PointCloud2", 150, "cdr"),
        TopicSummary("/image", "sensor_msgs/msg/Image", 465, "cdr"),
        TopicSummary("/once", "sensor_msgs/msg/PointCloud2", 1, "cdr"),
    ]
    asked: list[set[str]] = []

    def messages(names: set[str], *, start_ns: int, stop_ns: int) -> list[RawMessage]:
        asked.append(names)
        inside = received_ns[(received_ns >= start_ns) & (received_ns < stop_ns)]
        return [RawMessage(name, int(at), b"") for at in inside for name in ("/front", "/rear") if name in names]

    recording: Any = SimpleNamespace(
        topics=topics, start_ns=7_000_000_000, end_ns=22_500_000_000, duration_s=15.5, messages=messages
    )
    rates = counted_rates(recording, [])
    assert (rates["/front"], rates["/rear"]) == pytest.approx((10.0, 10.0), rel=5e-3)
    assert (rates["/image"], rates["/once"]) == (pytest.approx(30.0), 0.0)
    counted_rates(recording, ["/front"])
    assert asked == [{"/front", "/rear", "/once"}, {"/rear", "/once"}]
