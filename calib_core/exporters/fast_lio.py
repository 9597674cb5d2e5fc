"""FAST-LIO2 and its relatives: T_imu_lidar as a 3-vector and a row-major list of nine.

FAST-LIO2 and FAST-LIVO2 subtract their time parameter from the IMU's stamp, so it is tau. Point-LIO reads one and never
uses it, so there the stamps have to be shifted.
"""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimals, exact_seconds

_ROS2_REMARK = "In ROS 2 these keys stand under `/**:` and `ros__parameters:`."


def fast_lio(extrinsic: Extrinsic) -> str:
    """Keys `common` and `mapping` of FAST-LIO2's config."""
    return (
        extrinsic.hash_comments(_ROS2_REMARK)
        + f"common:\n    time_offset_lidar_to_imu: {exact_seconds(extrinsic.tau_ns)}\n"
        + _block("mapping", extrinsic)
        + "    extrinsic_est_en: false\n"
    )


def point_lio(extrinsic: Extrinsic) -> str:
    """Key `mapping` of Point-LIO's config."""
    unused = "Point-LIO reads `time_diff_lidar_to_imu` but does not use it."
    return (
        extrinsic.hash_comments(_ROS2_REMARK, unused, extrinsic.shift_remark())
        + _block("mapping", extrinsic)
        + "    extrinsic_est_en: false\n"
    )


def fast_livo2(extrinsic: Extrinsic) -> str:
    """Keys `extrin_calib` and `time_offset` of FAST-LIVO2's config."""
    one = "Leave `lidar_time_offset` at 0: it would shift a second time."
    return (
        extrinsic.hash_comments(_ROS2_REMARK, one)
        + _block("extrin_calib", extrinsic)
        + f"time_offset:\n    imu_time_offset: {exact_seconds(extrinsic.tau_ns)}\n"
    )


def _block(key: str, extrinsic: Extrinsic) -> str:
    rows = (",\n" + " " * 19).join(decimals(row) for row in extrinsic.R_imu_lidar)
    return f"{key}:\n    extrinsic_T: [{decimals(extrinsic.p_imu_lidar)}]\n    extrinsic_R: [{rows}]\n"
