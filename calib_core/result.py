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
    code: str = Field(description="stable and dotted, such as solve.diverged")
    level: Literal["info", "warning", "error"] = Field(
        description="how much it matters; of a refused document an error is the reason"
    )
    text: str = Field(description="one sentence for a person")


class Transform(_Model):
    matrix: list[list[float]] = Field(description="4 rows of 4: homogeneous lidar coordinates to IMU coordinates")
    translation_m: list[float] = Field(description="the lidar's origin seen from the IMU, along the IMU's axes")
    quaternion_xyzw: list[float] = Field(description="x, y, z, w of the rotation")
    euler_xyz_deg: list[float] = Field(description="roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)")


class Uncertainty(_Model):
    rotation_std_deg: list[float] = Field(description="about the lidar's x, y and z axes, not of roll, pitch and yaw")
    translation_std_m: list[float] = Field(description="along the IMU's x, y and z axes")
    time_offset_std_s: float = Field(description="of time_offset_s")
    gravity_std_m_s2: float = Field(description="of gravity_m_s2")
    covariance_order: list[str] = Field(
        default_factory=lambda: list[str](COVARIANCE_ORDER),
        description="r about the lidar's axes, t along the IMU's, dt in time",
    )
    covariance: list[list[float]] = Field(
        description="7 x 7 in covariance_order; rad, m and s; marginal over everything else"
    )


class WeakDirection(_Model):
    label: str | None = Field(description="the axis that this direction lies along; null: a mixture of axes")
    vector: list[float] = Field(description="7 in covariance_order, each divided by 1 deg, 10 mm or 1 ms, of length 1")
    std_scaled: float = Field(description="standard deviation along it, in the same units")
    text: str = Field(description="one sentence for a person")


class Observability(_Model):
    """What the data alone leave weak, and what to do about it."""

    weak_axes: list[Axis] = Field(
        default_factory=list,
        description="of covariance_order: beyond 0.5 deg, 20 mm or 2 ms without priors; none of documents from before 0.2",
    )
    weak_directions: list[WeakDirection] = Field(default_factory=list, description="what is weak together")
    advice: list[str] = Field(default_factory=list, description="what to do next, a sentence each")


class PlaneQuality(_Model):
    """A plane n . x + offset_m = 0 of the map frame, and the points used of it."""

    name: str = Field(description="as people call it")
    normal: list[float] = Field(description="unit length, map frame")
    offset_m: float = Field(description="n . x + offset_m = 0")
    points: int = Field(description="points of it that were used")
    rms_m: float = Field(
        description="weighted root mean square distance of its points: those seen at a grazing angle count more, so that it "
        "is less than their plain spread"
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
    points: int = Field(description="points that were looked at")
    cubes: int = Field(description="cubes that these points lie in")


class Crispness(_Model):
    """The same points before (each sweep as rigid) and after (de-skewed with this answer), and what it means."""

    before: RoomCrispness = Field(description="each sweep as if it were rigid")
    after: RoomCrispness = Field(description="straightened with this answer")
    text: str = Field(description="what that means, for a person")


class Shift(_Model):
    """A shift from the answer: turns about the lidar's axes, shifts along the IMU's."""

    rotation_shift_deg: list[float] = Field(description="turns about the lidar's axes")
    translation_shift_m: list[float] = Field(description="along the IMU's axes")
    time_offset_shift_s: float = Field(description="of the time offset")


class OwnAnswer(Shift):
    """What a part of the recording alone would ask for: a shift from the joint answer, and its standard deviations.

    A part that says nothing of one has the standing prior's 1 rad, 10 m or 10 s. Weighted by their information the stretches of
    time agree with the joint answer.
    """

    rotation_std_deg: list[float] = Field(description="about the lidar's axes")
    translation_std_m: list[float] = Field(description="along the IMU's axes")
    time_offset_std_s: float = Field(description="of the time offset")


class TimeBlock(OwnAnswer):
    t_start_s: float = Field(description="its beginning: lidar time, seconds from the recording's start")
    t_end_s: float = Field(description="its end, in the same time")


class PlaneAnswer(OwnAnswer):
    name: str = Field(description="of the plane")


class RangeAnswer(OwnAnswer):
    from_m: float = Field(description="least distance of its points")
    to_m: float = Field(description="greatest distance of its points")


class Parts(_Model):
    """The recording in parts, each with its own answer."""

    time_blocks: list[TimeBlock] = Field(description="stretches of time, one after the other")
    planes: list[PlaneAnswer] = Field(description="points of one plane each")
    ranges: list[RangeAnswer] = Field(description="points nearer and farther than the middle one")


class OffsetProfile(_Model):
    """How well the lidar's turning and the gyroscope's go together, over the time offset around the answer's."""

    first_s: float = Field(description="time offset of the first value, minus the answer's")
    step_s: float = Field(description="from one value to the next")
    likeness: list[float | None] = Field(
        description="1: one rotation between the axes explains both rates of rotation completely; null: they have too little "
        "time in common"
    )
    best_s: float = Field(description="time offset at which the likeness is highest, minus the answer's")
    text: str = Field(
        default="", description="what the profile says about the answer, for a person; empty in older documents"
    )


class Evidence(_Model):
    """How the answer stands within its recording. parts: by the joint solve.   time_offset_profile: apart from it."""

    parts: Parts = Field(description="the recording in parts, each with its own answer")
    time_offset_profile: OffsetProfile | None = Field(
        default=None,
        description="absent where the body hardly turned",
        exclude_if=lambda profile: profile is None,
    )


class Quality(_Model):
    point_to_plane_rms_m: float = Field(
        description="weighted root mean square distance of all points used from their planes, as in each plane's rms_m"
    )
    points_used: int = Field(description="points on planes that the solve used")
    scans_used: int = Field(description="scans that the solve used")
    scans_total: int = Field(description="scans in the recording")
    planes: list[PlaneQuality] = Field(description="the planes that the answer rests on")
    iterations: int = Field(description="of the joint solve")
    duration_s: float = Field(description="how long the solve took")
    crispness: Crispness | None = Field(
        default=None,
        description="of the room laid together without knowledge of planes; absent where it was not measured",
        exclude_if=lambda crispness: crispness is None,
    )


class Intrinsic(_Model):
    """One parameter of a sensor's own; signs in calib_core/intrinsics.py. significant: beyond three of its sigmas from zero."""

    block: str = Field(description="such as laser_range_offset or gyroscope_scale")
    name: str = Field(description="within its block: an axis, a ring")
    unit: str = Field(description="of value, std and prior_std")
    value: float = Field(description="0 of an ideal sensor")
    std: float = Field(description="standard deviation of the value")
    prior_std: float = Field(description="standard deviation that was allowed beforehand")
    state: Literal["estimated", "considered"] = Field(description="considered: held at 0 and counted in the error bars")
    significant: bool = Field(description="beyond three of its sigmas from zero")
    shift: Shift | None = Field(
        default=None,
        description="only where state is considered: by how much the answer is off if the parameter is one prior_std above zero",
        exclude_if=lambda shift: shift is None,
    )


class GyroscopeAxes(_Model):
    """The rotation from the lidar into the gyroscope's mean axes, of which `T_imu_lidar` has that into the accelerometer's."""

    quaternion_xyzw: list[float] = Field(
        description="x, y, z, w of the rotation that takes lidar axes to the gyroscope's"
    )
    rotation_std_deg: list[float] = Field(description="about the lidar's axes")


class RecordingProvenance(_Model):
    name: str = Field(description="of the file or folder")
    sha256: str = Field(description="of the file; of a folder of its files' hashes in name order")
    duration_s: float = Field(description="from its first scan to its last")
    lidar_topic: str = Field(description="whose clouds were used")
    imu_topic: str = Field(description="whose readings were used")
    lidar_frame_id: str = Field(description="the frame that T_imu_lidar leads from")
    imu_frame_id: str = Field(description="the frame that T_imu_lidar leads to")
    lidar_model: str = Field(default="", description="the lidar preset that the recording was recognised by, if any")
    imu_rate_hz: float | None = Field(
        default=None, gt=0, description="readings per second, by their stamps; null where it is not known"
    )


class Provenance(_Model):
    recording: RecordingProvenance = Field(description="what was solved")
    settings: dict[str, object] = Field(description="how it was solved")
    software: dict[str, str] = Field(description="versions, by name")


class CalibrationResult(_Model):
    """The whole document. Where `status` is refused the answer's fields are None and `messages` has the reasons."""

    schema_: Literal["unsweep.calibration/1"] = Field(
        default=RESULT_SCHEMA, alias="schema", description="which document this is"
    )
    status: Status = Field(description="weak: some standard deviation is beyond its limit; refused: there is no answer")
    messages: list[Message] = Field(description="what was found and done on the way")
    T_imu_lidar: Transform | None = Field(description="the extrinsic: lidar coordinates to IMU coordinates")
    time_offset_s: float | None = Field(description="to ADD to an IMU stamp to express it in the lidar clock")
    time_offset_ns: int | None = Field(description="the same, exact where clocks have different epochs")
    gyroscope_bias_rad_s: list[float] | None = Field(description="mean over the recording, along the IMU's axes")
    accelerometer_bias_m_s2: list[float] | None = Field(description="mean over the recording, along the IMU's axes")
    gravity_m_s2: float | None = Field(description="magnitude of gravity")
    uncertainty: Uncertainty | None = Field(description="one standard deviation each, marginal over everything else")
    observability: Observability = Field(description="what the data alone leave weak")
    quality: Quality = Field(description="how well the answer fits")
    provenance: Provenance = Field(description="what was solved, how, and by which software")
    intrinsics: list[Intrinsic] = Field(default_factory=list, description="the sensors' own parameters")
    clock_rate_ppm: float | None = Field(
        default=None,
        description="t_lidar = t_imu + time_offset_s + clock_rate_ppm 1e-6 (t_lidar - the instant it holds at)",
    )
    clock_rate_ppm_std: float | None = Field(default=None, description="of clock_rate_ppm")
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
