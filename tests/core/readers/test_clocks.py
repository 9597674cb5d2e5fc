"""Clock epochs and end-of-sweep stamps, on stamps made from a known offset."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_core.doctor import inspect
from calib_core.readers.load import load
from calib_core.readers.timing.clocks import coarse_clock_offset, stamp_end_suspicion
from calib_core.readers.timing.stamps import plausible_stamps
from calib_core.settings import ReadSettings
from tests.core.readers import build
from tests.core.readers.layouts import LAYOUTS, start_ns

PERIOD_NS = 100_000_000


def lidar_and_imu(imu_epoch_ns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Headers and receive times of 100 scans and 1000 readings; the IMU's clock is imu_epoch_ns behind the lidar's."""
    rng = np.random.default_rng(0)
    true_lidar = build.EPOCH_NS + np.arange(100, dtype=np.int64) * PERIOD_NS
    true_imu = build.EPOCH_NS + np.arange(1000, dtype=np.int64) * 10_000_000
    lidar_receive = true_lidar + PERIOD_NS + rng.integers(1_000_000, 20_000_000, 100)
    imu_receive = true_imu + rng.integers(500_000, 5_000_000, 1000)
    return true_lidar, lidar_receive, true_imu - imu_epoch_ns, imu_receive


@pytest.mark.parametrize("epoch_ns", [37_000_000_000, -1_699_999_000_000_000_001, 1_600_000_000_123_456_789])
def test_epochs_are_brought_together_through_receive_times(epoch_ns: int) -> None:
    """Mutation: return the negative offset; leave the scan period out of the lidar's latency."""
    offset_ns, findings = coarse_clock_offset(*lidar_and_imu(epoch_ns), 0.1)
    assert abs(offset_ns - epoch_ns) < 10_000_000
    assert [f.code for f in findings] == ["clock.epochs"]


def test_one_epoch_needs_nothing() -> None:
    """Mutation: compare with a tenth of a second instead of ten."""
    assert coarse_clock_offset(*lidar_and_imu(-300_000_000), 0.1) == (0, ())


def test_scans_that_arrive_too_early_carry_the_end_stamp() -> None:
    """Mutations: leave the IMU's own latency out (the recorder runs 5 s ahead); drop the test of last_point_s; told of clocks
    that are a third of a sweep apart; told of an IMU that is stamped early.
    """
    header, receive, imu_header, imu_receive = lidar_and_imu(0)
    receive, imu_lag = receive + 5_000_000_000, imu_receive + 5_000_000_000 - imu_header
    assert stamp_end_suspicion(receive - header, imu_lag, 0.1, 0.1, "/p") is None
    late = stamp_end_suspicion(receive - (header + PERIOD_NS), imu_lag, 0.1, 0.1, "/p")
    assert late is not None
    assert "probably the sweep's end" in late.text
    # by one clock with the recorder it comes as its last point was taken: an IMU whose stamps are 80 ms old tells nothing else
    own, early = receive - 5_000_000_000 - header, imu_lag - 5_000_000_000 + 80_000_000
    assert 0.1 < np.median(own) * 1e-9 < 0.15
    assert stamp_end_suspicion(own, early, 0.1, 0.1, "/p") is None
    before = stamp_end_suspicion(own - PERIOD_NS, early, 0.1, 0.1, "/p")
    assert before is not None
    assert "ms before their header" in before.text
    lag = receive - header
    apart = (
        lag - round(float(np.median(lag - np.median(imu_lag)))) + 67_000_000
    )  # arrives after two thirds of its sweep
    assert stamp_end_suspicion(apart, imu_lag, 0.1, 0.1, "/p") is None
    # negative times: the last point is at the header, and it is right that the scan arrives at once
    at_once = receive - (header + PERIOD_NS) - 15_000_000
    assert stamp_end_suspicion(at_once, imu_lag, 0.1, 0.0, "/p") is None
    # nor parts of a sweep, 10 ms each, where the IMU comes 15 ms late
    assert stamp_end_suspicion(np.full(1000, 16_000_000), np.full(1000, 15_000_000), 0.01, 0.01, "/p") is None
    # nor do receive times that go another way than headers: of one instant, a running number
    for wrong in (np.zeros_like(header), np.arange(header.size, dtype=np.int64)):
        assert stamp_end_suspicion(wrong - header, wrong[0] - imu_header, 0.1, 0.1, "/p") is None
    # receive times copied from headers say nothing
    assert stamp_end_suspicion(np.zeros(100, np.int64), np.zeros(1000, np.int64), 0.1, 0.1, "/p") is None


@pytest.mark.parametrize("at_end", [True, False])
def test_a_stamp_of_the_sweeps_end_is_told_by_calibration_and_inspection(tmp_path: Path, at_end: bool) -> None:
    """A whole recording: 5 ms after their header, or 105 ms. Mutations: receive times added to headers; the IMU's stamps in the
    lidar's place; when the last point was taken not handed on; told of every recording.
    """
    early_ns = PERIOD_NS if at_end else 0
    clouds = [
        (topic, kind, receive_ns - early_ns, body)
        for topic, kind, receive_ns, body in build.velodyne_messages(30, cdr=False)
    ]
    path = build.write_ros1(tmp_path / "r.bag", build.in_order(clouds, build.still_imu(3.0, cdr=False)))
    for findings in (load(path, ReadSettings()).findings, inspect(path, ReadSettings()).findings):
        told = [finding for finding in findings if finding.code == "clock.stamp_at_end"]
        assert len(told) == at_end
        assert not any(finding.code == "clock.epochs" for finding in findings)
        if at_end:
            assert "arrive 5 ms after their header" in told[0].text
            assert "their last point is 99 ms after it" in told[0].text


def test_a_clock_that_was_set_is_not_damage() -> None:
    """Mutation: drop MAX_SHARE."""
    header, receive, _, _ = lidar_and_imu(0)
    assert plausible_stamps(header, receive).all()
    damaged = header.copy()
    damaged[[3, 50]] += 3_600_000_000_000
    assert np.flatnonzero(~plausible_stamps(damaged, receive)).tolist() == [3, 50]
    damaged[60:] += 3_600_000_000_000
    assert plausible_stamps(damaged, receive).all()


def test_receive_times_in_place_of_headers(tmp_path: Path) -> None:
    """Mutation: restamp the IMU only; leave absolute point times in their own clock; shift by the first percentile."""
    layout = LAYOUTS["hesai"]
    stream = [
        (layout.topic, layout.type, start_ns(k) + 5_000_000_000, layout.make(k, False).payload) for k in range(12)
    ]
    imu = [(t, kind, r + 5_000_000_000 - 500_000, p) for t, kind, r, p in build.still_imu(1.2, cdr=False)]
    path = build.write_ros1(tmp_path / "r.bag", build.in_order(stream, imu))
    loaded = load(path, ReadSettings(stamps="receive"))
    assert loaded.imu.stamps_ns[0] == build.EPOCH_NS + 5_000_000_000
    for k, scan in enumerate(loaded.scans):
        # absolute seconds in float64 round to a quarter of a microsecond
        assert abs(scan.stamp_ns - (start_ns(k) + 5_000_000_000)) < 500
