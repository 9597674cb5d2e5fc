"""Whether the lidar's and the IMU's headers count from the same instant, and if not, how far they are apart."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib_core.types import Clue, Finding, IntArray


class HeaderTimes(NamedTuple):
    """Stamps of one topic's messages in receive order. header_ns, receive_ns: (Q,)."""

    header_ns: IntArray
    receive_ns: IntArray


#: Headers further apart than this are taken for different epochs.
SAME_EPOCH_NS = 10_000_000_000
NS_PER_S = 1_000_000_000
#: Of clouds that span less, such as packets, an IMU that comes as much later by its bus looks the same.
SHORTEST_SWEEP_S = 0.04


def examine_clocks(
    lidar: HeaderTimes, imu: HeaderTimes, *, period_s: float, last_point_s: float, topic: str
) -> tuple[int, tuple[Finding, ...]]:
    """Nanoseconds to add to IMU stamps to bring them near the lidar's clock, and what the stamps give away.

    last_point_s: the sweep's end after the header, as the point times have it.   topic: the lidar's.
    """
    offset_ns, findings = coarse_clock_offset(
        lidar.header_ns, lidar.receive_ns, imu.header_ns, imu.receive_ns, period_s
    )
    if offset_ns:
        return offset_ns, findings
    suspicion = stamp_end_suspicion(
        lidar.receive_ns - lidar.header_ns, imu.receive_ns - imu.header_ns, period_s, last_point_s, topic
    )
    return 0, findings if suspicion is None else (*findings, suspicion)


def coarse_clock_offset(
    lidar_header_ns: IntArray,
    lidar_receive_ns: IntArray,
    imu_header_ns: IntArray,
    imu_receive_ns: IntArray,
    period_s: float,
) -> tuple[int, tuple[Finding, ...]]:
    """Nanoseconds to add to IMU stamps to bring them near the lidar's clock; 0 where the clocks agree to 10 s.

    Both topics were received by one recorder, so receive time minus header time tells each clock's epoch. The least
    latency seen is used, being the least disturbed; a scan is received at its end, hence one period is taken off.
    """
    apart_ns = int(lidar_header_ns[0]) - int(imu_header_ns[0])
    received_apart_ns = int(lidar_receive_ns[0]) - int(imu_receive_ns[0])
    if abs(apart_ns - received_apart_ns) <= SAME_EPOCH_NS:
        return 0, ()
    lidar_lag_ns = int(np.min(lidar_receive_ns - lidar_header_ns)) - round(period_s * NS_PER_S)
    imu_lag_ns = int(np.min(imu_receive_ns - imu_header_ns))
    offset_ns = imu_lag_ns - lidar_lag_ns
    finding = Finding(
        code="clock.epochs",
        level="warning",
        text=f"Lidar and IMU headers count from different instants, {offset_ns / NS_PER_S:.3f} s apart;"
        " they are brought together through the receive times.",
        evidence=(
            Clue("receive minus lidar header", lidar_lag_ns * 1e-9, "s"),
            Clue("receive minus IMU header", imu_lag_ns * 1e-9, "s"),
            Clue("coarse offset", offset_ns, "ns"),
        ),
        confidence=0.9,
        consequence="the time offset of the result holds for these two clocks in this recording only",
        override="--stamps receive",
    )
    return offset_ns, (finding,)


def stamp_end_suspicion(
    lidar_lag_ns: IntArray, imu_lag_ns: IntArray, period_s: float, last_point_s: float, topic: str
) -> Finding | None:
    """A finding where scans arrive sooner after their header than a sweep takes: the stamp is probably the sweep's end.

    lidar_lag_ns, imu_lag_ns: receive minus header of each message, one common clock.   last_point_s: after the header.
    """
    if lidar_lag_ns.size < 10 or imu_lag_ns.size < 10 or last_point_s < max(0.5 * period_s, SHORTEST_SWEEP_S):
        return None
    lag_s = float(np.median(lidar_lag_ns) - np.median(imu_lag_ns)) * 1e-9
    if np.median(np.abs(lidar_lag_ns)) < 1e5:
        return None  # a rewritten recording whose receive times are copies of the headers
    lags = (lidar_lag_ns, imu_lag_ns)
    if any(np.median(np.abs(lag_ns - np.median(lag_ns))) > period_s * NS_PER_S for lag_ns in lags):
        return None  # one whose receive times go another way than its headers: none that somebody received by
    # Nearer to no delay than to a sweep's: in between, two clocks that differ by as much are as likely.
    if lag_s > 0.5 * last_point_s or abs(lag_s) > 2 * period_s:
        return None
    # By the recorder's own clock they come as soon as their last point was taken: it is the IMU whose stamps are early.
    if last_point_s <= float(np.median(lidar_lag_ns)) * 1e-9 <= last_point_s + 0.5 * period_s:
        return None
    after = f"{abs(lag_s) * 1e3:.0f} ms {'after' if lag_s >= 0.0 else 'before'} their header"
    return Finding(
        code="clock.stamp_at_end",
        level="warning",
        text=f"Scans on {topic} arrive {after}, compared with the IMU's stamps, although their last point is"
        f" {last_point_s * 1e3:.0f} ms after it: the stamp is probably the sweep's end.",
        evidence=(Clue("arrival after header", lag_s, "s"), Clue("last point after header", last_point_s, "s")),
        confidence=0.7,
        consequence="a time offset of about one scan period is to be expected",
        override="--point-time-reference header-last",
    )
