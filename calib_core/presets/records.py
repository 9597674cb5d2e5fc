"""What is known of a sensor beforehand."""

from __future__ import annotations

from dataclasses import dataclass

from calib_core.intrinsics import ImuPrior, LidarPrior
from calib_core.settings import ImuNoise


@dataclass(frozen=True, slots=True)
class ImuPreset:
    """One IMU. words: lower-case fragments that identify it in a topic, frame id or the user's own words.

    prior: of its scales, axes and delay. Full scales are none of it: drivers set them, and a sensor at its own shows
    (`imu/clipping.py`).
    """

    name: str
    noise: ImuNoise
    prior: ImuPrior
    source: str
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LidarPreset:
    """One lidar: standard deviation of a range, and the prior of what its lasers do."""

    name: str
    range_std_m: float
    prior: LidarPrior
    source: str
    words: tuple[str, ...]
