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
    size_bytes: int = Field(description="of the sample")


class InspectOutcome(WireModel):
    """A report was written; read it from the recording."""

    kind: Literal["inspect"] = "inspect"


class PlanesOutcome(WireModel):
    """Planes were proposed; read them from the recording's planes."""

    kind: Literal["planes"] = "planes"
    patches: int = Field(description="planes proposed")
    points: int = Field(description="points of the cloud they were found in")
    static: bool = Field(description="whether the platform stood still while the cloud was taken")


Tone = Literal["good", "doubtful", "bad"]


class SolveOutcome(WireModel):
    """A result was written; read it from /api/results/{job_id}. None where `status` is refused."""

    kind: Literal["solve"] = "solve"
    status: Status = Field(description="as in the result")
    verdict: str = Field(description="one sentence for a person")
    tone: Tone | None = Field(default=None, description="the verdict's colour; null for runs of an older version")
    codes: list[str] = Field(default_factory=list, description="codes of the result's warnings and errors")
    planes_used: int | None = Field(default=None, description="planes that the answer rests on; null for older runs")
    stretches: str = Field(
        default="",
        description="of the answers that stretches of time give by themselves: how many error bars cross zero, and whether "
        "noise explains the number; for a person",
    )
    translation_m: list[float] | None = Field(
        description="of T_imu_lidar: the lidar's origin seen from the IMU, along the IMU's axes"
    )
    euler_xyz_deg: list[float] | None = Field(description="roll, pitch, yaw of T_imu_lidar")
    time_offset_s: float | None = Field(description="to ADD to an IMU stamp to express it in the lidar clock")
    rotation_std_deg: list[float] | None = Field(description="standard deviations about the lidar's axes x, y, z")
    translation_std_m: list[float] | None = Field(description="standard deviations along the IMU's axes x, y, z")
    time_offset_std_s: float | None = Field(description="standard deviation of time_offset_s")
    point_to_plane_rms_m: float | None = Field(
        description="root mean square distance of the points used from their planes"
    )


class AuditOutcome(WireModel):
    """An audit was written; read it from /api/audits/{job_id}."""

    kind: Literal["audit"] = "audit"
    verdict: Verdict = Field(description="unknown: the recording cannot tell")
    text: str = Field(description="one sentence for a person")


class SurfaceOutcome(WireModel):
    """The surface of a solved room was laid; a view of the extent `surface` shows it."""

    kind: Literal["surface"] = "surface"
    triangles: int = Field(description="triangles of the surface")


Outcome = Annotated[
    SimulateOutcome | InspectOutcome | PlanesOutcome | SolveOutcome | AuditOutcome | SurfaceOutcome,
    Field(discriminator="kind"),
]


class InitialGuess(WireModel):
    """Where the solve starts, any subset of the answer's fields; contract's signs and frames."""

    matrix: list[list[float]] | None = Field(default=None, description="T_imu_lidar, 4 rows of 4")
    time_offset_s: OffsetSeconds | None = Field(
        default=None, description="to ADD to an IMU stamp to express it in the lidar clock; null: found by itself"
    )


class NewJob(WireModel):
    """What to run. `settings` and `initial_guess` belong to a solve; its planes are those confirmed now."""

    kind: Literal["inspect", "planes", "solve"] = Field(examples=["solve"], description="what to do")
    settings: CalibrateSettings = Field(default=CalibrateSettings(), description="how to solve")
    initial_guess: InitialGuess | None = Field(
        default=None, description="where the solve starts; null: found by itself"
    )


class PlaneLook(WireModel):
    """A plane of a solve as people see it."""

    name: str = Field(description="as in this run's events and result")
    title: str = Field(description="what it is called today", examples=["wall A"])
    color: str = Field(description="as in the 3D scene", examples=["#0072b2"])
    restricted: bool = Field(default=False, description="whether boxes left part of it out of this run")


class Job(WireModel):
    """One run of a job."""

    id: RecordId = Field(description="of the job; of a solve also that of its result")
    recording_id: RecordId = Field(description="the recording it works on")
    kind: JobKind = Field(description="what it does")
    state: JobState = Field(description="final are done, failed, cancelled and interrupted")
    state_text: str = Field(description="the state in one sentence")
    queue_place: int | None = Field(
        default=None,
        description="its place in the queue; 1 is next; null: it does not wait. Jobs of all clients take turns",
    )
    stage: str | None = Field(
        default=None, description="what it is doing now; null: it does not run, or has not said yet"
    )
    fraction: float = Field(default=0.0, description="how much of this stage is done, 0..1")
    text: str = Field(default="", description="details of the stage, for a person")
    error: ErrorFacts | None = Field(default=None, description="why it failed, or that the server was stopped under it")
    settings: CalibrateSettings = Field(description="how it solves; of another kind of job the defaults")
    planes: list[PlaneLook] = Field(
        default_factory=list, description="planes that were confirmed when a solve was asked for"
    )
    result: Outcome | None = Field(default=None, description="summary of what it made; null until it is done")
    retry_of: RecordId | None = Field(default=None, description="the earlier job that this one repeats; null: none")
    created_at: datetime = Field(description="when it was asked for")
    started_at: datetime | None = Field(default=None, description="when it began to run; null: not yet")
    ended_at: datetime | None = Field(default=None, description="when it reached its final state; null: not yet")


class JobStateEvent(WireModel):
    """The job entered a state. The stream ends after a final one (done, failed, cancelled, interrupted)."""

    event: Literal["state"] = "state"
    job: Job = Field(description="the job in its new state")


JobMessage = Annotated[StageEvent | IterationEvent | LogEvent | JobStateEvent, Field(discriminator="event")]
