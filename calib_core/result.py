"""The result document, schema unsweep.calibration/1, exactly as other programs read it.

Frames: `T_imu_lidar` takes homogeneous lidar coordinates to IMU coordinates. `time_offset_s` is added to an IMU stamp
to express it in the lidar clock. Covariance: R_imu_lidar Exp(r) on the right [rad, lidar axes], translation added
[m, IMU axes], time offset [s], in `covariance_order`.
"""

from __future__ import annotations

from typing import Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field

from calib_core.settings import Axis, ImuNoise

COVARIANCE_ORDER: tuple[Axis, ...] = get_args(Axis)
#: The same to a person.
AXIS_WORDS: dict[Axis, str] = {
    "rx": "rotation about the lidar's x axis",
    "ry": "rotation about the lidar's y axis",
    "rz": "rotation about the lidar's z axis",
    "tx": "translation along the IMU's x axis",
    "ty": "translation along the IMU's y axis",
    "tz": "translation along the IMU's z axis",
    "dt": "time offset",
}
#: Beyond which standard deviation (1 sigma) along any of them an answer is weak.
WEAK_DEG, WEAK_M, WEAK_S = 0.5, 0.020, 0.002
Status = Literal["calibrated", "weak", "refused"]
RESULT_SCHEMA: Literal["unsweep.calibration/1"] = "unsweep.calibration/1"


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Message(_Model):
    code: str
    level: Literal["info", "warning", "error"]
    text: str


class Transform(_Model):
    matrix: list[list[float]]
    translation_m: list[float]
    quaternion_xyzw: list[float]
    euler_xyz_deg: list[float]


class Uncertainty(_Model):
    rotation_std_deg: list[float]
    translation_std_m: list[float]
    time_offset_std_s: float
    gravity_std_m_s2: float
    covariance_order: list[str] = Field(default_factory=lambda: list[str](COVARIANCE_ORDER))
    covariance: list[list[float]]


class WeakDirection(_Model):
    label: str | None
    vector: list[float]
    std_scaled: float
    text: str


class Observability(_Model):
    """weak_axes: the parameters that the data alone leave weak, whichever directions these make together; none of documents from
    before 0.2.
    """

    weak_axes: list[Axis] = Field(default_factory=list)
    weak_directions: list[WeakDirection] = Field(default_factory=list)
    advice: list[str] = Field(default_factory=list)


class PlaneQuality(_Model):
    """A plane n . x + offset_m = 0 of the map frame, and the points used of it."""

    name: str
    normal: list[float]
    offset_m: float
    points: int
    rms_m: float = Field(
        description="of their distances, a surer one (seen at a grazing angle) counting more: less than their plain spread"
    )
    outline_m: list[list[float]] | None = Field(
        default=None,
        description="corners of the convex polygon that it was restricted to, map frame, as given; absent without one",
        exclude_if=lambda outline_m: outline_m is None,
    )


class RoomCrispness(_Model):
    """How crisp one map of the room is, measured without planes over small cubes; lower is crisper."""

    mean_entropy_nat: float = Field(description="mean over points of 1/2 ln |2 pi e S|, S [m2] of the points of a cube")
    thickness_std_m: float = Field(description="root of the mean smallest eigenvalue of S")
    points: int
    cubes: int


class Crispness(_Model):
    """The same points before (each sweep as rigid) and after (de-skewed with this answer), and what it means."""

    before: RoomCrispness
    after: RoomCrispness
    text: str


class Shift(_Model):
    """A shift from the answer: turns about the lidar's axes, shifts along the IMU's."""

    rotation_shift_deg: list[float]
    translation_shift_m: list[float]
    time_offset_shift_s: float


class OwnAnswer(Shift):
    """What a part of the recording alone would ask for: a shift from the joint answer, and its standard deviations.

    A part that says nothing of one has the standing prior's 1 rad, 10 m or 10 s. Weighted by their information the stretches of
    time agree with the joint answer.
    """

    rotation_std_deg: list[float]
    translation_std_m: list[float]
    time_offset_std_s: float


class TimeBlock(OwnAnswer):
    t_start_s: float = Field(description="lidar time, seconds from the recording's start")
    t_end_s: float


class PlaneAnswer(OwnAnswer):
    name: str


class RangeAnswer(OwnAnswer):
    from_m: float
    to_m: float


class Parts(_Model):
    """The recording in parts, each with its own answer."""

    time_blocks: list[TimeBlock]
    planes: list[PlaneAnswer]
    ranges: list[RangeAnswer] = Field(description="points nearer and farther than the middle one")


class OffsetProfile(_Model):
    """How well the lidar's turning and the gyroscope's go together, over the time offset around the answer's."""

    first_s: float = Field(description="time offset of the first value, from the answer's")
    step_s: float
    likeness: list[float | None] = Field(
        description="1 where a turn of the axes explains all of both, null where too little is in common"
    )
    best_s: float = Field(description="where it is highest, from the answer's time offset")
    text: str = Field(default="", description="what that says of the answer; empty in older documents")


class Evidence(_Model):
    """How the answer stands within its recording. parts: by the joint solve.   time_offset_profile: apart from it."""

    parts: Parts
    time_offset_profile: OffsetProfile | None = Field(
        default=None,
        description="absent where the body hardly turned",
        exclude_if=lambda profile: profile is None,
    )


class Quality(_Model):
    point_to_plane_rms_m: float = Field(description="of the distances of all points used, as of each plane's")
    points_used: int
    scans_used: int
    scans_total: int
    planes: list[PlaneQuality]
    iterations: int
    duration_s: float
    crispness: Crispness | None = Field(
        default=None,
        description="of the accumulated room, knowing no planes; absent where it was not measured",
        exclude_if=lambda crispness: crispness is None,
    )


class Intrinsic(_Model):
    """One parameter of a sensor's own; signs in calib_core/intrinsics.py. significant: beyond three of its sigmas from zero."""

    block: str
    name: str
    unit: str
    value: float
    std: float
    prior_std: float
    state: Literal["estimated", "considered"]
    significant: bool
    shift: Shift | None = Field(
        default=None,
        description="of what was only considered: by how much the answer is off where it is one prior_std above zero",
        exclude_if=lambda shift: shift is None,
    )


class GyroscopeAxes(_Model):
    """The rotation from the lidar into the gyroscope's mean axes, of which `T_imu_lidar` has that into the accelerometer's.

    rotation_std_deg: (3,) about the lidar's axes.
    """

    quaternion_xyzw: list[float]
    rotation_std_deg: list[float]


class RecordingProvenance(_Model):
    name: str
    sha256: str
    duration_s: float
    lidar_topic: str
    imu_topic: str
    lidar_frame_id: str
    imu_frame_id: str
    lidar_model: str = Field(default="", description="the lidar preset that the recording was recognised by, if any")
    imu_rate_hz: float | None = Field(default=None, gt=0)


class Provenance(_Model):
    recording: RecordingProvenance
    settings: dict[str, object]
    software: dict[str, str]


class CalibrationResult(_Model):
    """The whole document. Where `status` is refused the answer's fields are None and `messages` has the reasons."""

    schema_: Literal["unsweep.calibration/1"] = Field(default=RESULT_SCHEMA, alias="schema")
    status: Status
    messages: list[Message]
    T_imu_lidar: Transform | None
    time_offset_s: float | None
    time_offset_ns: int | None
    gyroscope_bias_rad_s: list[float] | None
    accelerometer_bias_m_s2: list[float] | None
    gravity_m_s2: float | None
    uncertainty: Uncertainty | None
    observability: Observability
    quality: Quality
    provenance: Provenance
    intrinsics: list[Intrinsic] = Field(default_factory=list)
    clock_rate_ppm: float | None = Field(
        default=None,
        description="t_lidar = t_imu + time_offset_s + clock_rate_ppm 1e-6 (t_lidar - the instant it holds at)",
    )
    clock_rate_ppm_std: float | None = None
    time_offset_at_s: float | None = Field(
        default=None, description="lidar time, seconds from the recording's start, at which time_offset_s holds"
    )
    imu_noise: ImuNoise | None = Field(
        default=None, description="the IMU's noise densities and random walks that the solve used, mean over axes"
    )
    imu_frame: str = Field(default="", description="which sensor's axes the IMU's frame is")
    gyroscope_axes: GyroscopeAxes | None = Field(
        default=None,
        description="the rotation into the gyroscope's own axes, where the IMU's frame is the accelerometer's",
        exclude_if=lambda axes: axes is None,
    )
    evidence: Evidence | None = Field(
        default=None,
        description="what parts of the recording answer by themselves; absent where there is no answer",
        exclude_if=lambda evidence: evidence is None,
    )

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, populate_by_name=True, serialize_by_alias=True)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The document in a text; keys that this version does not know are passed over, since a later one may add some.

        Raises pydantic's ValidationError where it is none.
        """
        return cls.model_validate_json(text, extra="ignore")

    def to_json(self) -> str:
        """The document as indented JSON text, ending in a newline."""
        return self.model_dump_json(by_alias=True, indent=2) + "\n"
