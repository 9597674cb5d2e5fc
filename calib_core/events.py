"""Typed progress events: what a long computation tells whoever watches it.

The same models go over the worker's pipe, to the browser as server-sent events, and to stderr with `--log-json`
(one JSON object a line). Times in seconds, angles in degrees: these are for people.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Stage = Literal[
    "read", "inspect", "planes", "track", "initialise", "associate", "solve", "observability", "deskew", "write"
]


#: The stages of a calibration in their order, known before it begins, by method. One that has nothing to do (planes that
#: are given) is left out; none comes back.
PLANNED: dict[Literal["full", "paper"], tuple[Stage, ...]] = {
    "full": ("planes", "track", "initialise", "solve"),
    "paper": ("track", "initialise", "solve"),
}


class _Event(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class StageEvent(_Event):
    """Progress within a stage."""

    event: Literal["stage"] = "stage"
    stage: Stage = Field(description="what the job is doing")
    fraction: float = Field(description="how much of this stage is done, 0..1")
    text: str = Field(default="", description="details, for a person; empty: none")
    kept: bool = Field(default=False, description="nothing had to be done: an earlier run's work is used")


class PlaneResidual(_Event):
    """How far a plane's points are from it now, and where the plane is: n . x + offset_m = 0."""

    name: str = Field(description="of the plane")
    rms_m: float = Field(description="root mean square distance of its points from it, at this step")
    points: int = Field(description="points counted")
    normal: list[float] = Field(
        default_factory=list, description="unit length, in the frame of `sweeps`; empty: not told"
    )
    offset_m: float = Field(default=0.0, description="n . x + offset_m = 0, in the same frame")


class SweepMotion(_Event):
    """Where a step of the solve puts the lidar at a few instants of one sweep, in the frame its planes are told in."""

    stamp_ns: int = Field(description="time of the sweep's first point, lidar clock")
    offset_s: list[float] = Field(description="the instants, after the first point")
    quaternion_xyzw: list[list[float]] = Field(
        description="the lidar's rotation at each instant, x, y, z, w: takes lidar axes to those of that frame"
    )
    position_m: list[list[float]] = Field(description="x, y, z of the lidar's origin at each instant")


class IterationEvent(_Event):
    """One accepted step of the joint solve."""

    event: Literal["iteration"] = "iteration"
    iteration: int = Field(description="steps accepted since the solve began; 1 is the first")
    round: int = Field(description="round of associating points to planes; 1 is the first")
    cost: float = Field(
        description="value that the solve makes small: half the sum of squared, weighted residuals; no unit"
    )
    matrix: list[list[float]] = Field(
        description="T_imu_lidar of this step, 4 rows of 4: homogeneous lidar coordinates to IMU coordinates"
    )
    translation_m: list[float] = Field(description="the lidar's origin seen from the IMU, along the IMU's axes")
    euler_xyz_deg: list[float] = Field(description="roll, pitch, yaw of T_imu_lidar: R = Rz(yaw) Ry(pitch) Rx(roll)")
    time_offset_s: float = Field(description="to ADD to an IMU stamp to express it in the lidar clock")
    # One that is held has nothing but what holds it, and no standard deviation that anybody found.
    rotation_std_deg: list[float | None] = Field(
        description="standard deviations about the lidar's axes x, y, z; null: held in this round"
    )
    translation_std_m: list[float | None] = Field(
        description="standard deviations along the IMU's axes x, y, z; null: held in this round"
    )
    time_offset_std_s: float | None = Field(description="standard deviation of time_offset_s; null: held in this round")
    planes: list[PlaneResidual] = Field(description="each plane of the solve, and how far its points are from it now")
    sweeps: tuple[SweepMotion, ...] = Field(
        default=(), description="the lidar's motion during some sweeps, by this step's estimate"
    )
    gravity_m_s2: list[float] = Field(
        default_factory=list,
        description="gravity vector in the frame of `sweeps`, which need not be the frame of the recording's proposed planes; "
        "empty: not told",
    )


class LogEvent(_Event):
    """A sentence for a person."""

    event: Literal["log"] = "log"
    level: Literal["info", "warning", "error"] = Field(description="how much it matters")
    code: str = Field(description="stable and dotted")
    text: str = Field(description="one sentence for a person")


Event = Annotated[StageEvent | IterationEvent | LogEvent, Field(discriminator="event")]
OnEvent = Callable[[Event], None]
ShouldCancel = Callable[[], bool]


def ignore_event(event: Event) -> None:
    """The listener for callers who do not listen."""


def never_cancel() -> bool:
    """The cancel poll for callers who never cancel."""
    return False


class ForwardOnly:
    """A listener that passes events on, but no progress that goes back: not to an earlier stage, nor within one; and no sentence
    twice, which a second attempt finds again.

    What is done again (a track from another scan, a round) is told in the text; the fraction stays where it was.
    """

    def __init__(self, on_event: OnEvent, stages: tuple[Stage, ...]) -> None:
        self._on_event = on_event
        self._stages = stages
        self._at = 0
        self._fraction = 0.0
        self._said: set[LogEvent] = set()

    def __call__(self, event: Event) -> None:
        """Take an event of the caller's own thread."""
        if isinstance(event, StageEvent) and event.stage in self._stages:
            event = self._forward(event)
        if isinstance(event, LogEvent):
            if event in self._said:
                return
            self._said.add(event)
        self._on_event(event)

    def _forward(self, event: StageEvent) -> StageEvent:
        at = self._stages.index(event.stage)
        if at > self._at:
            self._at, self._fraction = at, event.fraction
        elif at == self._at:
            self._fraction = max(self._fraction, event.fraction)
        return event.model_copy(update={"stage": self._stages[self._at], "fraction": self._fraction})
