"""RKO-LIO: both sensors to a base; the base is the IMU here. The quaternion comes before the translation."""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimals, quat_xyzw


def rko_lio(extrinsic: Extrinsic) -> str:
    """Both keys of its config: it takes them together or not at all."""
    pose = f"{decimals(quat_xyzw(extrinsic.R_imu_lidar))}, {decimals(extrinsic.p_imu_lidar)}"
    return (
        extrinsic.hash_comments("The base is the IMU: [qx, qy, qz, qw, x, y, z].", extrinsic.shift_remark())
        + "extrinsic_imu2base_quat_xyzw_xyz: [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]\n"
        + f"extrinsic_lidar2base_quat_xyzw_xyz: [{pose}]\n"
    )
