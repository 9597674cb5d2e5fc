"""Clocks that are set while a recording runs, scans sent twice or late: on stamps and bags whose instants are known."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calib_core.errors import InputError
from calib_core.readers import scans as scans_of
from calib_core.readers.imu.messages import RawImu
from calib_core.readers.imu.readings import clean_imu
from calib_core.readers.load import load
from calib_core.readers.reading import Reading
from calib_core.readers.timing.clocks import HeaderTimes
from calib_core.readers.timing.resets import resets, sides
from calib_core.settings import ReadSettings
from calib_core.types import FloatArray, IntArray, Recording
from tests.core.readers import build

PERIOD_NS = 100_000_000
SECOND_NS = 1_000_000_000


def _stamped(count: int = 300) -> tuple[IntArray, IntArray]:
    """Headers of a sensor's own clock, and receive times 5 ms later in the mean, by an exponential law."""
    header_ns = build.EPOCH_NS + PERIOD_NS * np.arange(count, dtype=np.int64)
    late_ns = np.random.default_rng(2).exponential(5e6, count).astype(np.int64)
    return header_ns, header_ns + 3_000_000 + late_ns


@pytest.mark.parametrize("by_ns", [-3600 * SECOND_NS, -3 * SECOND_NS, -120_000_000, 80_000_000, 400_000_000])
@pytest.mark.parametrize("at", [12, 150, 288])
def test_a_clock_that_is_set_is_found_with_its_instant_and_by_how_much(by_ns: int, at: int) -> None:
    """Mutations: the jump's sign; the message before it."""
    header_ns, receive_ns = _stamped()
    header_ns[at:] += by_ns
    (found,) = resets(HeaderTimes(header_ns, receive_ns), "/points")
    assert found.at_ns == receive_ns[at]
    # Medians of ten exponential latencies of 5 ms are known to a third of that each.
    assert abs(found.by_ns - by_ns) < 10_000_000


@pytest.mark.parametrize("case", ["nothing", "a stall", "the recorder's clock", "lost messages", "swapped", "drift"])
def test_what_is_late_or_lost_is_no_clock_that_was_set(case: str) -> None:
    """Mutations: whether the jump stays is not asked; nor whether the stamps or the receive times are what is unusual."""
    header_ns, receive_ns = _stamped()
    match case:
        case "a stall":
            receive_ns[100:120] = receive_ns[120] + np.arange(-20, 0) * 50_000
        case "the recorder's clock":
            receive_ns[150:] += 5 * SECOND_NS
        case "lost messages":
            header_ns, receive_ns = np.delete(header_ns, range(90, 130)), np.delete(receive_ns, range(90, 130))
        case "swapped":
            header_ns[[40, 41]] = header_ns[[41, 40]]
            header_ns[[80, 84]] = header_ns[[84, 80]]
        case "drift":
            header_ns += (np.arange(300) * 100_000).astype(np.int64)
    assert resets(HeaderTimes(header_ns, receive_ns), "/points") == []


def _quick(count: int = 3000, jitter_ns: float = 3e5) -> tuple[IntArray, IntArray]:
    """Headers of 200 Hz, and receive times a millisecond later, more or less."""
    header_ns = build.EPOCH_NS + 5_000_000 * np.arange(count, dtype=np.int64)
    late_ns = 1_000_000 + np.random.default_rng(3).exponential(jitter_ns, count).astype(np.int64)
    return header_ns, header_ns + late_ns


@pytest.mark.parametrize("by_ns", [15_000_000, -15_000_000, 6_000_000])
def test_a_clock_that_is_set_by_a_few_readings_is_found(by_ns: int) -> None:
    """Seen: 15 ms, as three readings that were lost, and a solve of seven minutes that ended weakly.

    Mutations: jumps of 50 ms alone; the place; the sign.
    """
    header_ns, receive_ns = _quick()
    header_ns[1600:] += by_ns
    (found,) = resets(HeaderTimes(header_ns, receive_ns), "/imu")
    assert found.at_ns == receive_ns[1600]
    assert abs(found.by_ns - by_ns) < 100_000


@pytest.mark.parametrize(
    "case",
    [
        "lost",
        "a full queue",
        "jitter",
        "a clock that is led to and fro",
        "stamped by a busy host",
        "bundles",
        "stamped on arrival",
    ],
)
def test_what_jumps_by_a_few_readings_is_no_clock_that_was_set(case: str) -> None:
    """Mutations: a lag that stays for ten messages is enough; its variation is not asked; how often is not asked."""
    header_ns, receive_ns = _quick()
    rng = np.random.default_rng(4)
    match case:
        case "lost":
            header_ns, receive_ns = np.delete(header_ns, range(1600, 1603)), np.delete(receive_ns, range(1600, 1603))
        case "a full queue":  # the recorder falls behind by 20 ms, and drops what has queued up
            receive_ns[1500:1600] += np.linspace(0, 20_000_000, 100).astype(np.int64)
            header_ns, receive_ns = np.delete(header_ns, range(1600, 1604)), np.delete(receive_ns, range(1600, 1604))
        case "jitter":
            header_ns += rng.normal(0.0, 2e6, header_ns.size).astype(np.int64)
        case "a clock that is led to and fro":
            header_ns += (8e6 * np.sin(2 * np.pi * (header_ns - header_ns[1600]) / 8e9)).astype(np.int64)
            header_ns[1600] += 7_000_000
        case "stamped by a busy host":
            header_ns[1500:1560] += 12_000_000
        case "bundles":
            header_ns = header_ns[19::20].repeat(20)
        case "stamped on arrival":
            header_ns = receive_ns - 100_000
            header_ns[1600:], receive_ns[1600:] = header_ns[1600:] + 15_000_000, receive_ns[1600:] + 15_000_000
    assert resets(HeaderTimes(header_ns, receive_ns), "/imu") == []


def test_the_longest_side_comes_first() -> None:
    """Mutation: the later of equally long ones."""
    header_ns, receive_ns = _stamped()
    header_ns[100:] += SECOND_NS
    header_ns[250:] -= 3 * SECOND_NS
    found = resets(HeaderTimes(header_ns, receive_ns), "/points")
    assert [reset.by_ns > 0 for reset in found] == [True, False]
    assert sides(found, 0, int(receive_ns[-1]))[1:] == [
        (int(receive_ns[100]), int(receive_ns[250])),
        (int(receive_ns[250]), int(receive_ns[-1])),
    ]
    assert sides(found[:1], int(receive_ns[0]), 2 * int(receive_ns[100]) - int(receive_ns[0])) == [
        (int(receive_ns[0]), int(receive_ns[100])),
        (int(receive_ns[100]), 2 * int(receive_ns[100]) - int(receive_ns[0])),
    ]


def _spoilt(
    folder: Path, change: Callable[[list[build.Message]], list[build.Message]], settings: ReadSettings | None = None
) -> Recording:
    messages = build.in_order(build.velodyne_messages(60, cdr=True), build.still_imu(6.0, cdr=True))
    return load(build.write_ros2(folder / "spoilt", change(messages)), settings or ReadSettings())


def _said(recording: Recording) -> dict[str, str]:
    return {finding.code: finding.text for finding in recording.findings if finding.level == "warning"}


def _set_back(messages: list[build.Message]) -> list[build.Message]:
    """By 2 s from 3.5 s on: what was stamped later is made with stamps of before."""
    since_ns = build.EPOCH_NS + round(3.5 * SECOND_NS)
    earlier = {
        topic: [m for m in build.in_order(stream) if m[2] + 2 * SECOND_NS >= since_ns]
        for topic, stream in (
            ("/velodyne_points", build.velodyne_messages(60, cdr=True)),
            ("/imu/data", build.still_imu(6.0, cdr=True)),
        )
    }
    moved = [(t, kind, at + 2 * SECOND_NS, raw) for stream in earlier.values() for t, kind, at, raw in stream]
    return build.in_order([m for m in messages if m[2] < since_ns], [m for m in moved if m[2] >= since_ns])


def test_of_a_clock_that_was_set_the_longer_side_is_read(tmp_path: Path) -> None:
    """3.5 s before, 4.5 after: scans that began before it was set are left out of the later side.

    Mutations: the earlier side; the IMU not cut.
    """
    read = _spoilt(tmp_path, _set_back)
    begin_ns = build.EPOCH_NS + round(1.5 * SECOND_NS)
    assert "jump back by 2.0" in _said(read)["clock.set"]
    assert "3.5 s after the start as when a clock is set" in _said(read)["clock.set"]
    assert "from 3.5 s to 8" in _said(read)["clock.set"]
    assert "imu.out_of_order" not in _said(read)
    assert begin_ns <= read.imu.stamps_ns[0] < begin_ns + 2e7
    assert np.all(np.diff(read.imu.stamps_ns) > 0)
    stamps_ns = [scan.stamp_ns for scan in read.scans]
    assert begin_ns <= stamps_ns[0] < begin_ns + 3 * PERIOD_NS
    assert len(stamps_ns) == read.scans_total == 45 - round((stamps_ns[0] - begin_ns) / PERIOD_NS)


def test_a_sweep_that_begins_in_the_open_is_no_clock_that_was_set(tmp_path: Path) -> None:
    """For six seconds nothing is in sight where sweeps begin; then there is, and the first return is 17 ms sooner. Headers
    keep to their even clock. Seen: five of eighteen seconds left out, with the standstill, or all of the motion, and refused.

    Mutation: scans told by their first returns.
    """

    def opened(messages: list[build.Message]) -> list[build.Message]:
        left = []
        for k, (topic, kind, at_ns, _) in enumerate(m for m in messages if m[0] == "/velodyne_points"):
            points = build.velodyne_points(build.sweep(seed=k))
            seen = points[points["time"] > 0.017] if k < 60 else points
            stamp_ns = build.EPOCH_NS + k * PERIOD_NS
            body = build.pointcloud2(seen, cdr=True, stamp_ns=stamp_ns, frame_id="velodyne")
            left.append((topic, kind, at_ns, body))
        return build.in_order(left, [m for m in messages if m[0] != "/velodyne_points"])

    messages = build.in_order(build.velodyne_messages(120, cdr=True), build.still_imu(12.0, cdr=True))
    read = load(build.write_ros2(tmp_path / "open", opened(messages)), ReadSettings())
    assert read.scans[61].stamp_ns - read.scans[59].stamp_ns < 2 * PERIOD_NS - 15_000_000
    assert "clock.set" not in _said(read)
    assert len(read.scans) == 120


@pytest.mark.parametrize(
    ("reference", "jitter_ns", "unset", "by_points"),
    [
        ("absolute", 2e6, False, True),
        ("absolute", 0.0, False, False),
        ("absolute", 0.0, True, True),
        ("header", 2e6, False, False),
    ],
)
def test_scans_are_told_by_headers_unless_points_have_a_more_even_clock(
    reference: str, jitter_ns: float, unset: bool, by_points: bool
) -> None:
    """Points' own times beside headers that a host gives, or nobody. Mutations: by points always, or never; by the less even."""
    even_ns = build.EPOCH_NS + PERIOD_NS * np.arange(30, dtype=np.int64)
    headers_ns = even_ns + np.rint(jitter_ns * np.random.default_rng(1).normal(size=30)).astype(np.int64)
    if unset:
        headers_ns = np.zeros(30, np.int64)
    points_ns = even_ns + 7
    ends_ns = points_ns + 99_000_000
    scans: Any = SimpleNamespace(
        message_indices=list(range(30)), stamps_ns=points_ns.tolist(), ends_ns=ends_ns.tolist()
    )
    reading: Any = SimpleNamespace(
        indices=list(range(30)), header_ns=headers_ns.tolist(), receive_ns=(even_ns + 9).tolist(), scans=scans,
        timing=SimpleNamespace(reference=reference),
    )  # fmt: skip
    stamped = Reading.stamped(reading)
    expected = [points_ns, ends_ns] if by_points else [headers_ns]
    for series, told_by_ns in zip(stamped, expected, strict=True):
        np.testing.assert_array_equal(series.header_ns, told_by_ns)
        np.testing.assert_array_equal(series.receive_ns, even_ns + 9)


@pytest.mark.parametrize("set_back", [False, True])
@pytest.mark.parametrize("edge", ["first", "last"])
def test_points_with_a_clock_of_their_own_show_one_that_was_set_at_either_end_of_a_sweep(
    edge: str, set_back: bool, tmp_path: Path
) -> None:
    """Headers are a host's, on arrival. For six seconds nothing is in sight where sweeps begin, or end. The points'
    clock is set back by 30 ms after nine seconds, or never. Mutations: first returns alone; last ones alone.
    """
    late_ns = np.random.default_rng(8).exponential(1.5e6, 120).astype(np.int64)
    messages = []
    for k in range(120):
        plain = build.velodyne_points(build.sweep(seed=k))
        points = np.zeros(
            plain.size, [(name, plain.dtype[name]) for name in ("x", "y", "z", "ring")] + [("timestamp", "f8")]
        )
        for name in ("x", "y", "z", "ring"):
            points[name] = plain[name]
        set_s = 0.03 if set_back and k >= 90 else 0.0
        points["timestamp"] = build.EPOCH_NS / SECOND_NS + 0.1 * k + plain["time"].astype(np.float64) - set_s
        open_s = (plain["time"] < 0.017) if edge == "first" else (plain["time"] > 0.083)
        seen = points[~open_s] if k < 60 else points
        at_ns = build.EPOCH_NS + k * PERIOD_NS + 103_000_000 + int(late_ns[k])
        body = build.pointcloud2(seen, cdr=True, stamp_ns=at_ns - 100_000, frame_id="lidar")
        messages.append(("/points", "sensor_msgs/msg/PointCloud2", at_ns, body))
    bag = build.write_ros2(tmp_path / "open", build.in_order(messages, build.still_imu(12.0, cdr=True)))
    read = load(bag, ReadSettings())
    assert len(read.scans) == (90 if set_back else 120)
    assert ("clock.set" in _said(read)) == set_back
    if set_back:
        assert re.search(r"jump back by (29|30|31) ms 9", _said(read)["clock.set"])


def test_where_receive_times_are_believed_no_header_matters(tmp_path: Path) -> None:
    """Nothing is cut: both sides of 3.5 and 4.5 s are read. Mutation: the setting is not looked at."""
    read = _spoilt(tmp_path, _set_back, ReadSettings(stamps="receive"))
    assert "clock.set" not in _said(read)
    assert len(read.scans) == 80
    assert len(read.imu.stamps_ns) == 800


def test_a_playback_that_began_anew_counts_once(tmp_path: Path) -> None:
    """Mutation: no side is left out (all scans and readings are there twice, and every sigma is 0.7 of what it is)."""
    read = _spoilt(tmp_path, lambda m: [*m, *((t, kind, at + 61 * PERIOD_NS, raw) for t, kind, at, raw in m)])
    assert "jump back by 6" in _said(read)["clock.set"]
    assert len(read.scans) == 60
    assert len(read.imu.stamps_ns) == 600
    assert "points.sent_twice" not in _said(read)


def test_scans_sent_twice_count_once_and_late_ones_in_their_place(tmp_path: Path) -> None:
    """Mutations: not sorted; the second one kept as well; counted among the scans there are."""

    def change(messages: list[build.Message]) -> list[build.Message]:
        scans = [m for m in messages if m[0] == "/velodyne_points"]
        twice = [(t, kind, at + 1000, raw) for t, kind, at, raw in scans[::5]]
        t, kind, at, raw = scans[7]
        rest = [m for m in messages if m is not scans[7]]
        return build.in_order(rest, twice, [(t, kind, at + 130_000_000, raw)])

    read = _spoilt(tmp_path, change)
    said = _said(read)
    assert said["points.sent_twice"].startswith(
        "12 clouds on /velodyne_points have the stamp and the points of another"
    )
    assert said["points.out_of_order"].startswith("1 clouds")
    assert [scan.stamp_ns for scan in read.scans] == [build.EPOCH_NS + k * PERIOD_NS for k in range(60)]
    assert read.scans_total == 60
    plain = _spoilt(tmp_path / "plain", lambda m: m)
    for one, other in zip(read.scans, plain.scans, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def _readings(gravity: float, shaken: float, *, count: int = 3000) -> RawImu:
    """Accelerations around gravity along z, in whatever unit, as a hand shakes it."""
    rng = np.random.default_rng(1)
    stamps_ns = build.EPOCH_NS + 10_000_000 * np.arange(count, dtype=np.int64)
    t = np.arange(count)[:, None] * 0.01
    accel: FloatArray = shaken * np.sin(t * np.array([3.0, 4.1, 5.3])) + np.array([0.0, 0.0, gravity])
    return RawImu(
        stamps_ns, stamps_ns, np.sin(t * np.array([1.0, 2.0, 3.0])) + rng.normal(0, 1e-3, (count, 3)), accel, "imu", 0
    )


@pytest.mark.parametrize(
    ("gravity", "shaken", "code", "words"),
    [
        (0.0, 0.0, "imu.no_accelerations", "are zero, as from a gyroscope without an accelerometer"),
        (0.0, 0.8, "imu.no_gravity", "where 9.8 (m/s²) or 1.0 (g) was expected"),
        (0.0, 0.05, "imu.no_gravity", "do not show gravity"),
        (1000.0, 50.0, "imu.no_gravity", "their norm is 10"),
        (16384.0, 500.0, "imu.no_gravity", "their norm is 16"),
    ],
)
def test_accelerations_without_gravity_are_named(gravity: float, shaken: float, code: str, words: str) -> None:
    """Gyroscopes alone, an attitude filter's linear accelerations, thousandths of g, counts. Each was assumed to be in g, and
    refused half a minute later for planes that are not flat. Mutations: no upper bound; no lower one; the norm's mean instead of
    the mean's norm.
    """
    with pytest.raises(InputError) as caught:
        clean_imu(_readings(gravity, shaken), ReadSettings(), "/imu")
    assert caught.value.code == code
    assert words in str(caught.value)


@pytest.mark.parametrize(("filled_with", "words"), [(0.0, "zero"), (np.nan, "no numbers")])
@pytest.mark.parametrize("silent", ["gyro", "accel"])
def test_a_sensor_that_says_nothing_is_named(silent: str, filled_with: float, words: str) -> None:
    """A dead gyroscope, or a topic that carries accelerations alone (`/camera/accel/sample`); and the other way round.

    Seen: three sentences of walls that did not stand still; readings that were not usable. Mutations: zeros alone; no numbers
    alone; either sensor not asked.
    """
    given = _readings(9.81, 4.0)
    gyro = np.full_like(given.gyro, filled_with) if silent == "gyro" else given.gyro
    accel = np.full_like(given.accel, filled_with) if silent == "accel" else given.accel
    what, whose, code = {
        "gyro": ("angular rates", "an accelerometer without a gyroscope", "imu.no_rates"),
        "accel": ("accelerations", "a gyroscope without an accelerometer", "imu.no_accelerations"),
    }[silent]
    with pytest.raises(InputError) as caught:
        clean_imu(replace(given, gyro=gyro, accel=accel), ReadSettings(), "/camera/accel/sample")
    assert caught.value.code == code
    assert f"The {what} on /camera/accel/sample are {words}, as from {whose}; choose" in str(caught.value)


def test_rest_without_gravity_is_named_however_it_moved_afterwards() -> None:
    """Linear accelerations of a hand that moves slowly average to more than nothing over two seconds; at rest they do not.

    Seen: taken for g, and refused after two minutes for planes that are not flat. Mutation: the mean alone asked.
    """
    given = _readings(0.0, 2.0)
    still = np.arange(3000)[:, None] < 600
    rng = np.random.default_rng(3)
    accel = np.where(still, 0.0, given.accel) + rng.normal(0.0, 0.03, (3000, 3))
    with pytest.raises(InputError, match=r"their norm is 0\.0\d when quietest") as caught:
        clean_imu(replace(given, accel=accel), ReadSettings(), "/imu")
    assert caught.value.code == "imu.no_gravity"


@pytest.mark.parametrize(("gravity", "shaken"), [(9.81, 4.0), (1.0, 0.4), (8.0, 1.0), (1.3, 0.1)])
def test_gravity_however_shaken_and_turned_is_let_through(gravity: float, shaken: float) -> None:
    """Mutation: a tenth more than 1 g is asked for."""
    given = _readings(gravity, shaken)
    # To and fro by 80 deg, in eight seconds.
    angle = np.radians(80.0) * np.sin(np.arange(3000) * 0.01 * 2.0 * np.pi / 8.0)
    turned = gravity * np.stack([np.sin(angle), np.zeros(3000), np.cos(angle) - 1.0], axis=1)
    for accel in (given.accel, given.accel + turned):
        assert len(clean_imu(replace(given, accel=accel), ReadSettings(), "/imu").imu.stamps_ns) == 3000


@pytest.mark.parametrize("memory_bytes", [None, 0])
def test_one_damaged_stamp_of_a_scan_costs_that_scan(
    memory_bytes: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In memory as from the file that holds the scans of a recording of seconds.

    Seen: the file was read before it was mapped, and any recording of usual length ended as a defect. Mutations: that again; it
    counts among the scans that there are.
    """
    if memory_bytes is not None:
        monkeypatch.setattr(scans_of, "MEMORY_BYTES", memory_bytes)

    def change(messages: list[build.Message]) -> list[build.Message]:
        return [m if m != bad else late for m in messages]

    bad = build.velodyne_messages(60, cdr=True)[20]
    body = build.pointcloud2(
        build.velodyne_points(build.sweep(seed=20)),
        cdr=True,
        stamp_ns=build.EPOCH_NS + 20 * PERIOD_NS + 3600 * SECOND_NS,
        frame_id="velodyne",
    )
    late = (*bad[:3], body)
    read = _spoilt(tmp_path, change)
    assert _said(read)["points.malformed"].startswith("1 message on /velodyne_points cannot be decoded")
    assert "its stamp is minutes off" in _said(read)["points.malformed"]
    assert [scan.stamp_ns for scan in read.scans] == [build.EPOCH_NS + k * PERIOD_NS for k in range(60) if k != 20]
    assert read.scans_total == 59


@pytest.mark.parametrize("at", [0, -1])
def test_a_reading_stamped_with_zero_at_either_end_is_no_clock_that_was_set(at: int, tmp_path: Path) -> None:
    """Seen: "jump ahead by 1699999999.92 s". Mutation: stamps as they came."""

    def change(messages: list[build.Message]) -> list[build.Message]:
        readings = [k for k, m in enumerate(messages) if m[0] == "/imu/data"]
        topic, kind, received_ns, _ = messages[readings[at]]
        zero = build.imu_message(0, np.zeros(3), np.array([0.0, 0.0, 9.81]), cdr=True)
        return [(topic, kind, received_ns, zero) if k == readings[at] else m for k, m in enumerate(messages)]

    read = _spoilt(tmp_path, change)
    assert not {"clock.set", "clock.epochs"} & set(_said(read))
    assert read.coarse_offset_ns == 0
    assert len(read.imu.stamps_ns) == 599
    assert len(read.scans) == 60


@pytest.mark.parametrize("damaged", ["nothing", "a scan", "the first scan", "a reading", "the first reading"])
def test_a_damaged_stamp_does_not_move_one_clock_against_the_other(damaged: str, tmp_path: Path) -> None:
    """The IMU counts from its boot, 5 s before the recording. Oracle: EPOCH_NS less those 5 s, known to the latencies of a bag.

    Seen: one scan stamped an hour ahead moved the clocks by that hour, and one reading of zero did by 4.5 ms where they had one
    epoch. Mutations: headers as they came, of the scans; of the IMU.
    """

    def change(messages: list[build.Message]) -> list[build.Message]:
        scans, readings = ([m for m in messages if (m[0] == "/imu/data") == of_imu] for of_imu in (False, True))
        bad = {
            "a scan": scans[20],
            "the first scan": scans[0],
            "a reading": readings[99],
            "the first reading": readings[0],
        }
        rng = np.random.default_rng(5)

        def restamped(message: build.Message) -> build.Message:
            wrong_ns = 3600 * SECOND_NS if message is bad.get(damaged) else 0
            if message[0] != "/imu/data":
                points = build.velodyne_points(build.sweep(seed=1))
                stamp_ns = message[2] - round(1.05 * PERIOD_NS) + wrong_ns
                return (*message[:3], build.pointcloud2(points, cdr=True, stamp_ns=stamp_ns, frame_id="velodyne"))
            stamp_ns = 5 * SECOND_NS + message[2] - build.EPOCH_NS + wrong_ns
            accel = np.array([0.0, 0.0, 9.81]) + rng.normal(0.0, 1e-2, 3)
            return (*message[:3], build.imu_message(stamp_ns, rng.normal(0.0, 1e-3, 3), accel, cdr=True))

        return [restamped(message) for message in messages]

    read = _spoilt(tmp_path, change)
    assert abs(read.coarse_offset_ns - (build.EPOCH_NS - 5 * SECOND_NS)) < PERIOD_NS
    assert "clock.epochs" in _said(read)


def test_a_stamp_is_judged_damaged_among_those_of_its_own_stretch(tmp_path: Path) -> None:
    """The clocks are set by an hour at 2 s of 6, and later one scan and one reading bear a stamp of two hours ahead.

    While both sides are there, nothing tells these from a side. Mutation: judged once, of all (the scan is among those read).
    """
    moved_ns = 3600 * SECOND_NS
    accel, rng = np.array([0.0, 0.0, 9.81]), np.random.default_rng(6)

    def change(messages: list[build.Message]) -> list[build.Message]:
        found: list[build.Message] = []
        counts = {"/imu/data": 0, "/velodyne_points": 0}
        for topic, kind, at_ns, _ in messages:
            wrong_ns = moved_ns if at_ns >= build.EPOCH_NS + 2 * SECOND_NS else 0
            wrong_ns += 2 * moved_ns if counts[topic] == {"/imu/data": 400, "/velodyne_points": 40}[topic] else 0
            counts[topic] += 1
            if topic == "/imu/data":
                body = build.imu_message(at_ns + wrong_ns, rng.normal(0.0, 1e-3, 3), accel, cdr=True)
            else:
                stamp_ns = at_ns - round(1.05 * PERIOD_NS) + wrong_ns
                points = build.velodyne_points(build.sweep(seed=1))
                body = build.pointcloud2(points, cdr=True, stamp_ns=stamp_ns, frame_id="velodyne")
            found.append((topic, kind, at_ns, body))
        return found

    read = _spoilt(tmp_path, change)
    assert "clock.set" in _said(read)
    assert read.scans[-1].stamp_ns < build.EPOCH_NS + moved_ns + 7 * SECOND_NS
    assert read.imu.stamps_ns[-1] < build.EPOCH_NS + moved_ns + 7 * SECOND_NS
    assert "its stamp is minutes off" in _said(read)["points.malformed"]


def test_what_was_skipped_is_counted_from_the_first_scan_there_is(tmp_path: Path) -> None:
    """By the span that was asked for, and by a clock that was set. Oracle: the stamps of the scans.

    Seen: what was asked for was taken for what it left out, by which a time offset held at another instant: a span that begins
    before the recording, or before a lidar that was switched on late, leaves out nothing. Mutations: 0; the span alone; the clock
    alone.
    """
    assert _spoilt(tmp_path / "a", lambda m: m).skipped_s == 0.0
    asked = _spoilt(tmp_path / "b", lambda m: m, ReadSettings(start_s=2.0))
    assert asked.skipped_s == pytest.approx(1e-9 * (asked.scans[0].stamp_ns - build.EPOCH_NS), abs=1e-9)
    assert 1.8 < asked.skipped_s < 2.1
    assert _spoilt(tmp_path / "e", lambda m: m, ReadSettings(start_s=-5.0)).skipped_s == 0.0

    def late(messages: list[build.Message]) -> list[build.Message]:
        return [m for m in messages if m[0] == "/imu/data" or m[2] > build.EPOCH_NS + 3 * SECOND_NS]

    for start_s in (1.0, 2.9):
        assert _spoilt(tmp_path / f"f{start_s}", late, ReadSettings(start_s=start_s)).skipped_s == 0.0
    set_back = _spoilt(tmp_path / "c", _set_back)
    assert set_back.skipped_s == pytest.approx(3.7, abs=0.2)
    assert _spoilt(tmp_path / "d", _set_back, ReadSettings(start_s=1.0)).skipped_s == pytest.approx(3.7, abs=0.2)
