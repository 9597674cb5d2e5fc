"""LI-Init's own result file, for programs that read it: T_imu_lidar, degrees, metres, and tau."""

from __future__ import annotations

from math import degrees

import numpy as np

from calib_core.exporters.extrinsic import Extrinsic, decimal, decimals, exact_seconds
from calib_core.geometry import roll_pitch_yaw_rad


def li_init(extrinsic: Extrinsic) -> str:
    """The lines of Initialization_result.txt, by its labels."""
    angles = " ".join(decimal(degrees(angle)) for angle in roll_pitch_yaw_rad(extrinsic.R_imu_lidar))
    gyroscope, accelerometer = np.array(extrinsic.gyroscope_bias_rad_s), np.array(extrinsic.accelerometer_bias_m_s2)
    gravity = np.array([0.0, 0.0, -extrinsic.gravity_m_s2])
    lines = [
        f"Rotation LiDAR to IMU (degree)     = {angles}",
        f"Translation LiDAR to IMU (meter)   = {decimals(extrinsic.p_imu_lidar, ' ')}",
        f"Time Lag IMU to LiDAR (second)     = {exact_seconds(extrinsic.tau_ns)}",
        f"Bias of Gyroscope  (rad/s)         = {decimals(gyroscope, ' ')}",
        f"Bias of Accelerometer (meters/s^2) = {decimals(accelerometer, ' ')}",
        f"Gravity in World Frame(meters/s^2) = {decimals(gravity, ' ')}",
        "",
        "Homogeneous Transformation Matrix from LiDAR to IMU:",
    ]
    rows = [
        f"{decimals(row, ' ')} {decimal(float(p))}"
        for row, p in zip(extrinsic.R_imu_lidar, extrinsic.p_imu_lidar, strict=True)
    ]
    return extrinsic.hash_comments() + "\n".join([*lines, *rows, "0.0 0.0 0.0 1.0"]) + "\n"
