"""Lidars and IMUs as data: firing patterns, noise, what they cannot see, and how their drivers publish.

A firing pattern is given column by column: one instant per column, one delay per channel within the column, all in
whole nanoseconds. Directions are in the lidar frame as the driver publishes it (azimuth = atan2(y, x)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from calib_core.types import FloatArray, IntArray

Layout = Literal["velodyne", "ouster", "hesai", "livox"]
HeaderAt = Literal["first", "last"]


@dataclass(frozen=True, slots=True)
class Firings:
    """One sweep's worth of shots.

    column_ns: (C,) after the simulation's zero.   channel_ns: (K,) after the column's instant.
    directions: (3, C, K) unit.   origin_m: (3, C, K) or None where every ray starts in the lidar's origin.
    """

    column_ns: IntArray
    channel_ns: IntArray
    directions: FloatArray
    origin_m: FloatArray | None = None


class Pattern(Protocol):
    """Where a lidar looks, and when."""

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Ring (line) number of each channel, (K,)."""

    @property
    def period_s(self) -> float:
        """Mean time from one sweep to the next."""

    def firings(self, index: int) -> Firings:
        """Sweep number `index`, from 0."""

    def count(self, duration_s: float) -> int:
        """How many whole sweeps fit into a recording of this length."""


@dataclass(frozen=True, slots=True)
class Spinning:
    """A column of channels on a rotor.

    elevations_deg: per channel in firing order.   azimuths_deg: per channel, added to the rotor's angle.
    channel_ns: delay of each channel within a column.   columns_per_packet: sweeps are cut between packets, after the
    rotor has passed the cut.   clockwise: seen from above.   origin_radius_m: of the optics about the rotor's axis.
    """

    elevations_deg: tuple[float, ...]
    channel_ns: tuple[int, ...]
    column_period_ns: float
    columns_per_packet: int
    azimuths_deg: tuple[float, ...] = (0.0,)
    rate_hz: float = 10.0
    clockwise: bool = True
    cut_deg: float = 180.0
    origin_radius_m: float = 0.0
    start_ns: int = 0

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Channels numbered from the lowest up."""
        return np.argsort(np.argsort(np.asarray(self.elevations_deg), kind="stable")).astype(np.uint16)

    @property
    def period_s(self) -> float:
        """One turn of the rotor."""
        return 1.0 / self.rate_hz

    def _first_column(self, index: int) -> int:
        packet_ns = self.column_period_ns * self.columns_per_packet
        packets = int(np.ceil(index * 1e9 / self.rate_hz / packet_ns - 1e-9))
        return packets * self.columns_per_packet

    def count(self, duration_s: float) -> int:
        """Whole turns within the duration."""
        return int(np.floor(duration_s * self.rate_hz + 1e-9))

    def firings(self, index: int) -> Firings:
        """From the first packet after the rotor passed the cut for the index-th time to the packet before the next."""
        columns = np.arange(self._first_column(index), self._first_column(index + 1), dtype=np.int64)
        column_ns = self.start_ns + np.rint(columns * self.column_period_ns).astype(np.int64)
        channel_ns = np.asarray(self.channel_ns, dtype=np.int64)
        turn = (-1.0 if self.clockwise else 1.0) * 2.0 * np.pi * self.rate_hz * 1e-9
        rotor = np.deg2rad(self.cut_deg) + turn * (column_ns - self.start_ns)
        skew = np.deg2rad(np.broadcast_to(self.azimuths_deg, channel_ns.shape)) + turn * channel_ns
        elevation = np.deg2rad(self.elevations_deg)
        azimuth = np.exp(1j * rotor)[:, None] * np.exp(1j * skew)[None, :]
        level = np.cos(elevation)
        directions = np.stack(
            [azimuth.real * level, azimuth.imag * level, np.broadcast_to(np.sin(elevation), azimuth.shape)]
        )
        origin: FloatArray | None = None
        if self.origin_radius_m:
            bearing = np.broadcast_to(np.exp(1j * rotor)[:, None], azimuth.shape) * self.origin_radius_m
            origin = np.stack([bearing.real, bearing.imag, np.zeros(azimuth.shape)])
        return Firings(column_ns, channel_ns, directions, origin)


@dataclass(frozen=True, slots=True)
class Rosette:
    """A solid-state lidar that looks through two prisms turning against each other: a rosette that never repeats.

    The pattern fills a cone about +x of `half_angle_deg`; `lines` lasers side by side, `line_step_deg` apart.
    """

    half_angle_deg: float
    prism_hz: tuple[float, float]
    lines: int
    line_step_deg: float
    shots_per_s: float
    rate_hz: float = 10.0
    start_ns: int = 0

    @property
    def ring(self) -> NDArray[np.uint16]:
        """Laser numbers."""
        return np.arange(self.lines, dtype=np.uint16)

    @property
    def period_s(self) -> float:
        """One published frame."""
        return 1.0 / self.rate_hz

    def count(self, duration_s: float) -> int:
        """Whole frames within the duration."""
        return int(np.floor(duration_s * self.rate_hz + 1e-9))

    def firings(self, index: int) -> Firings:
        """The frame's stretch of the endless rosette."""
        per_frame = round(self.shots_per_s / self.lines / self.rate_hz)
        columns = index * per_frame + np.arange(per_frame, dtype=np.int64)
        shot_ns = 1e9 / self.shots_per_s
        column_ns = self.start_ns + np.rint(columns * shot_ns * self.lines).astype(np.int64)
        channel_ns = np.rint(np.arange(self.lines) * shot_ns).astype(np.int64)
        t_s = (column_ns[:, None] - self.start_ns + channel_ns[None, :]) * 1e-9
        reach = np.deg2rad(self.half_angle_deg - self.line_step_deg * (self.lines - 1) / 2.0) / 2.0
        first, second = (2.0 * np.pi * hz * t_s for hz in self.prism_hz)
        fan = np.deg2rad(self.line_step_deg) * (np.arange(self.lines) - (self.lines - 1) / 2.0)
        across = reach * (np.cos(first) + np.cos(second))
        up = reach * (np.sin(first) + np.sin(second)) + fan
        off_axis = np.hypot(across, up)
        spread = np.sinc(off_axis / np.pi)
        directions = np.stack([np.cos(off_axis), across * spread, up * spread])
        return Firings(column_ns, channel_ns, directions)


@dataclass(frozen=True, slots=True)
class Lidar:
    """A lidar: its pattern, its noise, its limits, its driver.

    range_std_m: along the ray.   range_at_tenth_m: farthest surface of reflectivity 0.1 met head-on that still answers;
    the reach goes with the root of reflectivity times cosine of incidence.   miss_probability: lost for no reason.
    field_of_view_deg: azimuths kept, centred on +x, as drivers can be told to do.
    lost_columns_probability: a packet that never arrived.
    """

    pattern: Pattern
    layout: Layout
    topic: str
    frame_id: str
    range_std_m: float
    range_min_m: float = 0.4
    range_max_m: float = 100.0
    range_at_tenth_m: float = 50.0
    miss_probability: float = 0.0
    field_of_view_deg: float = 360.0
    lost_columns_probability: float = 0.0
    header_at: HeaderAt = "first"


@dataclass(frozen=True, slots=True)
class Imu:
    """An IMU: rate, noise, unit, driver.

    Densities are continuous-time; one reading's sigma is density x sqrt(rate). Random walks: bias sigma after t is
    walk x sqrt(t); 0 keeps a bias constant.   phase_s: of the first sample against the simulation's zero.
    """

    rate_hz: float
    gyroscope_noise_density_rad_s_sqrt_hz: float
    accelerometer_noise_density_m_s2_sqrt_hz: float
    topic: str = "/imu/data"
    frame_id: str = "imu_link"
    accelerometer_unit: Literal["m_s2", "g"] = "m_s2"
    gyroscope_random_walk: float = 0.0
    accelerometer_random_walk: float = 0.0
    phase_s: float = 0.003_37

    @property
    def gyroscope_std_rad_s(self) -> float:
        """Of one reading."""
        return float(self.gyroscope_noise_density_rad_s_sqrt_hz * np.sqrt(self.rate_hz))

    @property
    def accelerometer_std_m_s2(self) -> float:
        """Of one reading."""
        return float(self.accelerometer_noise_density_m_s2_sqrt_hz * np.sqrt(self.rate_hz))


@dataclass(frozen=True, slots=True)
class ImuFaults:
    """What goes wrong between the IMU and the bag.

    gaps_s: (start, length) of stretches without a message.   missing, duplicated, swapped: fractions of the messages
    lost, sent twice, sent after their follower.   jitter_s: sigma of the error of a stamp.
    """

    gaps_s: tuple[tuple[float, float], ...] = ()
    missing: float = 0.0
    duplicated: float = 0.0
    swapped: float = 0.0
    jitter_s: float = 0.0


NO_FAULTS = ImuFaults()
_STANDARD_GRAVITY = 9.80665

VLP_16 = Lidar(
    Spinning(
        elevations_deg=(-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0),
        channel_ns=tuple(2304 * laser for laser in range(16)),
        column_period_ns=55_296.0,
        columns_per_packet=24,
    ),
    layout="velodyne",
    topic="/velodyne_points",
    frame_id="velodyne",
    range_std_m=0.02,
)

XT_32 = Lidar(
    Spinning(
        elevations_deg=tuple(15.0 - channel for channel in range(32)),
        channel_ns=tuple(1512 * channel for channel in range(32)),
        column_period_ns=50_000.0,
        columns_per_packet=8,
    ),
    layout="hesai",
    topic="/hesai/pandar",
    frame_id="PandarXT-32",
    range_std_m=0.01,
    range_min_m=0.3,
    range_max_m=120.0,
    range_at_tenth_m=80.0,
)

OS1_64 = Lidar(
    Spinning(
        elevations_deg=tuple(16.6 - 33.2 / 63.0 * beam for beam in range(64)),
        azimuths_deg=tuple((-4.2, -1.4, 1.4, 4.2)[beam % 4] for beam in range(64)),
        channel_ns=(0,) * 64,
        column_period_ns=1e8 / 1024,
        columns_per_packet=16,
        origin_radius_m=0.015_806,
    ),
    layout="ouster",
    topic="/ouster/points",
    frame_id="os_lidar",
    range_std_m=0.015,
    range_min_m=0.5,
    lost_columns_probability=0.002,
)

LIVOX = Lidar(
    Rosette(half_angle_deg=35.2, prism_hz=(121.57, -77.73), lines=6, line_step_deg=0.35, shots_per_s=240_000.0),
    layout="livox",
    topic="/livox/lidar",
    frame_id="livox_frame",
    range_std_m=0.02,
    range_min_m=0.5,
    range_max_m=200.0,
    range_at_tenth_m=190.0,
)

MTI_3 = Imu(
    rate_hz=100.0,
    gyroscope_noise_density_rad_s_sqrt_hz=float(np.deg2rad(0.007)),
    accelerometer_noise_density_m_s2_sqrt_hz=120e-6 * _STANDARD_GRAVITY,
)

BMI_088_LIVOX = Imu(
    rate_hz=200.0,
    gyroscope_noise_density_rad_s_sqrt_hz=float(np.deg2rad(0.014)),
    accelerometer_noise_density_m_s2_sqrt_hz=175e-6 * _STANDARD_GRAVITY,
    topic="/livox/imu",
    frame_id="livox_frame",
    accelerometer_unit="g",
    phase_s=0.001_71,
)

ICM_20948_OUSTER = Imu(
    rate_hz=200.0,
    gyroscope_noise_density_rad_s_sqrt_hz=2.62e-4,
    accelerometer_noise_density_m_s2_sqrt_hz=2.26e-3,
    topic="/ouster/imu",
    frame_id="os_imu",
    phase_s=0.002_13,
)

BMI_085_HILTI = Imu(
    rate_hz=200.0,
    gyroscope_noise_density_rad_s_sqrt_hz=1.9e-4,
    accelerometer_noise_density_m_s2_sqrt_hz=1.32e-3,
    topic="/alphasense/imu",
    frame_id="imu_sensor_frame",
    phase_s=0.001_37,
)
