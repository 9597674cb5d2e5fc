"""What goes into a worker process and what comes out of it, as JSON: no pickled objects cross."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, model_validator

from app.limits import JobLimits
from app.schemas.audits import NewAudit
from app.schemas.common import ErrorFacts, RecordId
from app.schemas.jobs import InitialGuess, JobKind, Outcome
from calib_core.events import IterationEvent, LogEvent, StageEvent
from calib_core.settings import CalibrateSettings, ReadSettings

#: A sample is the same recording for everybody.
SAMPLE_SEED = 1
#: The file of a solve that says how its recording was read.
READING = "reading.json"


class _Parcel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class OrderedPlane(_Parcel):
    """A confirmed plane, map frame: n . x + offset_m = 0. color: its place in the palette, by which it is known.

    outline_m: corners of the convex part that boxes leave of it, in order, map frame; None for all of it.   suggested: it is as
    it was proposed: nobody chose it.
    """

    name: str
    normal: tuple[float, float, float]
    offset_m: float
    color: int | None = None
    outline_m: tuple[tuple[float, float, float], ...] | None = None
    suggested: bool = False


class StoredRequest(_Parcel):
    """What a job was asked for, kept with it: enough to run it again."""

    settings: CalibrateSettings = CalibrateSettings()
    initial_guess: InitialGuess | None = None
    planes: tuple[OrderedPlane, ...] | None = None
    read_settings: ReadSettings | None = Field(
        default=None,
        description="how the recording was read then, which a solve's planes and spans are of; None: unknown",
    )
    source_stamp: str = Field(
        default="", description="what the recording's source was then; '' is unknown, or the only one"
    )
    audit: NewAudit | None = None
    surface_of: RecordId | None = Field(default=None, description="the solve whose room a surface is laid through")
    client: str = Field(default="", max_length=100, description="who asked, for the queue's sake; '' is nobody known")

    @model_validator(mode="before")
    @classmethod
    def _suggested_as_a_whole(cls, kept: object) -> object:
        """Jobs of version 0.1 say of all planes at once whether they are as they were proposed."""
        if not isinstance(kept, dict) or "suggested" not in kept:
            return kept
        planes = [plane | {"suggested": kept["suggested"]} for plane in kept.get("planes") or ()]
        return {name: value for name, value in kept.items() if name != "suggested"} | (
            {"planes": planes} if planes else {}
        )


class Order(_Parcel):
    """One job, complete: the worker knows nothing else."""

    job_id: str
    kind: JobKind
    recording_name: str
    source: Path
    cache: Path = Field(description="the recording's arrays as read with `read_settings`; made if missing")
    folder: Path = Field(description="the job's own folder")
    unpacked: Path | None = Field(
        default=None, description="where the files of a recording's archive are shared by its jobs"
    )
    scenario: str = ""
    read_settings: ReadSettings = ReadSettings()
    source_stamp: str = Field(
        default="", description="of the source that is meant; '' where nobody else can replace it"
    )
    request: StoredRequest = StoredRequest()
    limits: JobLimits | None = Field(default=None, description="None: as much as there is")


class Begun(_Parcel):
    """A process has the job, on this machine or another: its time counts from now. Said again where it is run again."""

    parcel: Literal["begun"] = "begun"


class Happened(_Parcel):
    """Something to tell those who watch."""

    parcel: Literal["event"] = "event"
    event: Annotated[StageEvent | IterationEvent | LogEvent, Field(discriminator="event")]


class Finished(_Parcel):
    """The job is done."""

    parcel: Literal["finished"] = "finished"
    outcome: Outcome


class Failed(_Parcel):
    """The job failed."""

    parcel: Literal["failed"] = "failed"
    error: ErrorFacts


class Stopped(_Parcel):
    """The job stopped because it was asked to."""

    parcel: Literal["stopped"] = "stopped"


Parcel = Annotated[Begun | Happened | Finished | Failed | Stopped, Field(discriminator="parcel")]
PARCEL: TypeAdapter[Begun | Happened | Finished | Failed | Stopped] = TypeAdapter(Parcel)
