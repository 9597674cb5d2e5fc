"""Clocks of points that begin anew while a recording runs: by scans whose instants are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.errors import InputError
from calib_core.readers.load import load
from calib_core.readers.scans import unwound_ns
from calib_core.readers.timing.point_time import PointTiming
from calib_core.settings import ReadSettings
from tests.core.readers import build

PERIOD_NS, SECOND_NS = 100_000_000, 1_000_000_000


@pytest.mark.parametrize(
    ("unit_ns", "round_units"),
    [(1_000, 3_600_000_000), (1, 1 << 32), (1_000, 1 << 32)],
    ids=["hour", "32 bit of ns", "of us"],
)
def test_scans_go_on_where_their_points_clock_begins_anew(unit_ns: int, round_units: int, tmp_path: Path) -> None:
    """Seen: the time offset off by an hour, `calibrated`. Mutations: left as they are; once only; forwards; of any size."""
    clouds = []
    dtype = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<u4")]
    begin_units = round_units - round(4.25 * SECOND_NS / unit_ns)
    for k in range(120):
        swept = build.sweep(seed=k)
        points = np.zeros(len(swept["ring"]), dtype)
        points["x"], points["y"], points["z"] = swept["xyz"].T
        points["ring"] = swept["ring"]
        elapsed = np.round((k * PERIOD_NS + 1e9 * swept["time_s"]) / unit_ns).astype(np.int64)
        points["timestamp"] = (begin_units + elapsed) % round_units
        at_ns = build.EPOCH_NS + k * PERIOD_NS
        body = build.pointcloud2(points, cdr=False, stamp_ns=at_ns, frame_id="lidar")
        clouds.append(("/points", "sensor_msgs/msg/PointCloud2", at_ns + PERIOD_NS, body))
    path = build.write_ros1(tmp_path / "r.bag", build.in_order(clouds, build.still_imu(12.0, cdr=False)))
    read = load(path, ReadSettings())
    stamps_ns = np.array([scan.stamp_ns for scan in read.scans])
    assert len(stamps_ns) == 120
    off_ns = np.abs(stamps_ns - build.EPOCH_NS - PERIOD_NS * np.arange(120))
    # Of a sweep amid which it begins anew the lesser part is left out.
    assert (off_ns > 2 * unit_ns).sum() <= 2
    assert off_ns.max() < PERIOD_NS / 2
    assert "clock.set" not in {finding.code for finding in read.findings}


def test_what_is_no_round_stays() -> None:
    """A header that is off by itself, times in the headers' epoch, times that count from it. Mutations: each of these."""
    own = PointTiming("t", "us", "absolute", 0.0, 1e8, shift_ns=5)
    header_ns = build.EPOCH_NS
    assert unwound_ns(header_ns + 3600 * SECOND_NS, header_ns, own) == header_ns
    for away_s in (0.5, 100.0, 3605.0):
        away_ns = round(away_s * SECOND_NS)
        assert unwound_ns(header_ns + away_ns, header_ns, own) == header_ns + away_ns
    for other in (
        PointTiming("t", "us", "absolute", 0.0, 1e8),
        PointTiming("t", "us", "header-first", 0.0, 1e8, shift_ns=5),
    ):
        assert unwound_ns(header_ns + 3600 * SECOND_NS, header_ns, other) == header_ns + 3600 * SECOND_NS


def test_clocks_of_points_that_are_leap_seconds_ahead_are_not_late_by_them(tmp_path: Path) -> None:
    """TAI beside UTC, 37 s. Seen: "their last point is 37100 ms after it", and an override that moves the offset by a sweep.

    Mutation: when points were taken told before they are brought into the headers' epoch.
    """
    clouds = []
    dtype = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), ("timestamp", "<f8")]
    for k in range(60):
        swept, at_ns = build.sweep(seed=k), build.EPOCH_NS + k * PERIOD_NS
        points = np.zeros(len(swept["ring"]), dtype)
        points["x"], points["y"], points["z"] = swept["xyz"].T
        points["ring"], points["timestamp"] = swept["ring"], 1e-9 * at_ns + 37.0 + swept["time_s"]
        body = build.pointcloud2(points, cdr=False, stamp_ns=at_ns, frame_id="lidar")
        clouds.append(("/points", "sensor_msgs/msg/PointCloud2", at_ns + PERIOD_NS + 5_000_000, body))
    path = build.write_ros1(tmp_path / "r.bag", build.in_order(clouds, build.still_imu(6.0, cdr=False)))
    findings = {finding.code: finding for finding in load(path, ReadSettings()).findings}
    assert "37.000 s apart" in findings["points.epoch"].text
    assert "clock.stamp_at_end" not in findings
    told = {evidence.name: evidence.value for evidence in findings["points.time_field"].evidence}
    assert told["first point after header"] == pytest.approx(0.0, abs=1e-3)
    assert told["last point after header"] == pytest.approx(0.1, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "share", "is_time"),
    [("index", 0.3, False), ("stamp_us", 0.9, True), ("time", 0.3, True), ("timestamp_us", 0.3, True)],
)
def test_a_running_number_is_no_time(name: str, share: float, is_time: bool, tmp_path: Path) -> None:
    """A number of each point fits microseconds by chance; a field that is called so may cover part of a sweep. Seen: an answer 30
    ms off, 6 sigmas. Mutations: any share of a sweep; none below it, whatever it is called; not though somebody has named it.
    """
    clouds = []
    dtype = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2"), (name, "<u4")]
    for k in range(30):
        swept, at_ns = build.sweep(seed=k), build.EPOCH_NS + k * PERIOD_NS
        points = np.zeros(len(swept["ring"]), dtype)
        points["x"], points["y"], points["z"] = swept["xyz"].T
        points["ring"], points[name] = swept["ring"], np.round(share * 1e6 * swept["time_s"])
        body = build.pointcloud2(points, cdr=False, stamp_ns=at_ns, frame_id="lidar")
        clouds.append(("/points", "sensor_msgs/msg/PointCloud2", at_ns + PERIOD_NS, body))
    path = build.write_ros1(tmp_path / "r.bag", build.in_order(clouds, build.still_imu(3.0, cdr=False)))
    if not is_time:
        with pytest.raises(InputError, match="carry no usable per-point time: field 'index' spreads over"):
            load(path, ReadSettings())
    asked = ReadSettings() if is_time else ReadSettings(point_time_field=name, point_time_unit="us")
    scan = load(path, asked).scans[3]
    assert scan.points["offset_ns"].max() == pytest.approx(share * PERIOD_NS, rel=0.05)
