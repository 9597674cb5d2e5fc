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
    """Progress within a stage. `fraction` is of this stage, 0..1.   kept: nothing had to be done, as an earlier run had."""

    event: Literal["stage"] = "stage"
    stage: Stage
    fraction: float
    text: str = ""
    kept: bool = False


class PlaneResidual(_Event):
    """Root mean square distance of a plane's points, now; and where the plane is, n . x + offset_m = 0."""

    name: str
    rms_m: float
    points: int
    normal: list[float] = Field(default_factory=list, description="unit, in the frame of `sweeps`; empty: not told")
    offset_m: float = 0.0


class SweepMotion(_Event):
    """Where a step of the solve puts the lidar at a few instants of one sweep, in the frame its planes are told in."""

    stamp_ns: int = Field(description="of the sweep's first point")
    offset_s: list[float] = Field(description="instants after the first point")
    quaternion_xyzw: list[list[float]]
    position_m: list[list[float]]


class IterationEvent(_Event):
    """One accepted step of the joint solve."""

    event: Literal["iteration"] = "iteration"
    iteration: int
    round: int
    cost: float
    matrix: list[list[float]]
    translation_m: list[float]
    euler_xyz_deg: list[float]
    time_offset_s: float
    # One that is held has nothing but what holds it, and no standard deviation that anybody found.
    rotation_std_deg: list[float | None] = Field(description="null: held in this round")
    translation_std_m: list[float | None] = Field(description="null: held in this round")
    time_offset_std_s: float | None = Field(description="null: held in this round")
    planes: list[PlaneResidual]
    sweeps: tuple[SweepMotion, ...] = Field(default=(), description="some sweeps where this step puts them")
    gravity_m_s2: list[float] = Field(
        default_factory=list,
        description="in the frame of `sweeps`, which need not be that of the planes; empty: not told",
    )


class LogEvent(_Event):
    """A sentence for a person."""

    event: Literal["log"] = "log"
    level: Literal["info", "warning", "error"]
    code: str
    text: str


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
