"""What a caller may wish of a recording to make, written once: keywords of everything that makes one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

from calib_core.simulate.faults import Fault
from calib_core.simulate.sensors import HeaderAt

#: x, y, z [m], then the quaternion x, y, z, w: T_imu_lidar.
Mounting = tuple[float, float, float, float, float, float, float]


class Changes(TypedDict, total=False):
    """What of a scenario is to be another; None, or no word: its own.

    mounting: T_imu_lidar.   noise: False for none.   header_at: which packet stamps a Velodyne cloud.
    """

    mounting: Mounting | None
    time_offset_s: float | None
    duration_s: float | None
    noise: bool
    header_at: HeaderAt | None


class Take(Changes, total=False):
    """Which of its recordings is to be made. seed: of everything random.   salt: numbers that no other recording has."""

    seed: int
    salt: str


class Wishes(Take, total=False):
    """Everything. faults: of sensors, clocks and room."""

    faults: Sequence[Fault]
