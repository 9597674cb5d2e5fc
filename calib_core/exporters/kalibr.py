"""In the manner of Kalibr's camchain-imucam.yaml. Kalibr itself has no lidar: the keys are named after its camera's.

As its T_cam_imu takes IMU coordinates to the camera's, T_lidar_imu takes them to the lidar's;
t_imu = t_lidar + timeshift.
"""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimal, decimals, exact_seconds


def kalibr_style(extrinsic: Extrinsic) -> str:
    """A block `lidar0` with T_lidar_imu and timeshift_lidar_imu."""
    rows = "".join(
        f"  - [{decimals(row)}, {decimal(float(p))}]\n"
        for row, p in zip(extrinsic.R_lidar_imu, extrinsic.p_lidar_imu, strict=True)
    )
    remark = "The other direction, as in Kalibr: T_lidar_imu takes IMU coordinates to lidar coordinates."
    return (
        extrinsic.hash_comments(remark)
        + "lidar0:\n  T_lidar_imu:\n"
        + rows
        + "  - [0.0, 0.0, 0.0, 1.0]\n"
        + f"  timeshift_lidar_imu: {exact_seconds(extrinsic.tau_ns)}\n"
    )
