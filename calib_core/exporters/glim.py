"""GLIM: T_lidar_imu in config_sensors.json, and in config_ros.json a time that is added to the IMU's stamp.

`points_time_offset` is of no use instead: where points carry absolute times GLIM overwrites the stamp after adding it.
"""

from __future__ import annotations

from calib_core.exporters.extrinsic import Extrinsic, decimals, exact_seconds, quat_xyzw


def glim(extrinsic: Extrinsic) -> str:
    """The keys of both files in one document; GLIM's reader takes comments."""
    remarks = (
        "GLIM wants the other direction: T_lidar_imu takes IMU coordinates to lidar coordinates.",
        "Its order is [x, y, z, qx, qy, qz, qw].",
        "`sensors` belongs in config_sensors.json, `glim_ros` in config_ros.json.",
    )
    comments = "".join(f"// {line}\n" for line in (*extrinsic.comments(), *remarks))
    pose = f"{decimals(extrinsic.p_lidar_imu)}, {decimals(quat_xyzw(extrinsic.R_lidar_imu))}"
    return (
        comments
        + "{\n"
        + f'  "sensors": {{\n    "T_lidar_imu": [{pose}]\n  }},\n'
        + f'  "glim_ros": {{\n    "imu_time_offset": {exact_seconds(extrinsic.time_offset_ns)}\n  }}\n'
        + "}\n"
    )
