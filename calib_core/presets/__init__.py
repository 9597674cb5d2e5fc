"""Noise, random walks and own parameters of common IMUs and lidars by name, each with where the numbers come from.

A preset is the fallback: what a static start measures is preferred to its noise, and what a recording determines of its
scales, axes and offsets replaces its prior. `unconfirmed` in a source: the figure is the data sheet's as commonly quoted,
and nobody held it against the sheet itself.
"""

from __future__ import annotations

from calib_core.presets.find import (
    by_preset_names,
    find_imu_preset,
    find_imu_prior,
    find_lidar_preset,
    find_lidar_prior,
    named_imu,
    named_lidar,
    random_walks,
)
from calib_core.presets.imu import GENERIC_IMU, IMU_PRESETS
from calib_core.presets.lidar import GENERIC_LIDAR, LIDAR_PRESETS
from calib_core.presets.records import ImuPreset, LidarPreset
from calib_core.presets.walks import USUAL_WALK

__all__ = [
    "GENERIC_IMU",
    "GENERIC_LIDAR",
    "IMU_PRESETS",
    "LIDAR_PRESETS",
    "USUAL_WALK",
    "ImuPreset",
    "LidarPreset",
    "by_preset_names",
    "find_imu_preset",
    "find_imu_prior",
    "find_lidar_preset",
    "find_lidar_prior",
    "named_imu",
    "named_lidar",
    "random_walks",
]
