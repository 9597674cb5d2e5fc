"""The doctor's report: what a recording holds and whether it can be calibrated. JSON as it is; degrees for people.

Times `t_s` count from the recording's first message (receive time) for everything that is drawn over time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from calib_core.plane_kinds import Kind
from calib_core.settings import Axis, ImuNoise

Verdict = Literal["good", "limited", "unusable"]
Axes = tuple[float, float, float]


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class EvidenceReport(_Model):
    """One number behind a finding."""

    name: str
    value: float | int | str
    unit: str = ""


class FindingReport(_Model):
    """types.Finding as JSON."""

    code: str
    level: Literal["info", "warning", "error"]
    text: str
    evidence: tuple[EvidenceReport, ...] = ()
    confidence: float = 1.0
    consequence: str = ""
    override: str = ""


class TopicReport(_Model):
    """One topic. role: what it could serve as here; "packets" for raw packets, decoded or not.

    rate_hz: by the stamps of the lidar and the IMU that are calibrated, 0 until they are read; of others by
    their number, or where they could be calibrated by when they were received.
    """

    name: str
    type: str
    messages: int
    rate_hz: float
    role: Literal["lidar", "imu", "packets", "other"]


class StampReport(_Model):
    """Regularity of one topic's stamps. dropped: messages that the rate says are missing."""

    rate_hz: float
    period_s: float
    jitter_s: float
    duplicates: int
    rewinds: int
    gaps: int
    longest_gap_s: float
    dropped: int


class FieldReport(_Model):
    """One field of the clouds. type: NumPy's name, e.g. "float32"."""

    name: str
    type: str


class PointTimeReport(_Model):
    """How the point times are read; None in LidarReport where the clouds carry none."""

    field: str
    unit: str
    reference: str
    first_after_header_s: float
    last_after_header_s: float
    confidence: float


class RangeReport(_Model):
    """Distances of valid points over the examined scans, and how many points are no return."""

    minimum_m: float
    p05_m: float
    median_m: float
    p95_m: float
    maximum_m: float
    points_per_scan: int
    no_return_share: float


class LidarPresetReport(_Model):
    """Range noise to expect. identified: whether the sensor's name was recognised."""

    name: str
    range_std_m: float
    source: str
    identified: bool


class LidarReport(_Model):
    """The lidar that would be calibrated.

    measured_range_std_m: range noise seen on the planes, which a solve uses; None where no plane could be followed.
    """

    topic: str
    frame_id: str
    layout: str
    scans: int
    rings: int
    stamps: StampReport
    fields: tuple[FieldReport, ...]
    point_time: PointTimeReport | None
    ranges: RangeReport | None
    preset: LidarPresetReport
    measured_range_std_m: float | None = None


class ImuNoiseReport(_Model):
    """Noise densities. origin: "measured", or a preset's name; resolution: the readings' smallest step.

    static_s: of the standstill it was measured in, 0 where it was measured in motion.
    """

    origin: str
    noise: ImuNoise
    source: str
    static_s: float = 0.0
    gyroscope_resolution_rad_s: float = 0.0
    accelerometer_resolution_m_s2: float = 0.0


class SaturationReport(_Model):
    """Largest readings, and the share of readings that sit at the same extreme value."""

    gyroscope_max_rad_s: float
    accelerometer_max_m_s2: float
    gyroscope_clipped_share: float
    accelerometer_clipped_share: float


class Span(_Model):
    """A stretch of time, seconds from the recording's start."""

    start_s: float
    end_s: float


class ExcitationReport(_Model):
    """How much the recording moves. Per axis x y z of the IMU.

    axis_condition: largest over smallest eigenvalue of the mean of omega omega^T; near 1 is turning about all axes.
    rotation_reversals: changes of direction above 5 deg/s, all axes.
    """

    rotation_rms_deg_s: Axes
    rotation_peak_deg_s: Axes
    angular_acceleration_peak_deg_s2: Axes
    acceleration_rms_m_s2: Axes
    axis_condition: float
    rotation_reversals: int
    weakest_axis: Axes
    weakest_axis_rms_deg_s: float
    moving_s: float


class ImuReport(_Model):
    """The IMU that would be calibrated.

    noise_used: by a solve that is not told otherwise: "measured" in a standstill, or "moving": what no motion explains.
    noise_text: both numbers and which is used, for a person.
    """

    topic: str
    frame_id: str
    readings: int
    stamps: StampReport
    accelerometer_unit: str
    gyroscope_unit: str
    gravity_at_rest_m_s2: float
    saturation: SaturationReport
    excitation: ExcitationReport
    still_spans: tuple[Span, ...]
    measured_noise: ImuNoiseReport | None
    preset_noise: ImuNoiseReport
    preset_identified: bool
    noise_used: Literal["measured", "moving", "preset"]
    noise_text: str = ""


class Timeline(_Model):
    """Arrays for plots, about 10 Hz, all of one length; means over each step. scan_t_s has one entry per scan."""

    t_s: tuple[float, ...] = ()
    rotation_deg_s: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]] = ((), (), ())
    rotation_norm_deg_s: tuple[float, ...] = ()
    acceleration_m_s2: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]] = ((), (), ())
    scan_t_s: tuple[float, ...] = ()


class ParameterForecast(_Model):
    """Standard deviation to expect of one parameter of the calibration; units as in the result document.

    advice: what to record to know it, "" where it is known or nothing can be said.
    """

    name: Axis
    std: float
    unit: Literal["deg", "m", "s"]
    weak: bool
    advice: str = ""


class Forecast(_Model):
    """What a solve of this recording would know, before it is run.

    text: for a person.   parameters: all seven, or none where `reason` says why, under the stable `code`.
    weak: a sentence for each direction that stays weak.   planes: names of those it rests on.   advice: what to record.
    covered_s: seconds that could be followed and that the numbers rest on, standstill included.
    """

    text: str = ""
    parameters: tuple[ParameterForecast, ...]
    weak: tuple[str, ...] = ()
    planes: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    reason: str = ""
    code: str = ""
    covered_s: float = 0.0


class PlaneReport(_Model):
    """One plane that can be expected.

    tilt_deg: between the plane and the horizontal, None (and kind "plane") where gravity is not known.   distance_m: from
    the lidar.   points, rms_m: of the sampled points on it.   normal: of unit length, towards the lidar, lidar axes at the
    reference scan; None in reports of older versions.   doubt: what seems wrong with it, so that a solve would leave it out, as
    said of it: "does not seem to stand still"; "" where nothing does.
    """

    name: str
    kind: Kind
    tilt_deg: float | None
    area_m2: float
    distance_m: float
    points: int
    rms_m: float
    normal: Axes | None = None
    doubt: str = ""


class PlanesReport(_Model):
    """The planes that can be expected, largest first.

    determinacy: 0 where some direction of the lidar's motion is seen by none, 1 for three equal ones at right angles.
    determined: whether they fix the lidar's pose.   text: for a person.   up: unit vector against gravity in the frame of
    the normals; None where gravity is not known.
    """

    planes: tuple[PlaneReport, ...]
    determinacy: float
    determined: bool
    text: str
    up: Axes | None = None


class DoctorReport(_Model):
    """The whole report.

    final: False for what is known on the way: what is None or empty may still be found, and the verdict be another.
    """

    schema_: Literal["unsweep.report/1"] = Field(default="unsweep.report/1", alias="schema")
    name: str
    size_bytes: int
    container: Literal["ros1", "ros2"]
    duration_s: float
    start_ns: int
    topics: tuple[TopicReport, ...]
    lidar_candidates: tuple[str, ...]
    imu_candidates: tuple[str, ...]
    lidar: LidarReport | None
    imu: ImuReport | None
    clock_offset_s: float
    timeline: Timeline
    findings: tuple[FindingReport, ...]
    verdict: Verdict
    reasons: tuple[str, ...]
    advice: tuple[str, ...]
    planes: PlanesReport | None = None
    forecast: Forecast | None = None
    final: bool = True

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True
    )

    def to_json(self) -> str:
        """The report as indented JSON text, ending in a newline."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


#: Who listens for reports on the way.
OnReport = Callable[[DoctorReport], None]
