"""What a calibration would leave out, put in order or together, an inspection says in the same words, and looks at no more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib_core.doctor.examine import inspect
from calib_core.doctor.sampling import SampledScans
from calib_core.readers.load import load
from calib_core.settings import ReadSettings
from calib_core.types import POINT_DTYPE, Scan
from tests.core.readers import build

SECOND_NS = 1_000_000_000
Change = Callable[[list[build.Message]], list[build.Message]]


def _again(messages: list[build.Message]) -> list[build.Message]:
    """Played in a loop."""
    return [*messages, *((topic, kind, at + round(6.1 * SECOND_NS), raw) for topic, kind, at, raw in messages)]


def _twice_and_late(messages: list[build.Message]) -> list[build.Message]:
    scans = [m for m in messages if m[0] == "/velodyne_points"]
    late = [(topic, kind, at + 130_000_000, raw) for topic, kind, at, raw in scans[7:8]]
    twice = [(topic, kind, at + 1000, raw) for topic, kind, at, raw in scans[::5]]
    return build.in_order([m for m in messages if m is not scans[7]], twice, late)


def _parts(messages: list[build.Message]) -> list[build.Message]:
    """Clouds of 20 ms in the place of the scans."""
    clouds: list[build.Message] = []
    for k in range(300):
        begin_ns = build.EPOCH_NS + k * 20_000_000
        points = build.velodyne_points(build.sweep(n_columns=18, seed=k, period_s=0.02))
        body = build.pointcloud2(points, cdr=True, stamp_ns=begin_ns, frame_id="velodyne")
        clouds.append(("/velodyne_points", "sensor_msgs/msg/PointCloud2", begin_ns + 22_000_000, body))
    return build.in_order(clouds, [m for m in messages if m[0] != "/velodyne_points"])


@pytest.mark.parametrize(
    ("change", "codes"),
    [
        (_again, {"clock.set"}),
        (_twice_and_late, {"points.sent_twice", "points.out_of_order"}),
        (_parts, {"points.gathered"}),
    ],
    ids=["played again", "twice and late", "parts of a sweep"],
)
def test_an_inspection_says_what_a_calibration_would(tmp_path: Path, change: Change, codes: set[str]) -> None:
    """Mutations: an inspection that keeps to no clock (its forecast was refused for scans out of order); that takes parts for
    scans; that counts late clouds otherwise.
    """
    messages = build.in_order(build.velodyne_messages(60, cdr=True), build.still_imu(6.0, cdr=True))
    bag = build.write_ros2(tmp_path / "spoilt", change(messages))
    read, report = load(bag, ReadSettings()), inspect(bag, ReadSettings())
    told = {finding.code: finding.text for finding in read.findings if finding.code in codes}
    assert set(told) == codes
    assert {finding.code: finding.text for finding in report.findings if finding.code in codes} == told
    assert report.forecast is None or "in order" not in str(report.forecast)
    assert not [reason for reason in report.reasons if "in order" in reason]


@pytest.mark.parametrize("at", [0, 30, 59])
def test_a_damaged_stamp_of_a_scan_is_said_and_asked_no_more(tmp_path: Path, at: int) -> None:
    """Oracle: the report of the recording without that scan.

    Seen: one scan stamped an hour ahead made a gap of an hour, 35994 lost messages and, at the end, a clock that was set; and
    nothing was said of it. Mutations: left out for the forecast alone; not said.
    """
    scans, imu = build.velodyne_messages(60, cdr=True), build.still_imu(6.0, cdr=True)
    topic, kind, received_ns, _ = scans[at]
    stamp_ns = build.EPOCH_NS + (3600 * SECOND_NS) + at * 100_000_000
    body = build.pointcloud2(
        build.velodyne_points(build.sweep(seed=at)), cdr=True, stamp_ns=stamp_ns, frame_id="velodyne"
    )
    spoilt = [*scans[:at], (topic, kind, received_ns, body), *scans[at + 1 :]]
    bags = [
        build.write_ros2(tmp_path / name, build.in_order(sent, imu))
        for name, sent in (("spoilt", spoilt), ("without", [*scans[:at], *scans[at + 1 :]]))
    ]
    report, without = (inspect(bag, ReadSettings()) for bag in bags)
    assert report.lidar is not None
    assert without.lidar is not None
    assert report.lidar.stamps == without.lidar.stamps
    assert report.lidar.scans == without.lidar.scans == 59
    told, known = ({f.code: f.text for f in each.findings} for each in (report, without))
    assert set(told) - set(known) == {"points.malformed"}
    assert (
        told["points.malformed"] == {f.code: f.text for f in load(bags[0], ReadSettings()).findings}["points.malformed"]
    )


def test_scans_that_are_looked_at_are_in_order_and_once() -> None:
    """With the number of their points. Mutations: the last of one stamp; the points left where they were."""
    sampled = SampledScans(10, 0.1)
    for index, (stamp_ns, count) in enumerate([(30, 5), (10, 6), (10, 7), (20, 8)]):
        sampled.add(Scan(index, stamp_ns, np.zeros(count, POINT_DTYPE)))
    sampled.put_in_order()
    assert [(scan.index, scan.stamp_ns) for scan in sampled.scans] == [(1, 10), (3, 20), (0, 30)]
    assert sampled.points == [6, 8, 5]
