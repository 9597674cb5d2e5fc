"""ROS: a static transform from the IMU (parent) to the lidar (child); the child's pose in the parent is T_imu_lidar."""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimal, decimals, quat_xyzw
from calib_core.geometry import roll_pitch_yaw_rad


def tf2_ros1(extrinsic: Extrinsic) -> str:
    """A command of tf2_ros in ROS 1: x y z qx qy qz qw parent child. The package `tf` would want a period behind it."""
    place, quat = decimals(extrinsic.p_imu_lidar, " "), decimals(quat_xyzw(extrinsic.R_imu_lidar), " ")
    frames = f"{extrinsic.imu_frame} {extrinsic.lidar_frame}"
    command = f"rosrun tf2_ros static_transform_publisher {place} {quat} {frames}\n"
    return extrinsic.hash_comments(extrinsic.shift_remark()) + command


def tf2_ros2(extrinsic: Extrinsic) -> str:
    """A command of tf2_ros in ROS 2, with named options: the bare numbers are deprecated there."""
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    values = (*extrinsic.p_imu_lidar, *quat_xyzw(extrinsic.R_imu_lidar))
    numbers = " ".join(f"--{name} {decimal(float(value))}" for name, value in zip(names, values, strict=True))
    frames = f"--frame-id {extrinsic.imu_frame} --child-frame-id {extrinsic.lidar_frame}"
    command = f"ros2 run tf2_ros static_transform_publisher {numbers} {frames}\n"
    return extrinsic.hash_comments(extrinsic.shift_remark()) + command


def urdf(extrinsic: Extrinsic) -> str:
    """A fixed joint; rpy turns about fixed axes, in radians."""
    lines = [f"<!-- {line} -->" for line in (*extrinsic.comments(), extrinsic.shift_remark())]
    angles = " ".join(decimal(angle) for angle in roll_pitch_yaw_rad(extrinsic.R_imu_lidar))
    name = f"{extrinsic.imu_frame}_to_{extrinsic.lidar_frame}".replace("/", "_")
    lines += [
        f'<joint name="{name}" type="fixed">',
        f'  <parent link="{extrinsic.imu_frame}"/>',
        f'  <child link="{extrinsic.lidar_frame}"/>',
        f'  <origin xyz="{decimals(extrinsic.p_imu_lidar, " ")}" rpy="{angles}"/>',
        "</joint>",
    ]
    return "\n".join(lines) + "\n"
