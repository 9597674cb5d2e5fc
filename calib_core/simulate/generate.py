"""A simulation's sweeps made one after the other, and gathered into a Recording in memory."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Unpack

import numpy as np

from calib_core.errors import Cancelled
from calib_core.events import OnEvent, ShouldCancel, StageEvent, ignore_event, never_cancel
from calib_core.simulate.faults.clock import unbundled_ns
from calib_core.simulate.layouts import Cloud, scan_of
from calib_core.simulate.scenario import Scenario
from calib_core.simulate.simulation import STANDARD_GRAVITY_M_S2, Simulation, prepare
from calib_core.simulate.truth import Truth
from calib_core.simulate.wishes import Wishes
from calib_core.types import ImuData, LidarInfo, Recording, Scan

#: Clocks further apart than this have different epochs, and a reader has to compare receive times.
SAME_EPOCH_NS = 10_000_000_000
_N_THREADS = min(4, os.cpu_count() or 1)


def generate(
    scenario: str | Scenario,
    *,
    on_event: OnEvent = ignore_event,
    should_cancel: ShouldCancel = never_cancel,
    **wishes: Unpack[Wishes],
) -> tuple[Recording, Truth]:
    """The recording exactly as reading its bag gives it, and its truth, without a file.

    But for bundles of stamps, which a reader spreads by a period that it has to find, and readings that were sent again, of which
    a reader has to find out that they were.
    """
    simulation = prepare(scenario, **wishes)
    clouds = [
        (scan_of(cloud), simulation.received_ns(cloud) - cloud.stamp_ns)
        for cloud in run(simulation, on_event=on_event, should_cancel=should_cancel)
    ]
    return _recording(simulation, [scan for scan, _ in clouds], [late for _, late in clouds]), simulation.truth


def run(
    simulation: Simulation, *, on_event: OnEvent = ignore_event, should_cancel: ShouldCancel = never_cancel
) -> Iterator[Cloud]:
    """All clouds, one after the other; a few are made ahead on other threads, which NumPy lets run side by side.

    Raises Cancelled.
    """
    n = simulation.n_scans
    waiting: deque[Future[Cloud]] = deque()
    with ThreadPoolExecutor(_N_THREADS) as pool:
        try:
            for index in range(n):
                while len(waiting) < 2 * _N_THREADS and index + len(waiting) < n:
                    waiting.append(pool.submit(simulation.cloud, index + len(waiting)))
                if should_cancel():
                    raise Cancelled("the simulation was stopped before it was complete; nothing was written")
                yield waiting.popleft().result()
                on_event(StageEvent(stage="write", fraction=(index + 1) / n, text=f"scan {index + 1} of {n}"))
        finally:
            for future in waiting:
                future.cancel()


def _recording(simulation: Simulation, scans: list[Scan], latencies_ns: list[int]) -> Recording:
    scenario, records = simulation.scenario, simulation.imu_records
    stamps_ns, first = np.unique(records.stamps_ns, return_index=True)
    if simulation.faults.stamp_bundles_s:
        stamps_ns = unbundled_ns(stamps_ns, simulation.imu_messages.true_ns[first])
    if simulation.faults.imu_repeats > 1:
        fresh = np.diff(records.gyro_rad_s[first], axis=0, prepend=np.nan).any(axis=1)
        stamps_ns, first = stamps_ns[fresh], first[fresh]
    accel = records.accel * (STANDARD_GRAVITY_M_S2 if scenario.imu.accelerometer_unit == "g" else 1.0)
    coarse_ns = 0
    if abs(simulation.truth.time_offset_ns) > SAME_EPOCH_NS:
        imu_late_ns = int(np.median(records.received_ns - records.stamps_ns))
        coarse_ns = imu_late_ns - int(np.median(latencies_ns))
    return Recording(
        name=scenario.slug,
        imu=ImuData(stamps_ns, records.gyro_rad_s[first], accel[first], scenario.imu.topic, scenario.imu.frame_id),
        scans=scans,
        lidar=LidarInfo(
            scenario.lidar.topic,
            scenario.lidar.frame_id,
            scenario.lidar.layout,
            period_s=scenario.lidar.pattern.period_s,
        ),
        duration_s=scenario.duration_s,
        coarse_offset_ns=coarse_ns,
        scans_total=len(scans),
    )
