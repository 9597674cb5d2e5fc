"""Lidars and IMUs as data: firing patterns, noise, what they cannot see, and how their drivers publish."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib_core.simulate.patterns import Pattern, Rosette, Spinning

Layout = Literal["velodyne", "ouster", "hesai", "livox"]
HeaderAt = Literal["first", "last"]


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
    lost, sent twice, sent after their follower.   jitter_s: a stamp is wrong by up to this, evenly spread.
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
    miss_probability=0.01,
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
    miss_probability=0.003,
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
    miss_probability=0.005,
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
