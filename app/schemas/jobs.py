"""Jobs on the wire, and the messages their event stream carries."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from app.schemas.common import ErrorFacts, OffsetSeconds, RecordId, WireModel
from calib_core.audit.report import Verdict
from calib_core.events import IterationEvent, LogEvent, StageEvent
from calib_core.result import Status
from calib_core.settings import CalibrateSettings

JobKind = Literal["simulate", "inspect", "planes", "solve", "audit", "surface"]
JobState = Literal["queued", "running", "cancelling", "done", "failed", "cancelled", "interrupted"]


class SimulateOutcome(WireModel):
    """A sample was made."""

    kind: Literal["simulate"] = "simulate"
    size_bytes: int


class InspectOutcome(WireModel):
    """A report was written; read it from the recording."""

    kind: Literal["inspect"] = "inspect"


class PlanesOutcome(WireModel):
    """Planes were proposed; read them from the recording's planes."""

    kind: Literal["planes"] = "planes"
    patches: int
    points: int
    static: bool = Field(description="whether the platform stood still while the cloud was taken")


Tone = Literal["good", "doubtful", "bad"]


class SolveOutcome(WireModel):
    """A result was written; read it from /api/results/{job_id}. None where `status` is refused."""

    kind: Literal["solve"] = "solve"
    status: Status
    verdict: str = Field(description="one sentence for a person")
    tone: Tone | None = Field(default=None, description="the verdict's colour; None of runs of an older version")
    codes: list[str] = Field(default_factory=list, description="of the result's warnings and errors")
    planes_used: int | None = Field(default=None, description="planes that the answer rests on; None of older runs")
    stretches: str = Field(
        default="", description="how many bars of stretches' own answers cross zero, and whether noise explains it"
    )
    translation_m: list[float] | None
    euler_xyz_deg: list[float] | None
    time_offset_s: float | None
    rotation_std_deg: list[float] | None
    translation_std_m: list[float] | None
    time_offset_std_s: float | None
    point_to_plane_rms_m: float | None


class AuditOutcome(WireModel):
    """An audit was written; read it from /api/audits/{job_id}."""

    kind: Literal["audit"] = "audit"
    verdict: Verdict
    text: str = Field(description="one sentence for a person")


class SurfaceOutcome(WireModel):
    """The surface of a solved room was laid; a view of the extent `surface` shows it."""

    kind: Literal["surface"] = "surface"
    triangles: int


Outcome = Annotated[
    SimulateOutcome | InspectOutcome | PlanesOutcome | SolveOutcome | AuditOutcome | SurfaceOutcome,
    Field(discriminator="kind"),
]


class InitialGuess(WireModel):
    """Where the solve starts, any subset of the answer's fields; contract's signs and frames."""

    matrix: list[list[float]] | None = Field(default=None, description="T_imu_lidar, 4 rows of 4")
    time_offset_s: OffsetSeconds | None = None


class NewJob(WireModel):
    """What to run. `settings` and `initial_guess` belong to a solve; its planes are those confirmed now."""

    kind: Literal["inspect", "planes", "solve"] = Field(examples=["solve"])
    settings: CalibrateSettings = CalibrateSettings()
    initial_guess: InitialGuess | None = None


class PlaneLook(WireModel):
    """A plane of a solve as people see it."""

    name: str = Field(description="as in this run's events and result")
    title: str = Field(description="what it is called today", examples=["wall A"])
    color: str = Field(description="as in the 3D scene", examples=["#0072b2"])
    restricted: bool = Field(default=False, description="whether boxes left part of it out of this run")


class Job(WireModel):
    """One run. `fraction` is of the current stage, 0..1."""

    id: RecordId
    recording_id: RecordId
    kind: JobKind
    state: JobState
    state_text: str = Field(description="the state in one sentence")
    queue_place: int | None = Field(
        default=None, description="while it waits: 1 is next; jobs of all clients take turns"
    )
    stage: str | None = None
    fraction: float = 0.0
    text: str = ""
    error: ErrorFacts | None = None
    settings: CalibrateSettings
    planes: list[PlaneLook] = Field(default_factory=list, description="those confirmed when a solve was asked for")
    result: Outcome | None = None
    retry_of: RecordId | None = None
    created_at: datetime
    started_at: datetime | None = None
    ended_at: datetime | None = None


class JobStateEvent(WireModel):
    """The job entered a state. The stream ends after a final one (done, failed, cancelled, interrupted)."""

    event: Literal["state"] = "state"
    job: Job


JobMessage = Annotated[StageEvent | IterationEvent | LogEvent | JobStateEvent, Field(discriminator="event")]
