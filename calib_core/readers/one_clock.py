"""What of a recording was stamped by one setting of its clocks, each scan once and in order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib_core.readers.imu.messages import RawImu
from calib_core.readers.reading import Reading
from calib_core.readers.scans import OrderCounts
from calib_core.readers.timing.clocks import NS_PER_S, HeaderTimes
from calib_core.readers.timing.resets import reset_finding, resets, resets_of_all, sides
from calib_core.readers.timing.stamps import plausible_stamps
from calib_core.settings import ReadSettings
from calib_core.types import BoolArray, Clue, Finding

#: A scan that is received so many periods after a clock was set may have begun before.
_BEGUN_BEFORE = 2.0


@dataclass(frozen=True, slots=True)
class Stretch:
    """The longest stretch of a recording on which neither clock was set.

    scans: (M,) which of them lie on it.   imu: its messages alone.   findings: what was set, if anything.
    """

    scans: BoolArray
    imu: RawImu
    findings: tuple[Finding, ...]


def longest_stretch(
    lidar: Sequence[HeaderTimes], imu: RawImu, topics: tuple[str, str], period_s: float, start_ns: int
) -> Stretch:
    """Of these messages. lidar: stamps of the same scans, one or more of each, which a clock that is set moves alike.
    topics: the lidar's and the IMU's.   start_ns: the recording's start, receive time.
    """
    # A reading stamped with zero at either end is one damaged stamp, and stays away for as long as there are others.
    good = plausible_stamps(imu.header_ns, imu.receive_ns)
    stamps = HeaderTimes(imu.header_ns[good], imu.receive_ns[good])
    found = sorted([*resets_of_all(lidar, topics[0]), *resets(stamps, topics[1])], key=lambda reset: reset.at_ns)
    received_by_lidar_ns = lidar[0].receive_ns
    if not found:
        return Stretch(np.ones(received_by_lidar_ns.size, dtype=np.bool_), imu, ())
    received_ns = np.concatenate([received_by_lidar_ns, imu.receive_ns])
    begin_ns, end_ns = int(received_ns.min()), int(received_ns.max()) + 1
    used = sides(found, begin_ns, end_ns)
    since_ns, until_ns = used[0]
    settled_ns = since_ns if since_ns == begin_ns else since_ns + round(_BEGUN_BEFORE * period_s * NS_PER_S)
    kept = (imu.receive_ns >= since_ns) & (imu.receive_ns < until_ns)
    cut = replace(
        imu,
        header_ns=imu.header_ns[kept],
        receive_ns=imu.receive_ns[kept],
        gyro=imu.gyro[kept],
        accel=imu.accel[kept],
    )
    scans = (received_by_lidar_ns >= settled_ns) & (received_by_lidar_ns < until_ns)
    return Stretch(scans, cut, (reset_finding(found, used, start_ns),))


def order_findings(counts: OrderCounts, topic: str) -> tuple[Finding, ...]:
    """What is said of clouds that came late, or twice."""
    found: list[Finding] = []
    if counts.twice:
        text = f"{counts.twice} clouds on {topic} have the stamp and the points of another; the first of each was kept."
        found.append(Finding("points.sent_twice", "warning", text, (Clue("clouds sent twice", counts.twice),)))
    if counts.unlike:
        text = (
            f"{counts.unlike} clouds on {topic} have the stamp of another but other points; the first of each was kept,"
            " the others were left out."
        )
        evidence = (Clue("clouds with another's stamp", counts.unlike),)
        found.append(Finding("points.shared_stamps", "warning", text, evidence))
    if counts.moved:
        text = f"{counts.moved} clouds on {topic} came after later ones; they were sorted by stamp."
        found.append(Finding("points.out_of_order", "warning", text, (Clue("clouds moved", counts.moved),)))
    return tuple(found)


def on_one_clock(
    reading: Reading, imu: RawImu, topics: tuple[str, str], period_s: float, settings: ReadSettings
) -> tuple[RawImu, tuple[Finding, ...]]:
    """The IMU's messages of the longest stretch, the scans beside them cut to it and put in order, and what was found."""
    findings: tuple[Finding, ...] = ()
    if settings.stamps == "header":
        stretch = longest_stretch(reading.stamped(), imu, topics, period_s, reading.recording.start_ns)
        if not stretch.scans.all():
            reading.keep(stretch.scans)
        imu, findings = stretch.imu, stretch.findings
    counts = reading.scans.put_in_order()
    if reading.gathering is not None:
        parts = reading.gathering
        counts = OrderCounts(counts.moved, counts.twice + parts.n_twice, counts.unlike + parts.n_unlike)
    reading.n_twice, reading.n_unlike = counts.twice, counts.unlike
    return imu, (*findings, *order_findings(counts, topics[0]))
