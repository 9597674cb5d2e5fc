"""Recordings on the wire: what was uploaded, opened or simulated, and what is known of it."""

from __future__ import annotations

from datetime import datetime
from typing import Literal, Self

from pydantic import Field, model_validator

from app.schemas.common import ErrorFacts, RecordId, WireModel
from app.schemas.jobs import Job
from calib_core.doctor.report import DoctorReport, Verdict
from calib_core.settings import CalibrateSettings, ReadSettings

Origin = Literal["upload", "folder", "sample"]
RecordingState = Literal["receiving", "inspecting", "ready", "failed"]


class Recording(WireModel):
    """One recording and the last thing that happened to it."""

    id: RecordId
    name: str = Field(description="for people; never used as a path", examples=["room.bag"])
    note: str = Field(default="", description="what a person wrote about it")
    size_bytes: int = Field(description="of the source; while receiving, the announced size")
    received_bytes: int = Field(description="how much of an upload has arrived; equals size_bytes afterwards")
    origin: Origin
    state: RecordingState
    error: ErrorFacts | None = Field(default=None, description="why `state` is failed")
    read_settings: ReadSettings
    report: DoctorReport | None = Field(default=None, description="the doctor's report; None until inspected")
    has_planes: bool = Field(description="whether planes have been proposed for it as it is read now")
    created_at: datetime
    latest_job: Job | None = None
    latest_answer: Job | None = Field(
        default=None,
        description="the newest solve that was not refused, whatever was tried since; None where there is none",
    )
    verdict: Verdict | None = Field(default=None, description="the doctor's, in lists too; None until inspected")


class OpenRecording(WireModel):
    """Open a recording of the server's own folder, or make a sample. Exactly one of the two."""

    folder_path: str | None = Field(default=None, description="path below the server's recordings folder")
    sample: str | None = Field(default=None, description="a scenario named by GET /api/info", examples=["paper-normal"])

    @model_validator(mode="after")
    def exactly_one(self) -> Self:
        """Refuse a request that names both sources, or none."""
        if (self.folder_path is None) == (self.sample is None):
            raise ValueError("give either folder_path or sample")
        return self


class ChangeRecording(WireModel):
    """What to change of a recording. Fields left out stay; null means: detect it again.

    Any change of a read setting starts a new inspection.
    """

    name: str | None = Field(default=None, min_length=1, max_length=200)
    note: str | None = Field(default=None, max_length=2000, description="what a person writes about it; empty: nothing")
    lidar_topic: str | None = None
    imu_topic: str | None = None
    start_s: float | None = Field(default=None, ge=0, description="seconds after the recording's start", examples=[2.0])
    end_s: float | None = Field(default=None, gt=0, examples=[32.0])
    point_time_field: str | None = None
    point_time_unit: Literal["s", "ms", "us", "ns"] | None = None
    point_time_reference: Literal["header-first", "header-last", "absolute"] | None = None
    synthesise_point_time: bool | None = None
    points_at_once: bool | None = None
    accelerometer_unit: Literal["m_s2", "g"] | None = None
    gyroscope_unit: Literal["rad_s", "deg_s"] | None = None
    stamps: Literal["header", "receive"] | None = None
    imu_bundles: Literal["spread", "as-stamped"] | None = None
    repeated_returns: Literal["once", "as-sent"] | None = None
    range_min_m: float | None = Field(default=None, ge=0)
    range_max_m: float | None = Field(default=None, gt=0)


class Span(WireModel):
    """A time span, seconds after the recording's start."""

    start_s: float
    end_s: float


class Timeline(WireModel):
    """What the strip below a recording shows. All arrays of readings have one length; times after the start."""

    duration_s: float
    t_s: list[float]
    gyro_norm_deg_s: list[float]
    gyro_x_deg_s: list[float]
    gyro_y_deg_s: list[float]
    gyro_z_deg_s: list[float]
    accel_x_m_s2: list[float]
    accel_y_m_s2: list[float]
    accel_z_m_s2: list[float]
    scan_t_s: list[float]
    scan_points: list[int]
    still_spans: list[Span]


class FolderEntry(WireModel):
    """One thing in the server's recordings folder."""

    name: str
    path: str = Field(description="below the recordings folder; give it back as `folder_path` or `path`")
    kind: Literal["file", "folder", "recording"]
    size_bytes: int


class FolderListing(WireModel):
    """A folder below the server's recordings folder. `parent` is None at the top."""

    path: str
    parent: str | None
    entries: list[FolderEntry]
    links_out: int = Field(
        default=0, description="links that lead out of the recordings folder; it is never left, so they are no entries"
    )


class UploadTarget(WireModel):
    """Which recording an upload becomes."""

    recording_id: RecordId
    state: RecordingState
    received_bytes: int


class Sample(WireModel):
    """A recording the server can simulate on the spot."""

    scenario: str = Field(examples=["paper-normal"])
    title: str
    text: str


class WeakLimits(WireModel):
    """One standard deviation of a kind of axis."""

    rotation_deg: float
    translation_m: float
    time_offset_s: float


class UsualNumbers(WireModel):
    """Numbers of the server's own that a page fills in, offers by, or keeps to: it has none of them itself."""

    max_rounds: int = Field(description="of a solve, where nothing else is said")
    paper_points_per_plane_per_scan: int = Field(description="of the published method, where nothing else is said")
    paper_field_of_view_deg: float
    latitude_gravity_std_m_s2: float = Field(description="of gravity, where the latitude is known")
    shortest_span_s: float = Field(description="of a recording, that is worth choosing")
    merge_within_deg: float = Field(description="planes that are offered to be one face the same way within this")
    merge_within_m: float = Field(description="and are as near")
    smallest_points: float = Field(description="size of the scene's points over what their spacing asks for")
    largest_points: float


class ServerFacts(WireModel):
    """What a client needs to know before anything else."""

    version: str
    recordings_folder: bool = Field(description="whether the server offers a folder of its own recordings")
    max_upload_bytes: int
    upload_suffixes: list[str]
    export_formats: list[str]
    samples: list[Sample]
    limits: WeakLimits = Field(description="beyond which standard deviation an axis is weak")
    usual: UsualNumbers
    solve_settings: CalibrateSettings = Field(description="of a solve that is told nothing")
    axis_names: dict[str, str] = Field(description="by the axis's name in the covariance's order")
    imu_presets: list[str] = Field(description="IMUs whose noise is known by name")
    lidar_presets: list[str] = Field(description="lidars of whose lasers it is known what to expect")


class NewShareLink(WireModel):
    """For how long a link shall show a recording."""

    hours: float = Field(default=24.0, gt=0, le=24 * 90, allow_inf_nan=False, description="the link ends after so many")


class ShareLink(WireModel):
    """A link that shows one recording, read-only."""

    path: str = Field(description="to be put behind the server's address")
    until: datetime


class Health(WireModel):
    """The server is alive, or ready; anything else is an error body."""

    status: Literal["ok"] = "ok"
