"""What a report shows beside the numbers, measured where the recording is at hand and kept with the job."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from app.schemas.common import WireModel


class Picture(WireModel):
    """Walls seen from above: how many points lie over each square cell, on a scale of logarithms, 0..255."""

    left_m: float
    bottom_m: float
    cell_m: float
    width: int
    height: int
    before: str = Field(description="base64 of height x width bytes, lowest row first; each sweep as rigid")
    after: str = Field(description="the same points de-skewed")


class Binned(WireModel):
    """Signed distances from the nearest planes, by something. NaN never: empty bins are left out."""

    at: list[float] = Field(description="middle of each bin")
    mean_m: list[float]
    rms_m: list[float]
    points: list[int]


class ImuComparison(WireModel):
    """Readings of the IMU over a few lively seconds, and what the solved motion says they should be."""

    t_s: list[float] = Field(description="after the first scan")
    gyro_rad_s: list[list[float]] = Field(description="three axes")
    gyro_predicted_rad_s: list[list[float]]
    accel_m_s2: list[list[float]]
    accel_predicted_m_s2: list[list[float]]
    gyro_rms_rad_s: float = Field(description="of the differences over the whole recording, a bias taken out")
    accel_rms_m_s2: float
    corrected: bool = Field(
        default=False, description="whether what the solve took out of the readings is out of these, too"
    )


class Step(WireModel):
    """One accepted step of the solve."""

    round: int
    cost: float
    euler_xyz_deg: list[float]
    translation_m: list[float]
    time_offset_s: float


class Evidence(WireModel):
    """Everything that a report draws."""

    steps: list[Step]
    room: Picture | None = None
    corner: Picture | None = None
    by_range: Binned | None = None
    by_ring: Binned | None = None
    ranges: Literal["", "as-published", "corrected"] = Field(
        default="",
        description="whether by_range and by_ring are without what the solve took out; empty: as the planes' normals",
    )
    imu: ImuComparison | None = None
