"""Recordings on the wire: what was uploaded, opened or simulated, and what is known of it."""

from __future__ import annotations

from datetime import datetime
from typing import Literal, Self

from pydantic import ConfigDict, Field, model_validator

from app.schemas.common import ErrorFacts, NameInFile, RecordId, WireModel, described_by
from app.schemas.jobs import Job
from calib_core.doctor.report import DoctorReport, Verdict
from calib_core.settings import CalibrateSettings, ReadSettings

Origin = Literal["upload", "folder", "sample"]
RecordingState = Literal["receiving", "inspecting", "ready", "failed"]


class Recording(WireModel):
    """One recording and the last thing that happened to it."""

    id: RecordId = Field(description="of the recording")
    name: str = Field(description="for people; never used as a path", examples=["room.bag"])
    note: str = Field(default="", description="what a person wrote about it")
    size_bytes: int = Field(description="of the source; while receiving, the announced size")
    received_bytes: int = Field(description="how much of an upload has arrived; equals size_bytes afterwards")
    origin: Origin = Field(description="where it came from")
    state: RecordingState = Field(
        description="receiving: its upload or simulation is under way; inspecting: it is being inspected; failed: see `error`"
    )
    error: ErrorFacts | None = Field(default=None, description="why `state` is failed")
    read_settings: ReadSettings = Field(description="how it is read; null in them: detected")
    report: DoctorReport | None = Field(default=None, description="the doctor's report; null until inspected")
    has_planes: bool = Field(description="whether planes have been proposed for it with its present read settings")
    created_at: datetime = Field(description="when it came to the server")
    latest_job: Job | None = Field(default=None, description="the job asked for last; null: none")
    latest_answer: Job | None = Field(
        default=None,
        description="the newest solve that was not refused, whatever was tried since; null where there is none",
    )
    verdict: Verdict | None = Field(
        default=None, description="the report's verdict, present in lists too; null until inspected"
    )


class OpenRecording(WireModel):
    """Open a recording of the server's own folder, or make a sample. Exactly one of the two."""

    folder_path: str | None = Field(default=None, description="path below the server's recordings folder")
    sample: NameInFile | None = Field(
        default=None, description="a scenario named by GET /api/info", examples=["paper-normal"]
    )

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

    model_config = ConfigDict(json_schema_extra=described_by(ReadSettings))

    name: str | None = Field(default=None, min_length=1, max_length=200, description="what people call it")
    note: str | None = Field(default=None, max_length=2000, description="what a person writes about it; empty: nothing")
    lidar_topic: NameInFile | None = None
    imu_topic: NameInFile | None = None
    start_s: float | None = Field(default=None, ge=0, examples=[2.0])
    end_s: float | None = Field(default=None, gt=0, examples=[32.0])
    point_time_field: NameInFile | None = None
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

    start_s: float = Field(description="its beginning")
    end_s: float = Field(description="its end")


class Timeline(WireModel):
    """What the strip below a recording shows. Arrays of readings have one length; times are after the recording's start."""

    duration_s: float = Field(description="time of the last reading or scan, whichever is later")
    t_s: list[float] = Field(description="time of each reading")
    gyro_norm_deg_s: list[float] = Field(description="magnitude of the rate of rotation")
    gyro_x_deg_s: list[float] = Field(description="rate of rotation about the IMU's x axis")
    gyro_y_deg_s: list[float] = Field(description="rate of rotation about the IMU's y axis")
    gyro_z_deg_s: list[float] = Field(description="rate of rotation about the IMU's z axis")
    accel_x_m_s2: list[float] = Field(description="accelerometer's reading along the IMU's x axis, gravity included")
    accel_y_m_s2: list[float] = Field(description="accelerometer's reading along the IMU's y axis, gravity included")
    accel_z_m_s2: list[float] = Field(description="accelerometer's reading along the IMU's z axis, gravity included")
    scan_t_s: list[float] = Field(description="time of each scan's first point")
    scan_points: list[int] = Field(description="valid points of each scan")
    still_spans: list[Span] = Field(description="where neither sensor varies for a second or longer")


class FolderEntry(WireModel):
    """One thing in the server's recordings folder."""

    name: str = Field(description="of the file or folder itself")
    path: str = Field(description="below the recordings folder; give it back as `folder_path` or `path`")
    kind: Literal["file", "folder", "recording"] = Field(
        description="recording: can be opened; folder: can be listed; file: neither"
    )
    size_bytes: int = Field(description="of a file or a recording; 0 of a folder, and of what the server may not read")


class FolderListing(WireModel):
    """A folder below the server's recordings folder."""

    path: str = Field(description="of this folder, below the recordings folder; empty at the top")
    parent: str | None = Field(description="path of the folder above; null at the top")
    entries: list[FolderEntry] = Field(description="what is in it, by name; hidden files are left out")
    links_out: int = Field(
        default=0, description="links that lead out of the recordings folder; they are not followed and are no entries"
    )


class UploadTarget(WireModel):
    """Which recording an upload becomes."""

    recording_id: RecordId = Field(description="of the recording")
    state: RecordingState = Field(description="of the recording")
    received_bytes: int = Field(description="how much of the upload has arrived")


class Sample(WireModel):
    """A recording the server can simulate on the spot."""

    scenario: str = Field(examples=["paper-normal"], description="its name, to be given as `sample`")
    title: str = Field(description="its name for a person")
    text: str = Field(description="what it shows, for a person")


class WeakLimits(WireModel):
    """One standard deviation of a kind of axis."""

    rotation_deg: float = Field(description="about each of the lidar's axes")
    translation_m: float = Field(description="along each of the IMU's axes")
    time_offset_s: float = Field(description="of the time offset")


class UsualNumbers(WireModel):
    """Numbers of the server's own that a page fills in, offers by, or keeps to: it has none of them itself."""

    max_rounds: int = Field(description="CalibrateSettings.max_rounds where nothing else is said")
    paper_points_per_plane_per_scan: int = Field(
        description="points_per_plane_per_scan of the published method where nothing else is said"
    )
    paper_field_of_view_deg: float = Field(
        description="field_of_view_deg of the published method where nothing else is said"
    )
    latitude_gravity_std_m_s2: float = Field(
        description="standard deviation of gravity's magnitude where the latitude is known"
    )
    shortest_span_s: float = Field(description="shortest part of a recording that is worth choosing")
    merge_within_deg: float = Field(
        description="a page offers to merge planes whose directions differ by no more than this"
    )
    merge_within_m: float = Field(description="and whose places differ by no more than this")
    smallest_points: float = Field(description="smallest View.point_scale")
    largest_points: float = Field(description="largest View.point_scale")


class ServerFacts(WireModel):
    """What a client needs to know before anything else."""

    version: str = Field(description="of unsweep")
    recordings_folder: bool = Field(description="whether the server offers a folder of its own recordings")
    max_upload_bytes: int = Field(description="the largest upload that is accepted")
    upload_suffixes: list[str] = Field(description="endings that the name of an upload may have")
    export_formats: list[str] = Field(description="names for GET /api/results/{job_id}/export/{format_name}")
    samples: list[Sample] = Field(description="recordings that the server can simulate")
    limits: WeakLimits = Field(description="standard deviations beyond which an axis is weak")
    usual: UsualNumbers = Field(description="numbers of the server's own")
    solve_settings: CalibrateSettings = Field(description="settings of a solve where nothing else is said")
    axis_names: dict[str, str] = Field(
        description="names of the seven axes for a person, by their names in the result's covariance_order"
    )
    imu_presets: list[str] = Field(description="names of the IMUs whose noise and priors are known")
    lidar_presets: list[str] = Field(description="names of the lidars whose priors are known")


class NewShareLink(WireModel):
    """For how long a link shall show a recording."""

    hours: float = Field(
        default=24.0, gt=0, le=24 * 90, allow_inf_nan=False, description="after so many hours the link ends"
    )


class ShareLink(WireModel):
    """A link that shows one recording, read-only."""

    path: str = Field(description="to be appended to the server's address")
    until: datetime = Field(description="when the link ends")


class Health(WireModel):
    """The server is alive, or ready; anything else is an error body."""

    status: Literal["ok"] = Field(default="ok", description="always ok")
