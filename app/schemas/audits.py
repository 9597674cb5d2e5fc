"""An audit as it is asked for. Its report goes over the wire as the library has it."""

from __future__ import annotations

from pydantic import Field

from app.schemas.common import WireModel
from calib_core.audit.given import Direction
from calib_core.audit.limits import Limits


class NewAudit(WireModel):
    """An extrinsic in use, held against a recording before any solve."""

    extrinsic: str = Field(
        max_length=200_000,
        description="a result, a URDF, settings of FAST-LIO or LIO-SAM, or a matrix of 4 by 4 numbers",
    )
    direction: Direction = Field(
        default="imu_lidar",
        description="only for bare numbers; imu_lidar: they take lidar coordinates to IMU coordinates; lidar_imu: the other "
        "direction",
    )
    limits: Limits = Field(default=Limits(), description="how far off each axis may be")
