"""Autoware's sensor_kit_calibration.yaml: poses of the sensors in the kit's frame.

A calibration of two sensors knows nothing of the kit. The kit is put at the lidar here, so the IMU's pose is
T_lidar_imu; with the lidar elsewhere, T_kit_imu = T_kit_lidar T_lidar_imu.
"""

from __future__ import annotations

import re

from calib_core.exporters.extrinsic import Extrinsic, decimal
from calib_core.geometry import roll_pitch_yaw_rad

_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
_PLAIN = re.compile(r"[A-Za-z_][\w./-]*")
#: What readers of YAML take for something else than text.
_WORDS = frozenset({"true", "false", "yes", "no", "on", "off", "y", "n", "null"})


def autoware(extrinsic: Extrinsic) -> str:
    """Entries for both sensors under `sensor_kit_base_link`, metres and radians."""
    remarks = (
        "The kit's frame is put at the lidar; if yours is elsewhere, T_kit_imu = T_kit_lidar * T_lidar_imu.",
        "Your lidar's entry may name its mount, with a further offset to the data's frame: check its xacro.",
        extrinsic.shift_remark(),
    )
    pose = (*(float(value) for value in extrinsic.p_lidar_imu), *roll_pitch_yaw_rad(extrinsic.R_lidar_imu))
    return (
        extrinsic.hash_comments(*remarks)
        + "sensor_kit_base_link:\n"
        + _entry(extrinsic.lidar_frame, (0.0,) * 6)
        + _entry(extrinsic.imu_frame, pose)
    )


def _entry(frame: str, pose: tuple[float, ...]) -> str:
    lines = "".join(f"    {key}: {decimal(value)}\n" for key, value in zip(_KEYS, pose, strict=True))
    return f"  {_key(frame)}:\n{lines}"


def _key(frame: str) -> str:
    """A frame's name as a key that YAML reads as text: `1` and `on` would be a number and a truth."""
    return frame if _PLAIN.fullmatch(frame) and frame.lower() not in _WORDS else f'"{frame}"'
