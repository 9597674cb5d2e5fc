"""LIO-SAM: T_lidar_imu, whatever the comment in its config says: its code turns accelerations with `extrinsicRot`.

`extrinsicRPY` turns the IMU's attitude; it is the same rotation unless that attitude is about other axes.
"""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimals


def lio_sam(extrinsic: Extrinsic) -> str:
    """Keys `extrinsicTrans`, `extrinsicRot`, `extrinsicRPY` of LIO-SAM's params.yaml."""
    remarks = (
        "LIO-SAM wants the other direction: these take IMU coordinates to lidar coordinates.",
        "In ROS 2 these keys stand under `/**:` and `ros__parameters:`.",
        extrinsic.shift_remark(),
    )
    return (
        extrinsic.hash_comments(*remarks)
        + "lio_sam:\n"
        + f"  extrinsicTrans: [{decimals(extrinsic.p_lidar_imu)}]\n"
        + _rotation("extrinsicRot", extrinsic)
        + _rotation("extrinsicRPY", extrinsic)
    )


def _rotation(key: str, extrinsic: Extrinsic) -> str:
    indent = ",\n" + " " * (len(key) + 5)
    return f"  {key}: [{indent.join(decimals(row) for row in extrinsic.R_lidar_imu)}]\n"
