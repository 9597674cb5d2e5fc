"""What is served beside a result: runs of a recording, and wall thickness before and after."""

from __future__ import annotations

from pydantic import Field

from app.schemas.common import ErrorFacts, RecordId, WireModel
from app.schemas.jobs import Job
from calib_core.audit.given import Direction


class WallThickness(WireModel):
    """Spread of one plane's points about it. The same points before (sweep as rigid) and after (de-skewed)."""

    name: str
    points: int
    before_rms_m: float
    after_rms_m: float
    before_histogram: list[int]
    after_histogram: list[int]


class Thickness(WireModel):
    """Wall thickness per plane. Histograms count signed distances between consecutive `edges_m`."""

    edges_m: list[float]
    walls: list[WallThickness]
    before_rms_m: float = Field(description="over all walls")
    after_rms_m: float


class ScanQuality(WireModel):
    """How well each scan agrees with the planes, de-skewed; None where the motion does not reach."""

    t_s: list[float] = Field(description="of each scan's first point, after the first scan's")
    rms_m: list[float | None] = Field(description="spread about the nearest planes of the points within 0.3 m of one")
    share: list[float | None] = Field(
        description="points near enough to a plane to be coloured by it in the scene, 0..1"
    )
    points_each: int = Field(description="points looked at of each scan, at most")


class CommandFile(WireModel):
    """A file that the command reads."""

    name: str = Field(examples=["planes.json"])
    text: str


class Command(WireModel):
    """The same calibration on the command line."""

    text: str = Field(examples=["unsweep calibrate room.bag --exclude=12.5:14 --output result.json"])
    files: list[CommandFile] = Field(description="to be saved where the command is run")
    notes: list[str] = Field(description="what the command cannot say")


class ExtrinsicText(WireModel):
    """An extrinsic as it was pasted or uploaded."""

    text: str = Field(max_length=200_000)
    direction: Direction = Field(
        default="imu_lidar", description="of bare numbers: imu_lidar takes lidar coordinates to the IMU's"
    )


class AnswerDifference(WireModel):
    """How far the latest run's answer is from this one's."""

    rotation_deg: float
    translation_m: float
    time_offset_s: float = Field(
        description="at one instant: clocks run apart, and each answer's offset holds at its own"
    )


class Run(WireModel):
    """One solve of the recording. `from_latest` is None for the latest itself and where either has no answer."""

    job: Job
    from_latest: AnswerDifference | None = None
    error: ErrorFacts | None = Field(
        default=None, description="why its result cannot be read: it lies damaged on the disk"
    )


class Runs(WireModel):
    """All solves of a recording, newest first."""

    recording_id: RecordId
    runs: list[Run]
