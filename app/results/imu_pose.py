"""Where the IMU is when the lidar is somewhere: both on one rig.

T_map_imu = T_map_lidar T_imu_lidar^-1
"""

from __future__ import annotations

from calib_core.types import FloatArray


def imu_pose(
    R_map_lidar: FloatArray, p_map_lidar: FloatArray, T_imu_lidar: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """R_map_imu (..., 3, 3) and p_map_imu (..., 3) [m], of one pose or of many.   T_imu_lidar: (4, 4)."""
    R_map_imu = R_map_lidar @ T_imu_lidar[:3, :3].T
    return R_map_imu, p_map_lidar - R_map_imu @ T_imu_lidar[:3, 3]
