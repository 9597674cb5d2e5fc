"""What a real sensor adds to an ideal one: names, units and signs of its own parameters, and how large they usually are.

IMU frame: the accelerometer's x axis and xy plane define it; the gyroscope is turned into it. With w, a the true angular
rate and specific force in that frame:

    gyroscope reading(t)     = (I + S_g + N_g) Exp(r_g) w(t) + F a(t) + bias + noise
    accelerometer reading(t) = (I + S_a + N_a) (a + q a^2 + e)(t - delay) + bias + noise
    S = diag(x, y, z)  scale,      N = strictly lower triangular (yx, zx, zy)  axes,      r_g  rotation of the gyroscope
    F = what the gyroscope feels of forces (xx, xy, ... zz: by rows), its g-sensitivity
    q  axis by axis, the accelerometer's second-order scale (x, y, z): how its line bends
    e_k = axis k of  w' x r_k + w x (w x r_k),      r_k (kx, ky, kz)  where the accelerometer of axis k is: the size effect

What it reads has been through a low-pass filter of its own, h. The mean of h is a delay, which the time offset has with it; of
motion slower than its cutoff its second and third central moments, its spread v and skew u, are all that is left of the rest:

    reading(t) = x(t) + v / 2 x''(t) - u / 6 x'''(t)        one of each for the gyroscope, one for the accelerometer

The IMU's place is the one where, as far as anybody knows, all its accelerometers are; where they turn out to be apart, their
middle, which is then known no better than they are near one another.

Clocks: t_lidar = t_imu + time_offset + rate 1e-6 (t_lidar - time_offset_at): the offset grows where the rate is positive.

Lidar, of the point that laser l returns from true range d at incidence cosine c:

    published range = d (1 + range_scale_l) + range_offset_l + range_offset + incidence (1 / c - 1) - grazing d tan(acos c)
    true elevation  = published elevation + elevation_l          [from the lidar's xy plane, upwards]
    true azimuth    = published azimuth + azimuth_l + sine sin(published azimuth) + cosine cos(published azimuth)

so that a laser that reads 9 mm short has a range offset of -0.009 m.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal, TypeVar

Block = Literal[
    "gyroscope_scale",
    "gyroscope_axes",
    "gyroscope_rotation",
    "accelerometer_scale",
    "accelerometer_axes",
    "accelerometer_delay",
    "accelerometer_quadratic",
    "g_sensitivity",
    "size_effect",
    "low_pass_spread",
    "low_pass_skew",
    "clock_rate",
    "laser_range_offset",
    "laser_elevation",
    "laser_azimuth",
    "laser_range_scale",
    "eccentricity",
    "range_offset",
    "incidence",
    "grazing",
]

#: One g, in which sheets count and some sensors tell accelerations.
STANDARD_GRAVITY_M_S2 = 9.80665
AXES = ("x", "y", "z")
LOWER = ("yx", "zx", "zy")
TRIADS = ("gyroscope", "accelerometer")
#: Whose a block is: the IMU's; the clocks'; each laser's; all lasers' together.
Owner = Literal["imu", "clock", "laser", "lidar"]
#: What has a data sheet.
Sensor = Literal["imu", "lidar"]


@dataclass(frozen=True, slots=True)
class Kind:
    """What a block is. names: within it; those of the lasers are their numbers, "0" on."""

    owner: Owner
    unit: str
    names: tuple[str, ...] = ()


#: Every block, in the order of the unknowns.
KINDS: dict[Block, Kind] = {
    "gyroscope_scale": Kind("imu", "1", AXES),
    "gyroscope_axes": Kind("imu", "rad", LOWER),
    "gyroscope_rotation": Kind("imu", "rad", AXES),
    "accelerometer_scale": Kind("imu", "1", AXES),
    "accelerometer_axes": Kind("imu", "rad", LOWER),
    "accelerometer_delay": Kind("imu", "s", ("delay",)),
    "accelerometer_quadratic": Kind("imu", "1/(m/s2)", AXES),
    "g_sensitivity": Kind("imu", "rad/s/(m/s2)", tuple(row + column for row in AXES for column in AXES)),
    "size_effect": Kind("imu", "m", tuple(row + column for row in AXES for column in AXES)),
    "low_pass_spread": Kind("imu", "s2", TRIADS),
    "low_pass_skew": Kind("imu", "s3", TRIADS),
    "clock_rate": Kind("clock", "ppm", ("rate",)),
    "laser_range_offset": Kind("laser", "m"),
    "laser_elevation": Kind("laser", "rad"),
    "laser_azimuth": Kind("laser", "rad"),
    "laser_range_scale": Kind("laser", "1"),
    "eccentricity": Kind("lidar", "rad", ("sine", "cosine")),
    "range_offset": Kind("lidar", "m", ("all",)),
    "incidence": Kind("lidar", "m", ("all",)),
    "grazing": Kind("lidar", "rad", ("all",)),
}
UNITS: dict[Block, str] = {block: kind.unit for block, kind in KINDS.items()}
NAMES: dict[Block, tuple[str, ...]] = {block: kind.names for block, kind in KINDS.items() if kind.names}


def blocks_of(owner: Owner) -> tuple[Block, ...]:
    """The blocks of one owner, in order."""
    return tuple(block for block, kind in KINDS.items() if kind.owner == owner)


_Prior = TypeVar("_Prior", "ImuPrior", "LidarPrior")


def _wider(a: _Prior, b: _Prior) -> _Prior:
    return type(a)(**{each.name: max(getattr(a, each.name), getattr(b, each.name)) for each in fields(a)})


@dataclass(frozen=True, slots=True)
class ImuPrior:
    """Standard deviations of an IMU's own parameters about those of an ideal one."""

    gyroscope_scale_std: float
    gyroscope_axes_std_rad: float
    gyroscope_rotation_std_rad: float
    accelerometer_scale_std: float
    accelerometer_axes_std_rad: float
    accelerometer_delay_std_s: float
    accelerometer_quadratic_std_s2_m: float
    g_sensitivity_std_rad_s_m_s2: float

    def or_wider(self, other: ImuPrior) -> ImuPrior:
        """Of each the wider."""
        return _wider(self, other)


@dataclass(frozen=True, slots=True)
class LidarPrior:
    """Standard deviations of a lidar's own parameters. laser_*: of each laser by itself; 0 where it has no lasers to tell.

    Azimuths are taken to be as uncertain as elevations, but for their mean, which is a turn of the whole lidar: where lasers look
    to in the mean is the lidar's frame (prepare/nuisance.py). A turning lidar's encoder is off its axis by `eccentricity`, once a
    turn. A beam that meets a surface slantwise lights a spot as deep as its divergence times range and tangent, and a leading
    edge triggers between the spot's near end and halfway: `grazing` is that share of it. Data sheets have beams of 3 mrad, half
    of which is the near end.
    """

    laser_range_offset_std_m: float
    laser_elevation_std_rad: float
    laser_range_scale_std: float
    range_offset_std_m: float
    incidence_std_m: float
    eccentricity_std_rad: float = 3.5e-4
    grazing_std_rad: float = 1e-3

    def or_wider(self, other: LidarPrior) -> LidarPrior:
        """Of each the wider."""
        return _wider(self, other)


#: Two free-running crystals against each other: 10 to 50 ppm is usual, Velodyne's HDL-64E manual gives 58.
CLOCK_RATE_STD_PPM = 40.0

#: A sensor that nobody has named is taken for a cheap one: as loose as the loosest of the sheets that presets quote, hobby
#: boards left out (BMI160 and LSM6: scale within 1 %; ICM-20948: axes within 2 %, a limit; 0.1 deg/s a g as sheets of MEMS
#: gyroscopes have it, unconfirmed), a VLP-16 measured on public packets (5 to 10 mm a laser), OA-LICalib's published VLP-16
#: (range scale 0.4 %).
UNKNOWN_IMU = ImuPrior(
    gyroscope_scale_std=0.01,
    gyroscope_axes_std_rad=0.01,
    gyroscope_rotation_std_rad=0.01,
    accelerometer_scale_std=0.01,
    accelerometer_axes_std_rad=0.01,
    accelerometer_delay_std_s=0.002,
    accelerometer_quadratic_std_s2_m=1.1e-4,
    g_sensitivity_std_rad_s_m_s2=1.8e-4,
)
UNKNOWN_LIDAR = LidarPrior(
    laser_range_offset_std_m=0.008,
    laser_elevation_std_rad=0.0009,
    laser_range_scale_std=0.003,
    range_offset_std_m=0.01,
    incidence_std_m=0.002,
)
