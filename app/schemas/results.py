"""What is served beside a result: runs of a recording, and wall thickness before and after."""

from __future__ import annotations

from pydantic import Field

from app.schemas.audits import GivenDirection, GivenText
from app.schemas.common import ErrorFacts, RecordId, WireModel
from app.schemas.jobs import Job


class WallThickness(WireModel):
    """Spread of one plane's points about it. The same points before (sweep as rigid) and after (de-skewed)."""

    name: str = Field(description="of the plane")
    points: int = Field(description="points counted")
    before_rms_m: float = Field(description="root mean square distance from the plane, sweep as rigid")
    after_rms_m: float = Field(description="the same, de-skewed")
    before_histogram: list[int] = Field(description="points in each bin, sweep as rigid")
    after_histogram: list[int] = Field(description="points in each bin, de-skewed")


class Thickness(WireModel):
    """Wall thickness per plane. Histograms count signed distances from the plane between consecutive `edges_m`."""

    edges_m: list[float] = Field(
        description="edges of the bins: signed distance from the plane; one more than there are bins"
    )
    walls: list[WallThickness] = Field(description="each plane of the result")
    before_rms_m: float = Field(description="over all walls, sweep as rigid")
    after_rms_m: float = Field(description="over all walls, de-skewed")


class ScanQuality(WireModel):
    """How well each scan agrees with the planes, de-skewed; None where the motion does not reach."""

    t_s: list[float] = Field(description="time of each scan's first point, after the first scan's")
    rms_m: list[float | None] = Field(
        description="root mean square distance of its points from their nearest planes; points farther than 0.3 m from any "
        "plane are left out"
    )
    share: list[float | None] = Field(
        description="share of its points that are near enough to a plane to have its colour in the scene, 0..1"
    )
    points_each: int = Field(description="the most points looked at in each scan")


class CommandFile(WireModel):
    """A file that the command reads."""

    name: str = Field(examples=["planes.json"], description="of the file")
    text: str = Field(description="what is in it")


class Command(WireModel):
    """The same calibration on the command line."""

    text: str = Field(
        examples=["unsweep calibrate room.bag --exclude=12.5:14 --output result.json"], description="the command line"
    )
    files: list[CommandFile] = Field(description="to be saved where the command is run")
    notes: list[str] = Field(description="what the command cannot say")


class ExtrinsicText(WireModel):
    """An extrinsic as it was pasted or uploaded."""

    text: GivenText
    direction: GivenDirection = "imu_lidar"


class AnswerDifference(WireModel):
    """How far the latest run's answer is from this one's."""

    rotation_deg: float = Field(description="angle between the two rotations")
    translation_m: float = Field(description="distance between the two translations")
    time_offset_s: float = Field(
        description="difference of the time offsets at one instant: the clocks run at different rates, and each answer's "
        "offset holds at an instant of its own"
    )


class Run(WireModel):
    """One solve of the recording. `from_latest` is None for the latest itself and where either has no answer."""

    job: Job = Field(description="the solve")
    from_latest: AnswerDifference | None = Field(default=None, description="how far the latest answer is from this one")
    error: ErrorFacts | None = Field(
        default=None, description="why its result cannot be read: the file on the disk is damaged"
    )


class Runs(WireModel):
    """All solves of a recording, newest first."""

    recording_id: RecordId = Field(description="the recording that was solved")
    runs: list[Run] = Field(description="newest first")
