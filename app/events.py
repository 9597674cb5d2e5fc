"""What happens in the application, told over the bus: one frozen record a kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.errors import ApiError
from app.schemas.jobs import Job
from app.schemas.view import View
from app.storage.records import JobRecord, RecordingRecord
from calib_core.events import LogEvent


@dataclass(frozen=True, slots=True)
class Event:
    """Anything that happens."""


@dataclass(frozen=True, slots=True)
class JobMoved(Event):
    """A job entered a state; told from whatever thread brought it there."""

    record: JobRecord
    job: Job


@dataclass(frozen=True, slots=True)
class QueueMoved(Event):
    """Jobs that wait have another place in the queue now."""

    jobs: Sequence[Job]


@dataclass(frozen=True, slots=True)
class JobStepped(Event):
    """A solve made a step."""

    recording_id: str


@dataclass(frozen=True, slots=True)
class JobSaid(Event):
    """A job said a sentence."""

    record: JobRecord
    said: LogEvent


@dataclass(frozen=True, slots=True)
class RecordingArrived(Event):
    """A recording is complete, or is to be read another way: it can be inspected."""

    record: RecordingRecord


@dataclass(frozen=True, slots=True)
class SampleWanted(Event):
    """A sample is to be made."""

    record: RecordingRecord


@dataclass(frozen=True, slots=True)
class RecordingEdited(Event):
    """A recording's name or its read settings changed."""

    recording_id: str


@dataclass(frozen=True, slots=True)
class RecordingDeleted(Event):
    """A recording is gone, and its files."""

    recording_id: str


@dataclass(frozen=True, slots=True)
class PlanesEdited(Event):
    """A recording's planes changed."""

    recording_id: str
    revision: int


@dataclass(frozen=True, slots=True)
class ShownChanged(Event):
    """Something that a recording's scene is made of changed."""

    recording_id: str


@dataclass(frozen=True, slots=True)
class ViewEdited(Event):
    """A recording's view changed."""

    recording_id: str
    view: View


@dataclass(frozen=True, slots=True)
class ClickWasRefused(Event):
    """What was clicked or drawn in a scene cannot be done."""

    recording_id: str
    error: ApiError
