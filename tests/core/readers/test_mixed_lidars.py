"""Lidars that share a topic, and one lidar that only looks like several."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib_core.doctor.examine import inspect
from calib_core.errors import InputError
from calib_core.readers.clouds.cloud import points_mark
from calib_core.readers.clouds.livox import read_custom_msg
from calib_core.readers.container.storage import RawMessage
from calib_core.readers.load import load
from calib_core.readers.mixed_lidars import Sender, in_turn, sender_of
from calib_core.settings import ReadSettings
from tests.core.readers import build

A, B, NONE = Sender("lidar_a", None), Sender("lidar_b", None), Sender("", None)
NS_PER_SCAN = 100_000_000
LATER_NS = 40_000_000
NAMES = ("reflectivity", "tag", "line")


@pytest.mark.parametrize(
    ("senders", "several"),
    [
        ([A, B] * 30, [A, B]),
        ([A] * 100 + [A, B] * 6, [A, B]),
        ([B, A, A, A, A] * 12, [A, B]),
        ([A, A, A, B, B, B] * 10, [A, B]),
        ([NONE, A] * 30, [NONE, A]),
        ([Sender("livox_frame", 0), Sender("livox_frame", 1)] * 9, [Sender("livox_frame", n) for n in (0, 1)]),
        ([A] * 60, []),
        ([A] * 30 + [B] * 30, []),
        ([A] * 29 + [B, A] + [B] * 30, []),
        ([NONE] + [A] * 59, []),
        (([A] * 99 + [NONE]) * 8, []),
        (([A] * 20 + [B] * 20) * 5, []),
        ([], []),
    ],
)
def test_lidars_are_several_where_their_clouds_come_in_turn(senders: list[Sender], several: list[Sender]) -> None:
    """Renamed in mid-recording, without a name now and then, played five times: one. Mutations: any second name; how often
    in turn not asked; nor how rare it is.
    """
    assert in_turn(senders) == several


def _clouds(frame_of: Callable[[int], str], *, late_ns: int = 0, other: int = 0) -> list[build.Message]:
    """Sixty sweeps; other: of which room."""
    messages: list[build.Message] = []
    for k in range(60):
        stamp_ns = build.EPOCH_NS + k * NS_PER_SCAN + late_ns
        points = build.velodyne_points(build.sweep(seed=k + 1000 * other))
        body = build.pointcloud2(points, cdr=True, stamp_ns=stamp_ns, frame_id=frame_of(k))
        messages.append(("/points", "sensor_msgs/msg/PointCloud2", stamp_ns + 105_000_000 + other, body))
    return messages


def _bag(folder: Path, *clouds: list[build.Message]) -> Path:
    return build.write_ros2(folder / "bag", build.in_order(*clouds, build.still_imu(6.2, cdr=True)))


@pytest.mark.parametrize("late_ns", [0, LATER_NS])
@pytest.mark.parametrize("since", [0, 52])
def test_two_lidars_on_one_topic_are_refused_with_their_frames(late_ns: int, since: int, tmp_path: Path) -> None:
    """Of one stamp, or between; from the start on, or after the sample that the detections look at was taken.

    Seen: mixed, or one of the two, with an answer under the frame of the other. Mutations: asked of the sample alone, of the pass
    alone; not of an inspection.
    """
    bag = _bag(tmp_path, _clouds(lambda _: "lidar_a"), _clouds(lambda _: "lidar_b", late_ns=late_ns, other=1)[since:])
    with pytest.raises(InputError) as caught:
        load(bag, ReadSettings())
    assert caught.value.code == "points.several_lidars"
    expected = (
        "2 lidars share the topic /points: clouds of the frames lidar_a and lidar_b alternate; record each lidar on a topic"
        " of its own."
    )
    assert str(caught.value) == expected
    assert expected in inspect(bag, ReadSettings()).reasons


@pytest.mark.parametrize("frame_of", [lambda k: "" if k == 0 else "lidar_a", lambda k: "lidar_a" if k < 59 else "b"])
def test_one_lidar_is_read_under_the_frame_of_most_of_its_clouds(
    frame_of: Callable[[int], str], tmp_path: Path
) -> None:
    """Mutation: the frame of the first."""
    bag = _bag(tmp_path, _clouds(frame_of))
    read, report = load(bag, ReadSettings()), inspect(bag, ReadSettings())
    assert len(read.scans) == 60
    assert read.lidar.frame_id == "lidar_a"
    assert report.lidar is not None
    assert report.lidar.frame_id == "lidar_a"


def test_clouds_of_one_stamp_were_sent_twice_only_if_they_hold_the_same_points(tmp_path: Path) -> None:
    """Two of a stamp from one lidar, every fifth the same again and every tenth another. Mutations: all of them sent twice, in a
    calibration or in an inspection; the later one kept.
    """
    again, unlike = _clouds(lambda _: "lidar_a")[::5], _clouds(lambda _: "lidar_a", other=1)[1::10]
    again = [(topic, kind, at_ns + 1, body) for topic, kind, at_ns, body in again]
    bag = _bag(tmp_path, _clouds(lambda _: "lidar_a"), again, unlike)
    read, report = load(bag, ReadSettings()), inspect(bag, ReadSettings())
    for findings in (read.findings, report.findings):
        told = {finding.code: finding.text for finding in findings}
        assert told["points.sent_twice"] == (
            "12 clouds on /points have the stamp and the points of another; the first of each was kept."
        )
        assert told["points.shared_stamps"] == (
            "6 clouds on /points have the stamp of another but other points; the first of each was kept, the others were"
            " left out."
        )
    assert len(read.scans) == read.scans_total == 60
    np.testing.assert_array_equal(read.scans[1].points["xyz"], build.sweep(seed=1)["xyz"].astype(np.float32))


def test_a_livox_message_tells_which_lidar_it_is_of() -> None:
    """Mutations: the number dropped; the byte beside it."""
    points = np.zeros(3, [("offset_time", "u4"), *[(axis, "f4") for axis in "xyz"], *[(name, "u1") for name in NAMES]])
    payload = bytearray(build.custom_msg(points, cdr=True, stamp_ns=build.EPOCH_NS))
    at = payload.index(bytes([3, 0, 0, 0, 1, 0, 0, 0])) + 4
    payload[at] = 7
    cloud = read_custom_msg(RawMessage("/livox/lidar", 0, bytes(payload)), "cdr")
    assert sender_of(cloud) == Sender("livox_frame", 7)


def test_a_mark_is_of_points_all_over_a_cloud() -> None:
    """Returns are missing where a sweep begins. Mutations: of the first points; of how many there are alone."""
    points = build.velodyne_points(build.sweep())
    other = points.copy()
    other["x"][400:] += 0.001
    assert points_mark(points) == points_mark(points.copy())
    assert points_mark(points) != points_mark(other)
    assert points_mark(points) != points_mark(points[:-1])
