"""What of a recording was stamped by one setting of its clocks, each scan once and in order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib_core.readers.imu.messages import RawImu
from calib_core.readers.reading import Reading
from calib_core.readers.timing.clocks import NS_PER_S, HeaderTimes
from calib_core.readers.timing.resets import reset_finding, resets, sides
from calib_core.types import Evidence, Finding

#: A scan that is received so many periods after a clock was set may have begun before.
_BEGUN_BEFORE = 2.0


def on_one_clock(
    reading: Reading, imu: RawImu, topics: tuple[str, str], period_s: float
) -> tuple[RawImu, tuple[Finding, ...]]:
    """The IMU's messages of the longest stretch on which neither clock was set, the scans beside them cut to it, and what was
    found. topics: the lidar's and the IMU's.
    """
    lidar = reading.stamped()
    imu_stamps = HeaderTimes(imu.header_ns, imu.receive_ns)
    found = sorted([*resets(lidar, topics[0]), *resets(imu_stamps, topics[1])], key=lambda reset: reset.at_ns)
    findings: list[Finding] = []
    if found:
        received_ns = np.concatenate([lidar.receive_ns, imu.receive_ns])
        begin_ns, end_ns = int(received_ns.min()), int(received_ns.max()) + 1
        used = sides(found, begin_ns, end_ns)
        (since_ns, until_ns), start_ns = used[0], reading.recording.start_ns
        settled_ns = since_ns if since_ns == begin_ns else since_ns + round(_BEGUN_BEFORE * period_s * NS_PER_S)
        reading.keep((lidar.receive_ns >= settled_ns) & (lidar.receive_ns < until_ns))
        kept = (imu.receive_ns >= since_ns) & (imu.receive_ns < until_ns)
        imu = replace(
            imu,
            header_ns=imu.header_ns[kept],
            receive_ns=imu.receive_ns[kept],
            gyro=imu.gyro[kept],
            accel=imu.accel[kept],
        )
        findings.append(reset_finding(found, used, start_ns))
    n_moved, reading.n_twice = reading.scans.put_in_order()
    reading.n_twice += 0 if reading.gathering is None else reading.gathering.n_twice
    if reading.n_twice:
        text = f"{reading.n_twice} clouds on {topics[0]} bear the stamp of another; the first of each was kept."
        findings.append(Finding("points.sent_twice", "warning", text, (Evidence("scans sent twice", reading.n_twice),)))
    if n_moved:
        text = f"{n_moved} scans on {topics[0]} came after later ones; they were sorted by stamp."
        findings.append(Finding("points.out_of_order", "warning", text, (Evidence("scans moved", n_moved),)))
    return imu, tuple(findings)
