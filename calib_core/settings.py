"""Every choice of a calibration, grouped by stage, frozen, with units in the names. Unknown keys are refused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from calib_core.intrinsics import Block

#: Of the calibration: rotation about the lidar's axes, position along the IMU's, time offset; in this order everywhere.
Axis = Literal["rx", "ry", "rz", "tx", "ty", "tz", "dt"]
#: A sensor's name as people write it.
SensorName = Annotated[str, Field(max_length=200)]

#: The published algorithm's own choices: the defaults of `method="paper"`.
PAPER_POINTS_PER_PLANE_PER_SCAN = 100
PAPER_FIELD_OF_VIEW_DEG = 45.0

#: Standard deviation of gravity's magnitude once the latitude is known: altitude takes away 0.003 m/s2 a kilometre,
#: local anomalies are below 0.001 m/s2.
LATITUDE_GRAVITY_STD_M_S2 = 0.005
#: Gravity's magnitude on the ground is within these, on every mountain and in every mine.
LEAST_GRAVITY_M_S2, MOST_GRAVITY_M_S2 = 9.0, 10.0
#: The largest whole number that every program which reads JSON keeps to the last digit.
LARGEST_SEED = 2**53 - 1
#: The largest time offset [s]: stamps are 64-bit nanoseconds, and epochs no further apart than 285 years.
FARTHEST_S = 9e9
#: The longest lever arm [m] that is one: far beyond any platform, and squares of it are still numbers.
FARTHEST_M = 1e6
#: The tightest prior: a nanoradian, a nanometre, a nanosecond. One over its square is still a number.
TIGHTEST_STD = 1e-9


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ReadSettings(_Settings):
    """How the recording is read. None means: detect, and say what was detected with its evidence."""

    lidar_topic: str | None = Field(default=None, description="topic of the clouds; null: the only one that fits")
    imu_topic: str | None = Field(default=None, description="topic of the IMU; null: the only one that fits")
    start_s: float | None = Field(
        default=None,
        description="what was received earlier is left out; seconds after the recording's start; null: from its start",
    )
    end_s: float | None = Field(
        default=None,
        description="what was received later is left out; seconds after the recording's start; null: to its end",
    )
    point_time_field: str | None = Field(
        default=None, description="field of the clouds with each point's time; null: detect it"
    )
    point_time_unit: Literal["s", "ms", "us", "ns"] | None = Field(
        default=None, description="unit of that field; null: detect it"
    )
    point_time_reference: Literal["header-first", "header-last", "absolute"] | None = Field(
        default=None,
        description="what the point times count from: the header, which is the first or the last point's time, or the clock's "
        "own epoch; null: detect it",
    )
    synthesise_point_time: bool = Field(
        default=False,
        description="make up the times of clouds that have none, from the azimuth or the order of their points; less accurate",
    )
    points_at_once: bool = Field(
        default=False, description="all points of a scan were taken at its stamp, as by a flash lidar or a depth camera"
    )
    accelerometer_unit: Literal["m_s2", "g"] | None = Field(
        default=None, description="unit of the accelerometer's readings; null: detect it"
    )
    gyroscope_unit: Literal["rad_s", "deg_s"] | None = Field(
        default=None, description="unit of the gyroscope's readings; null: detect it"
    )
    stamps: Literal["header", "receive"] = Field(
        default="header",
        description="which stamps count: those in the messages' headers, or the times at which the messages were received",
    )
    imu_bundles: Literal["spread", "as-stamped"] = Field(
        default="spread",
        description="spread: readings that a driver stamped together are spread over time, and readings sent twice count "
        "once; as-stamped: all readings as they came",
    )
    repeated_returns: Literal["once", "as-sent"] = Field(
        default="once",
        description="once: a return that is in a cloud twice, as from a lidar in dual mode, counts once; as-sent: all points "
        "as they came",
    )
    range_min_m: float = Field(default=0.3, ge=0, description="points nearer to the lidar are left out")
    range_max_m: float = Field(default=200.0, gt=0, description="points farther from the lidar are left out")

    @model_validator(mode="after")
    def _nearest_before_farthest(self) -> Self:
        if self.range_min_m >= self.range_max_m:
            found = f"{self.range_min_m:g} to {self.range_max_m:g} m"
            raise ValueError(f"expected a least range below the greatest, found {found}")
        return self


class ImuNoise(_Settings):
    """Continuous-time noise densities; the keys of the contract's noise file."""

    gyroscope_noise_density_rad_s_sqrt_hz: float = Field(
        gt=0, description="white noise of the gyroscope, of each axis [rad/s/√Hz]"
    )
    accelerometer_noise_density_m_s2_sqrt_hz: float = Field(
        gt=0, description="white noise of the accelerometer, of each axis [m/s²/√Hz]"
    )
    gyroscope_random_walk: float = Field(
        default=1e-5, ge=0, description="how the gyroscope's bias wanders [rad/s per √s]"
    )
    accelerometer_random_walk: float = Field(
        default=1e-4, ge=0, description="how the accelerometer's bias wanders [m/s² per √s]"
    )
    range_std_m: float | None = Field(
        default=None, gt=0, description="standard deviation of the lidar's ranges, along the beam; null: measured"
    )


class Gravity(_Settings):
    """Gravity's magnitude: a prior mean and standard deviation; std 0 fixes it."""

    magnitude_m_s2: float = Field(
        default=9.807, gt=LEAST_GRAVITY_M_S2, lt=MOST_GRAVITY_M_S2, description="mean of the prior"
    )
    std_m_s2: float = Field(
        default=0.02, ge=0, description="standard deviation of the prior; 0: the magnitude is exact"
    )


def gravity_at_latitude_m_s2(latitude_deg: float) -> float:
    """Normal gravity on the WGS 84 ellipsoid (Somigliana's closed formula), at sea level."""
    sine_squared = math.sin(math.radians(latitude_deg)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * sine_squared) / math.sqrt(1.0 - 0.00669437999014 * sine_squared)


class Prior(_Settings):
    """A prior on one axis of the calibration, in the contract's covariance order and units (rad, m, s).

    Rotation axes (rx ry rz) are small turns about the lidar's axes away from the initial guess's rotation.
    """

    axis: Axis = Field(description="which of the seven, as named in the result's covariance_order")
    value: float = Field(
        description="mean: of rx ry rz a turn [rad] from the initial guess's rotation, of tx ty tz the translation itself "
        "[m], of dt the time offset itself [s]"
    )
    std: float = Field(ge=TIGHTEST_STD, description="standard deviation, in the unit of value")


# One flat record for both methods: its keys are the command line's options, the web form's fields and the document's
# `provenance.settings`. Which of them the published method obeys, and which change nothing of what a second solve takes from the
# first, is listed below it.
class CalibrateSettings(_Settings):
    """How the calibration is solved."""

    method: Literal["full", "paper"] = Field(
        default="full", description="paper: the published algorithm as it stands, for comparison"
    )
    points_per_plane_per_scan: int | None = Field(
        default=None, gt=0, description="points used of each plane in each scan; null: all"
    )
    field_of_view_deg: float | None = Field(
        default=None,
        gt=0,
        le=180,
        description="only points whose azimuth is within plus and minus this are used; null: all",
    )
    gravity: Gravity = Field(default=Gravity(), description="what is known of gravity's magnitude")
    imu_noise: ImuNoise | SensorName | None = Field(
        default=None,
        description="a preset's name: its priors and random walks are used, and the noise is measured; or noise densities, "
        "used instead of measured ones; null: measured",
    )
    estimate_time_offset: bool = Field(
        default=True, description="false: the time offset is held as the initial guess has it, at 0 without one"
    )
    estimate_planes: bool = Field(default=True, description="false: the planes are held as given or as first seen")
    bias_model: Literal["constant", "random-walk"] = Field(
        default="random-walk", description="how the IMU's biases behave over the recording"
    )
    imu_sampling: Literal["detect", "as-stamped", "even"] = Field(
        default="detect",
        description="when the IMU's readings were taken; as-stamped: at their stamps; even: at even steps; detect: what the "
        "readings themselves tell",
    )
    lidar_sampling: Literal["detect", "as-stamped"] = Field(
        default="detect",
        description="when sweeps began; as-stamped: at their stamps; detect: evenly, as a rotor turns, where the stamps are "
        "seen to be a host's",
    )
    cloud: Literal["detect", "as-sent"] = Field(
        default="detect",
        description="as-sent: clouds are taken as a lidar's own; detect: a cloud that was thinned by a grid, one point to a "
        "cell, is recognised",
    )
    intrinsics: Literal["auto", "consider", "off"] | tuple[Block, ...] = Field(
        default="auto",
        description="the sensors' own parameters; auto: estimated with priors; consider: not estimated, but counted in the "
        "error bars; off: sensors taken as ideal; a list: only the named blocks are estimated",
    )
    lidar: SensorName | None = Field(
        default=None, description="name of a lidar preset, for the priors; null: as recognised"
    )
    priors: tuple[Prior, ...] = Field(
        default=(), description="what is known of the calibration beforehand; at most one for each axis"
    )
    random_seed: int = Field(default=0, ge=0, le=LARGEST_SEED, description="seed of the search for planes")
    max_rounds: int = Field(default=12, gt=0, description="the most rounds of associating points to planes and solving")
    crispness: bool = Field(default=True, description="whether to measure how crisp the room is, before and after")
    excluded_spans_s: tuple[tuple[float, float], ...] = Field(
        default=(), description="scans that touch these spans are left out; seconds after the first scan read"
    )

    @property
    def range_std_m(self) -> float | None:
        """The lidar's noise along the beam where it is given; otherwise it is measured."""
        return self.imu_noise.range_std_m if isinstance(self.imu_noise, ImuNoise) else None

    @model_validator(mode="before")
    @classmethod
    def _with_published_defaults(cls, given: object) -> object:
        """The published method has defaults of its own; they stand in the record, so that a result says what was used."""
        if isinstance(given, Mapping) and given.get("method") == "paper":
            published = {
                "points_per_plane_per_scan": PAPER_POINTS_PER_PLANE_PER_SCAN,
                "field_of_view_deg": PAPER_FIELD_OF_VIEW_DEG,
            }
            return {**published, **given}
        return given

    @field_validator("priors")
    @classmethod
    def _one_for_each_axis(cls, priors: tuple[Prior, ...]) -> tuple[Prior, ...]:
        axes = [prior.axis for prior in priors]
        twice = sorted({axis for axis in axes if axes.count(axis) > 1})
        if twice:
            raise ValueError(f"expected one prior for each axis, found several for {', '.join(twice)}")
        return priors

    @field_validator("excluded_spans_s")
    @classmethod
    def _ends_after_start(cls, spans_s: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for start_s, end_s in spans_s:
            if not (math.isfinite(start_s) and math.isfinite(end_s) and start_s < end_s):
                raise ValueError(f"expected a span that ends after it starts, found {start_s:g} to {end_s:g} s")
        return spans_s


#: What `method="paper"` obeys; everything else is the default method's, and said to have no effect (`request.py`). Of an IMU's
#: noise it takes the range's alone.
OBEYED_BY_PAPER = frozenset(
    {
        "method", "points_per_plane_per_scan", "field_of_view_deg", "gravity", "random_seed", "crispness",
        "excluded_spans_s",
    }
)  # fmt: skip

#: What changes nothing of how the lidar is followed: a track that is kept serves another solve with other values of these
#: (`full/initialise/kept_track.py`). What is not listed makes a new track.
USED_AFTER_TRACKING = frozenset(
    {
        "points_per_plane_per_scan", "estimate_time_offset", "estimate_planes", "bias_model", "intrinsics", "priors",
        "max_rounds", "crispness",
    }
)  # fmt: skip

#: The same of the motion before it matters which planes count (`full/joint/kept_motion.py`), where planes are never held.
USED_AFTER_MOTION = frozenset({"crispness", "estimate_planes"})
