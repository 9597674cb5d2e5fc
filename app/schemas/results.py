"""What is served beside a result: runs of a recording, and wall thickness before and after."""

from __future__ import annotations

from pydantic import Field

from app.schemas.common import RecordId, WireModel
from app.schemas.jobs import Job


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


class AnswerDifference(WireModel):
    """How far the latest run's answer is from this one's."""

    rotation_deg: float
    translation_m: float
    time_offset_s: float


class Run(WireModel):
    """One solve of the recording. `from_latest` is None for the latest itself and where either has no answer."""

    job: Job
    from_latest: AnswerDifference | None = None


class Runs(WireModel):
    """All solves of a recording, newest first."""

    recording_id: RecordId
    runs: list[Run]
