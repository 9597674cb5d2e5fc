"""The doctor's report against recordings whose motion, noise and faults were made here."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib_core.doctor import DoctorReport, inspect
from calib_core.doctor.imu_report import excitation
from calib_core.doctor.noise import measured_noise
from calib_core.doctor.stillness import still_spans
from calib_core.imu.clipping import clipped_share
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray
from tests.core.doctor.readings import data
from tests.core.readers import build
from tests.core.readers.tilting import tilting

RATE = 100.0


def imu_messages(gyro: FloatArray, accel: FloatArray, *, topic: str = "/imu/data") -> list[build.Message]:
    made: list[build.Message] = []
    for k in range(len(gyro)):
        stamp = build.EPOCH_NS + k * 10_000_000
        made.append(
            (topic, "sensor_msgs/msg/Imu", stamp + 500_000, build.imu_message(stamp, gyro[k], accel[k], cdr=False))
        )
    return made


def report_of(folder: Path, *streams: list[build.Message], settings: ReadSettings | None = None) -> DoctorReport:
    return inspect(build.write_ros1(folder / "r.bag", build.in_order(*streams)), settings or ReadSettings())


def test_a_recording_is_described(tmp_path: Path) -> None:
    """Mutation: forget to divide by the number of readings in `timeline`. Its clouds are noise, and that is said."""
    gyro, accel = tilting(25)
    report = report_of(tmp_path, build.velodyne_messages(240, cdr=False), imu_messages(gyro, accel))
    assert report.verdict == "unusable"
    assert report.reasons == ("No plane was found in any scan: record in front of walls and floor, at 1 to 20 m.",)
    assert report.planes is not None
    assert report.planes.planes == ()
    assert not report.planes.determined
    assert report.lidar is not None
    assert report.imu is not None
    assert report.lidar.scans == 240
    assert report.lidar.rings == 16
    assert report.lidar.stamps.rate_hz == pytest.approx(10.0)
    assert report.lidar.point_time is not None
    assert (report.lidar.point_time.field, report.lidar.point_time.unit) == ("time", "s")
    assert report.lidar.ranges is not None
    assert 2.0 <= report.lidar.ranges.minimum_m < 2.2
    assert report.lidar.ranges.maximum_m <= 30.001
    moving = np.rad2deg(np.sqrt(np.mean(gyro[300:] ** 2, axis=0)))
    assert report.imu.excitation.rotation_rms_deg_s == pytest.approx(tuple(moving), rel=0.05)
    assert report.imu.still_spans[0].start_s < 0.3
    assert report.imu.still_spans[0].end_s == pytest.approx(3.0, abs=0.3)
    assert report.imu.noise_used == "measured"
    assert report.imu.measured_noise is not None
    # 2e-3 rad/s and 0.02 m/s2 per reading at 100 Hz
    noise = report.imu.measured_noise.noise
    assert noise.gyroscope_noise_density_rad_s_sqrt_hz == pytest.approx(2e-4, rel=0.1)
    assert noise.accelerometer_noise_density_m_s2_sqrt_hz == pytest.approx(2e-3, rel=0.1)
    drawn = report.timeline
    assert len(drawn.t_s) == len(drawn.rotation_norm_deg_s) == len(drawn.acceleration_m_s2[2]) == 250
    assert len(drawn.scan_t_s) == 240
    assert drawn.scan_t_s[0] == pytest.approx(0.1045, abs=1e-3)
    at = int(np.argmin(np.abs(np.array(drawn.t_s) - 10.05)))
    assert drawn.rotation_deg_s[1][at] == pytest.approx(np.rad2deg(gyro[1000:1010, 1].mean()), abs=0.5)


def test_the_report_is_json_and_comes_back(tmp_path: Path) -> None:
    """Mutation: put a NumPy number or NaN into the report."""
    gyro, accel = tilting(6)
    report = report_of(tmp_path, build.velodyne_messages(50, cdr=False), imu_messages(gyro, accel))
    text = report.to_json()
    assert json.loads(text)["schema"] == "unsweep.report/1"
    assert "NaN" not in text
    assert DoctorReport.model_validate_json(text) == report
    assert report.forecast is not None
    assert report.forecast.code == "planes.none"


def test_lidar_only_and_imu_only_are_reported(tmp_path: Path) -> None:
    """Mutation: let InputError of `choose_imu` out of `inspect`."""
    report = report_of(tmp_path, build.velodyne_messages(50, cdr=False))
    assert report.verdict == "unusable"
    assert report.imu is None
    assert report.lidar is not None
    assert report.lidar.ranges is not None
    (tmp_path / "b").mkdir()
    report = report_of(tmp_path / "b", imu_messages(*tilting(5)))
    assert report.verdict == "unusable"
    assert report.lidar is None
    assert report.imu is not None


def test_what_is_known_on_the_way_is_told_before_the_forecast(tmp_path: Path) -> None:
    """Topics once some clouds are looked at, sensors once all are read; what the end adds is planes, forecast and verdict.

    Oracle: the whole report, and how far the work was. Mutation: the second report told after looking ahead; told as final.
    """
    bag = build.write_ros1(
        tmp_path / "r.bag", build.in_order(build.velodyne_messages(30, cdr=False), imu_messages(*tilting(6)))
    )
    at = [0.0]
    told: list[tuple[DoctorReport, float]] = []
    whole = inspect(
        bag,
        ReadSettings(),
        on_event=lambda event: at.append(event.fraction) if event.event == "stage" else None,
        on_report=lambda report: told.append((report, at[-1])),
    )
    (first, first_at), (second, second_at) = told
    assert whole.final
    assert not first.final
    assert not second.final
    assert first_at == 0.0
    assert second_at <= 0.4
    bare = [topic.model_copy(update={"rate_hz": 0.0}) for topic in whole.topics]  # what no stamp has told yet
    assert (list(first.topics), first.lidar, first.imu) == (bare, None, None)
    assert second.topics == whole.topics
    assert "points.time_field" in [finding.code for finding in first.findings]
    assert second.lidar == whole.lidar
    assert second.imu == whole.imu
    assert second.timeline == whole.timeline
    assert second.findings == whole.findings
    assert (second.planes, second.forecast) == (None, None)


def test_progress_only_grows(tmp_path: Path) -> None:
    """Mutation: let looking ahead begin at zero again, after reading has come to its end."""
    bag = build.write_ros1(
        tmp_path / "r.bag", build.in_order(build.velodyne_messages(30, cdr=False), imu_messages(*tilting(6)))
    )
    told: list[float] = []
    inspect(bag, ReadSettings(), on_event=lambda event: told.append(event.fraction) if event.event == "stage" else None)
    assert told == sorted(told)
    assert told[0] == 0.0
    assert told[-1] == 1.0
    assert any(0.4 < fraction < 1.0 for fraction in told)


def test_dropped_scans_are_counted(tmp_path: Path) -> None:
    """Mutation: count every step above the median as a lost scan."""
    scans = build.velodyne_messages(200, cdr=False)
    del scans[50:60], scans[100]
    report = report_of(tmp_path, scans, imu_messages(*tilting(21)))
    assert report.lidar is not None
    assert report.lidar.stamps.dropped == 11
    assert report.lidar.stamps.gaps == 1
    assert any("scans on /velodyne_points are missing" in r for r in report.reasons)


def test_still_spans_are_found_where_they_are() -> None:
    """Mutation: compare the acceleration's mean instead of its deviation; forget the resting bias."""
    gyro, accel = tilting(20, seed=3)
    gyro[1200:1500] = np.random.default_rng(0).normal(0, 2e-3, (300, 3))
    accel[1200:1500] = np.array([1, 2, 9.5]) + np.random.default_rng(0).normal(0, 0.02, (300, 3))
    spans = still_spans(data(gyro + np.array([0.02, -0.01, 0.015]), accel))
    assert [(round(s.start_s), round(s.end_s)) for s in spans] == [(0, 3), (12, 15)]


def test_noise_is_floored_at_the_resolution() -> None:
    """Mutation: leave the floor out (readings that never change would be noiseless)."""
    step = 1e-3
    gyro = np.zeros((1000, 3))
    gyro[500] = step
    accel = np.tile([0.0, 0, 9.81], (1000, 1))
    accel[500, 0] = 0.01
    imu = data(gyro, accel)
    got = measured_noise(imu)
    assert got is not None
    assert got.static_s == pytest.approx(10.0, abs=0.3)
    assert got.gyroscope_resolution_rad_s == pytest.approx(step)
    floor = step / np.sqrt(12) * np.sqrt(0.01)
    assert got.noise.gyroscope_noise_density_rad_s_sqrt_hz == pytest.approx(floor, rel=1e-6)


def test_clipping_is_told_from_smooth_peaks() -> None:
    """A platform that turns no faster than it may keeps its noise, below ranges in common use; what a range cuts off does not.

    Mutations: count single readings at the extreme; leave out the narrower ranges; tell a platform for one.
    """
    times = np.arange(2000) / RATE
    smooth = np.stack([np.sin(times), np.sin(1.3 * times), np.sin(2 * times)], 1)
    noise = np.random.default_rng(0).normal(0, 1e-3, smooth.shape)
    assert clipped_share(smooth + noise) == 0.0
    assert clipped_share(np.clip(smooth, -0.8, 0.8)) > 0.1
    assert clipped_share(np.clip(0.5 * smooth, -0.4, 0.4) + noise, 1.96) == 0.0
    assert clipped_share(np.clip(0.5 * smooth + noise, -0.4, 0.4), 1.96) > 0.1
    assert clipped_share(np.clip(4.0 * smooth, -2.18, 2.18), 1.96) > 0.1


def test_excitation_names_the_weakest_axis() -> None:
    """Mutation: take the eigenvector of the largest eigenvalue; reverse the axes of the root mean square."""
    rng = np.random.default_rng(0)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    times = np.arange(4000) / RATE
    turns = np.stack([np.sin(times), 0.8 * np.sin(1.7 * times), 0.05 * np.sin(2.3 * times)], 1) @ axes.T
    got = excitation(data(turns, np.tile([0, 0, 9.81], (4000, 1))), ())
    assert abs(np.dot(got.weakest_axis, axes[:, 2])) > 0.999
    assert got.weakest_axis_rms_deg_s == pytest.approx(np.rad2deg(0.05 / np.sqrt(2)), rel=0.05)
    expected = np.rad2deg(np.sqrt(np.mean(turns**2, axis=0)))
    assert got.rotation_rms_deg_s == pytest.approx(tuple(expected), rel=0.02)
    assert got.axis_condition == pytest.approx((1 / 0.05) ** 2, rel=0.1)
