"""An audit as it is asked for. Its report goes over the wire as the library has it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from app.schemas.common import WireModel
from calib_core.audit.given import Direction
from calib_core.audit.limits import Limits

#: An extrinsic as it was pasted or uploaded, and which way its numbers go where nothing else says so.
GivenText = Annotated[
    str,
    Field(
        max_length=200_000,
        description="a result, a URDF, settings of FAST-LIO or LIO-SAM, or a matrix of 4 by 4 numbers",
    ),
]
GivenDirection = Annotated[
    Direction,
    Field(
        description="only for bare numbers; imu_lidar: they take lidar coordinates to IMU coordinates; lidar_imu: the other "
        "direction",
    ),
]


class NewAudit(WireModel):
    """An extrinsic in use, held against a recording before any solve."""

    extrinsic: GivenText
    direction: GivenDirection = "imu_lidar"
    limits: Limits = Field(default=Limits(), description="how far off each axis may be")
