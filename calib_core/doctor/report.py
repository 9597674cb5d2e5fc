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

    name: str = Field(description="what the number is, in words")
    value: float | int | str = Field(description="the number, or a word")
    unit: str = Field(default="", description="unit of value; empty: none")


class FindingReport(_Model):
    """types.Finding as JSON."""

    code: str = Field(description="stable and dotted, such as points.time_field")
    level: Literal["info", "warning", "error"] = Field(description="how much it matters")
    text: str = Field(description="what was found; one sentence for a person")
    evidence: tuple[EvidenceReport, ...] = Field(default=(), description="the numbers behind it")
    confidence: float = Field(default=1.0, description="how sure it is, 0..1")
    consequence: str = Field(default="", description="what follows from it, for a person; empty: nothing to say")
    override: str = Field(
        default="",
        description="the option of `unsweep calibrate` that replaces the detection, such as --point-time-unit ns, or what to "
        "do; empty: none",
    )


class TopicReport(_Model):
    """One topic of the recording."""

    name: str = Field(description="of the topic")
    type: str = Field(description="message type, such as sensor_msgs/msg/Imu")
    messages: int = Field(description="how many messages it has")
    rate_hz: float = Field(
        description="messages per second: by their stamps where lidar and IMU were read, 0 until then; by their receive times "
        "or their number on other topics"
    )
    role: Literal["lidar", "imu", "packets", "other"] = Field(
        description="what it could serve as; packets: a lidar's raw packets, whether or not they can be decoded"
    )


class StampReport(_Model):
    """How regular one topic's stamps are."""

    rate_hz: float = Field(description="messages per second where none is missing")
    period_s: float = Field(description="usual step between two stamps")
    jitter_s: float = Field(description="standard deviation of the stamps about an even row")
    duplicates: int = Field(description="stamps equal to another one")
    rewinds: int = Field(description="times that a stamp is earlier than the one received before it")
    gaps: int = Field(description="steps longer than 3.5 periods")
    longest_gap_s: float = Field(description="the longest of these steps; 0: there is none")
    dropped: int = Field(description="messages that are missing, judged by the rate")


class FieldReport(_Model):
    """One field of the clouds."""

    name: str = Field(description="of the field")
    type: str = Field(description="NumPy's name of its type, such as float32")


class PointTimeReport(_Model):
    """How the point times are read; None in LidarReport where the clouds carry none."""

    field: str = Field(description="field of the clouds that holds the times")
    unit: str = Field(description="unit of the field: s, ms, us or ns")
    reference: str = Field(
        description="what the times count from: header-first and header-last: the header, which is the first or the last "
        "point's time; absolute: the clock's own epoch"
    )
    first_after_header_s: float = Field(description="time of a scan's first point minus that of its header")
    last_after_header_s: float = Field(description="time of a scan's last point minus that of its header")
    confidence: float = Field(description="how sure the detection is, 0..1")


class RangeReport(_Model):
    """Distances of valid points over the examined scans, and how many points are no return."""

    minimum_m: float = Field(description="least distance from the lidar")
    p05_m: float = Field(description="5 % of the points are nearer")
    median_m: float = Field(description="half of the points are nearer")
    p95_m: float = Field(description="95 % of the points are nearer")
    maximum_m: float = Field(description="greatest distance from the lidar")
    points_per_scan: int = Field(description="median number of valid points in a scan")
    no_return_share: float = Field(description="share of the points sent that are no return, 0..1")


class LidarPresetReport(_Model):
    """Range noise to expect."""

    name: str = Field(description="of the preset")
    range_std_m: float = Field(description="standard deviation of one range, along the beam")
    source: str = Field(description="where the number is from")
    identified: bool = Field(
        description="whether the sensor was recognised by its name; false: the preset of an unknown lidar"
    )


class LidarReport(_Model):
    """The lidar that would be calibrated."""

    topic: str = Field(description="topic of its clouds")
    frame_id: str = Field(description="frame named in the clouds' headers")
    layout: str = Field(description="name of the recognised field layout")
    scans: int = Field(description="how many clouds were read")
    rings: int = Field(description="most different ring numbers in one examined scan")
    stamps: StampReport = Field(description="how regular the clouds' header stamps are")
    fields: tuple[FieldReport, ...] = Field(description="fields of the first cloud")
    point_time: PointTimeReport | None = Field(
        description="how the point times are read; null where the clouds carry none"
    )
    ranges: RangeReport | None = Field(description="distances in the examined scans; null where none could be decoded")
    preset: LidarPresetReport = Field(description="what is known of this lidar beforehand")
    measured_range_std_m: float | None = Field(
        default=None,
        description="range noise seen on the planes, which a solve uses; null where no plane could be followed",
    )


class ImuNoiseReport(_Model):
    """Noise densities of the IMU, measured or from a preset."""

    origin: str = Field(description="measured, or the name of a preset")
    noise: ImuNoise = Field(description="the noise densities")
    source: str = Field(description="what they were measured from, or where the preset's are from; for a person")
    static_s: float = Field(
        default=0.0,
        description="length of the standstill they were measured in; 0: they were measured in motion, or are a preset's",
    )
    gyroscope_resolution_rad_s: float = Field(
        default=0.0, description="smallest step between its readings, of the coarsest axis; 0: not measured"
    )
    accelerometer_resolution_m_s2: float = Field(
        default=0.0, description="smallest step between its readings, of the coarsest axis; 0: not measured"
    )


class SaturationReport(_Model):
    """Largest readings, and the share of readings that sit at the same extreme value."""

    gyroscope_max_rad_s: float = Field(description="largest reading of any axis, without its sign")
    accelerometer_max_m_s2: float = Field(description="largest reading of any axis, without its sign")
    gyroscope_clipped_share: float = Field(description="share of its readings that are at the end of its range, 0..1")
    accelerometer_clipped_share: float = Field(
        description="share of its readings that are at the end of its range, 0..1"
    )


class Span(_Model):
    """A stretch of time, seconds from the recording's start."""

    start_s: float = Field(description="its beginning")
    end_s: float = Field(description="its end")


class ExcitationReport(_Model):
    """How much the recording moves. Three numbers are those of the IMU's axes x, y, z."""

    rotation_rms_deg_s: Axes = Field(description="root mean square rate of rotation while moving, without the bias")
    rotation_peak_deg_s: Axes = Field(description="rate of rotation that 99.5 % of the moving readings stay below")
    angular_acceleration_peak_deg_s2: Axes = Field(
        description="angular acceleration that 99.5 % of the moving readings stay below"
    )
    acceleration_rms_m_s2: Axes = Field(description="standard deviation of the accelerometer's readings while moving")
    axis_condition: float = Field(
        description="largest over smallest eigenvalue of the mean of omega omega^T; near 1: turns about all axes alike"
    )
    rotation_reversals: int = Field(
        description="changes of the direction of rotation at more than 5 deg/s, all axes together"
    )
    weakest_axis: Axes = Field(description="unit vector, IMU axes, about which the rig turned least")
    weakest_axis_rms_deg_s: float = Field(description="root mean square rate of rotation about it")
    moving_s: float = Field(description="how long the rig moved")


class ImuReport(_Model):
    """The IMU that would be calibrated."""

    topic: str = Field(description="topic of its readings")
    frame_id: str = Field(description="frame named in the readings' headers")
    readings: int = Field(description="how many readings were read")
    stamps: StampReport = Field(description="how regular the readings' stamps are")
    accelerometer_unit: str = Field(description="unit in which they were sent, as detected or as told: m_s2 or g")
    gyroscope_unit: str = Field(description="unit in which they were sent, as detected or as told: rad_s or deg_s")
    gravity_at_rest_m_s2: float = Field(
        description="median norm of the acceleration at rest; over all readings where the rig never rests"
    )
    saturation: SaturationReport = Field(description="largest readings, and clipping")
    excitation: ExcitationReport = Field(description="how much the rig moves")
    still_spans: tuple[Span, ...] = Field(description="where the rig stands still for a second or longer")
    measured_noise: ImuNoiseReport | None = Field(
        description="noise measured in this recording; null where there are too few readings"
    )
    preset_noise: ImuNoiseReport = Field(description="noise by data sheet, of the recognised IMU or of an unknown one")
    preset_identified: bool = Field(description="whether the IMU was recognised by its name")
    noise_used: Literal["measured", "moving", "preset"] = Field(
        description="which noise a solve uses unless told otherwise: measured in a standstill, measured while moving, or the "
        "preset's"
    )
    noise_text: str = Field(default="", description="both numbers and which is used, for a person")


class Timeline(_Model):
    """Arrays for plots, means over steps of 0.1 s or longer. All have one length, except scan_t_s."""

    t_s: tuple[float, ...] = Field(default=(), description="middle of each step, seconds from the recording's start")
    rotation_deg_s: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]] = Field(
        default=((), (), ()), description="mean rate of rotation about the IMU's axes x, y, z; three arrays"
    )
    rotation_norm_deg_s: tuple[float, ...] = Field(default=(), description="mean of the rate's magnitude")
    acceleration_m_s2: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]] = Field(
        default=((), (), ()),
        description="mean of the accelerometer's readings along the IMU's axes x, y, z, gravity included; three arrays",
    )
    scan_t_s: tuple[float, ...] = Field(
        default=(),
        description="when scans were received, seconds from the recording's start; some are left out of a very long recording",
    )


class ParameterForecast(_Model):
    """Standard deviation to expect of one parameter of the calibration."""

    name: Axis = Field(description="as named in the result's covariance_order")
    std: float = Field(description="standard deviation to expect, in unit")
    unit: Literal["deg", "m", "s"] = Field(description="of std")
    weak: bool = Field(description="whether the data alone leave it beyond the limits of a weak answer")
    advice: str = Field(
        default="",
        description="what to record to know it, for a person; empty where it is known or nothing can be said",
    )


class Forecast(_Model):
    """What a solve of this recording would know, before it is run."""

    text: str = Field(default="", description="the forecast in one sentence or two, for a person")
    parameters: tuple[ParameterForecast, ...] = Field(
        description="all seven, in covariance_order; none where there is no forecast"
    )
    weak: tuple[str, ...] = Field(default=(), description="a sentence for each direction that stays weak")
    planes: tuple[str, ...] = Field(default=(), description="names of the planes that the forecast rests on")
    advice: tuple[str, ...] = Field(default=(), description="what to record; a sentence each")
    reason: str = Field(default="", description="why there is no forecast, for a person; empty where there is one")
    code: str = Field(default="", description="stable and dotted code of that reason; empty where there is a forecast")
    covered_s: float = Field(
        default=0.0, description="seconds of the recording that the numbers rest on, standstill included"
    )


class PlaneReport(_Model):
    """One plane that can be expected."""

    name: str = Field(description="as people call it, such as wall 1")
    kind: Kind = Field(description="what it is to someone standing upright; plane where gravity is not known")
    tilt_deg: float | None = Field(
        description="angle between the plane and the horizontal; null where gravity is not known"
    )
    area_m2: float = Field(description="of the part that was seen")
    distance_m: float = Field(description="from the lidar, at the reference scan")
    points: int = Field(description="points that lie on it, of those sampled")
    rms_m: float = Field(description="root mean square distance of these points from it")
    normal: Axes | None = Field(
        default=None,
        description="unit length, towards the lidar, lidar axes at the reference scan; null in reports of older versions",
    )
    doubt: str = Field(
        default="",
        description="what seems wrong with it, so that a solve would leave it out, such as: seems to move against the other "
        "planes; empty: nothing",
    )


class PlanesReport(_Model):
    """The planes that can be expected."""

    planes: tuple[PlaneReport, ...] = Field(description="largest first")
    determinacy: float = Field(
        description="0 where no plane sees some direction of the lidar's motion, 1 for three equal ones at right angles"
    )
    determined: bool = Field(description="whether the planes fix the lidar's position")
    text: str = Field(description="what was found, for a person")
    up: Axes | None = Field(
        default=None,
        description="unit vector against gravity in the frame of the normals; null where gravity is not known",
    )


class DoctorReport(_Model):
    """The whole report."""

    schema_: Literal["unsweep.report/1"] = Field(
        default="unsweep.report/1", alias="schema", description="which document this is"
    )
    name: str = Field(description="of the file or folder")
    size_bytes: int = Field(description="of the recording as it was given")
    container: Literal["ros1", "ros2"] = Field(description="whether its messages are those of ROS 1 or ROS 2")
    duration_s: float = Field(description="from the first message received to the last")
    start_ns: int = Field(description="receive time of the first message, nanoseconds since 1970")
    topics: tuple[TopicReport, ...] = Field(description="all topics of the recording")
    lidar_candidates: tuple[str, ...] = Field(description="topics that could serve as the lidar")
    imu_candidates: tuple[str, ...] = Field(description="topics that could serve as the IMU")
    lidar: LidarReport | None = Field(
        description="the lidar that would be calibrated; null where there is none, or not yet"
    )
    imu: ImuReport | None = Field(description="the IMU that would be calibrated; null where there is none, or not yet")
    clock_offset_s: float = Field(
        description="to ADD to an IMU stamp to bring it near the lidar clock, coarse; 0: both clocks count from the same "
        "instant"
    )
    timeline: Timeline = Field(description="motion over time, for a plot")
    findings: tuple[FindingReport, ...] = Field(description="what was detected, each with its evidence")
    verdict: Verdict = Field(
        description="good: ready to calibrate; limited: some of the answer would stay unknown or doubtful; unusable: a solve "
        "would be refused"
    )
    reasons: tuple[str, ...] = Field(description="what the verdict rests on; a sentence each")
    advice: tuple[str, ...] = Field(description="what to record or change; a sentence each")
    planes: PlanesReport | None = Field(
        default=None, description="planes that a solve can expect; null where they were not looked for, or not yet"
    )
    forecast: Forecast | None = Field(
        default=None, description="what a solve would know; null where it cannot be made, or not yet"
    )
    final: bool = Field(
        default=True,
        description="false: known on the way; what is null or empty may still be found, and the verdict may change",
    )

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True
    )

    def to_json(self) -> str:
        """The report as indented JSON text, ending in a newline."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"


#: Who listens for reports on the way.
OnReport = Callable[[DoctorReport], None]
