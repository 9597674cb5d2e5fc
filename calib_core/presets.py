"""Noise of common IMUs and lidars by name, as continuous-time densities, each with where the number comes from.

Densities convert by 1 deg/s/sqrt(Hz) = 0.0174533 rad/s/sqrt(Hz) and 1 ug/sqrt(Hz) = 9.80665e-6 m/s2/sqrt(Hz). Bias
random walks are rarely in datasheets; conventional values are marked so in the source note. A preset is the fallback:
what a static start measures is preferred, and where the sensor is not identified the caller inflates the preset.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeVar

from calib_core.settings import ImuNoise

_Preset = TypeVar("_Preset", "ImuPreset", "LidarPreset")
_CONVENTION = "random walks by convention"


@dataclass(frozen=True, slots=True)
class ImuPreset:
    """One IMU. words: lower-case fragments that identify it in a topic, frame id or the user's own words.

    gyro_range_rad_s, accel_range_m_s2: usual full scale, for the saturation check; None where models differ.
    """

    name: str
    noise: ImuNoise
    source: str
    words: tuple[str, ...]
    gyro_range_rad_s: float | None = None
    accel_range_m_s2: float | None = None


@dataclass(frozen=True, slots=True)
class LidarPreset:
    """One lidar: standard deviation of a range, and of a bearing where it matters."""

    name: str
    range_std_m: float
    bearing_std_rad: float
    source: str
    words: tuple[str, ...]


def _noise(gyro: float, accel: float, gyro_walk: float = 1e-5, accel_walk: float = 1e-4) -> ImuNoise:
    return ImuNoise(
        gyroscope_noise_density_rad_s_sqrt_hz=gyro,
        accelerometer_noise_density_m_s2_sqrt_hz=accel,
        gyroscope_random_walk=gyro_walk,
        accelerometer_random_walk=accel_walk,
    )


#: The particular before the general: the first whose words are found wins.
IMU_PRESETS: tuple[ImuPreset, ...] = (
    ImuPreset(
        "livox-mid360",
        _noise(7.9e-5, 9.8e-4),
        f"TDK ICM-40609-D: datasheet DS-000330; {_CONVENTION}",
        ("mid360", "mid-360", "icm40609", "icm-40609", "mid_360"),
    ),
    ImuPreset(
        "livox-avia",
        _noise(2.4e-4, 1.7e-3, 2e-5, 1e-4),
        f"Bosch BMI088: fitment and densities unconfirmed; {_CONVENTION}",
        ("livox", "avia", "bmi088"),
    ),
    ImuPreset(
        "bosch-bmi085",
        _noise(1.9e-4, 1.32e-3, 2.66e-4, 4.3e-3),
        "Hilti 2022 and Oxford Spires data set files",
        ("bmi085", "alphasense", "hilti"),
    ),
    ImuPreset(
        "ouster-iam20680",
        _noise(2.6e-4, 2.3e-3, 2.6e-5, 2.3e-4),
        "TDK IAM-20680HT in newer OS0 and OS1: ENWIDE data set files, accelerometer corrected by ten",
        ("iam20680", "iam-20680"),
    ),
    ImuPreset(
        "ouster-icm20948",
        _noise(2.62e-4, 2.26e-3, 2.6e-5, 2.3e-4),
        "TDK ICM-20948 in Ouster generations 1 and 2: Newer College 2021 data set files",
        ("ouster", "os_imu", "os_cloud", "os0", "os1", "os2", "icm20948", "icm-20948"),
    ),
    ImuPreset(
        "xsens-mti-300",
        _noise(1.7e-4, 5.9e-4),
        f"Xsens MTi-300 data sheet; {_CONVENTION}",
        ("mti-300", "mti300", "mti-3xx"),
        gyro_range_rad_s=7.85,
        accel_range_m_s2=196.0,
    ),
    ImuPreset(
        "xsens-mti-630",
        _noise(1.2e-4, 5.9e-4),
        f"Xsens MTi-630: iilab benchmark table; {_CONVENTION}",
        ("mti-630", "mti630"),
    ),
    ImuPreset(
        "xsens-mti-3",
        _noise(1.2e-4, 1.18e-3),
        f"Xsens MTi-1 series, earlier hardware: 2023 journal table quoting the data sheet; {_CONVENTION}",
        ("xsens", "mti-3", "mti3", "mti-1", "mti1", "mti"),
        gyro_range_rad_s=34.9,
        accel_range_m_s2=157.0,
    ),
    ImuPreset(
        "vectornav-vn100",
        _noise(6.1e-5, 1.37e-3, 1e-5, 5e-5),
        "VectorNav VN-100: public Kalibr file quoting the data sheet and the vendor's support",
        ("vectornav", "vn100", "vn-100", "vn_100"),
        gyro_range_rad_s=34.9,
        accel_range_m_s2=157.0,
    ),
    ImuPreset(
        "invensense-mpu6050",
        _noise(8.7e-5, 3.9e-3),
        f"InvenSense PS-MPU-6000A revision 3.4; {_CONVENTION}",
        ("mpu6050", "mpu-6050", "mpu6000", "mpu9250"),
    ),
    ImuPreset(
        "microstrain-gx5-25",
        _noise(7.0e-5, 1.8e-4, 3.6e-5, 6.4e-5),
        "Microstrain 3DM-GX5-25: LIO-SAM's discrete 1.56e-3 rad/s and 3.99e-3 m/s2, taken at its 500 Hz",
        ("microstrain", "gx5", "3dm"),
        gyro_range_rad_s=5.24,
        accel_range_m_s2=78.0,
    ),
)

#: For an IMU nobody names: the middle of the consumer sensors above. Callers inflate it.
GENERIC_IMU = ImuPreset(
    "generic-mems", _noise(2e-4, 2e-3, 2e-5, 2e-4), f"middle of common MEMS sensors; {_CONVENTION}", ()
)

_ARC_0_05_DEG = 8.7e-4
LIDAR_PRESETS: tuple[LidarPreset, ...] = (
    LidarPreset("livox-mid360", 0.02, 2.6e-3, "integrator page quoting the data sheet", ("mid360", "mid-360")),
    LidarPreset("livox-avia", 0.02, _ARC_0_05_DEG, "data sheet, 20 m; unconfirmed", ("livox", "avia", "horizon")),
    LidarPreset(
        "velodyne-vlp16",
        0.02,
        _ARC_0_05_DEG,
        "start value; the sheet gives 3 cm typical accuracy",
        ("vlp16", "vlp-16", "vlp_16", "puck"),
    ),
    LidarPreset(
        "velodyne",
        0.02,
        _ARC_0_05_DEG,
        "start value for any of the maker's; the sheets give 2 to 3 cm typical accuracy",
        ("velodyne", "vlp", "hdl", "vls"),
    ),
    LidarPreset(
        "ouster-os",
        0.015,
        _ARC_0_05_DEG,
        "OS1 data sheet at high signal",
        ("ouster", "os_lidar", "os_sensor", "os0", "os1", "os2"),
    ),
    LidarPreset(
        "hesai-xt32", 0.01, _ARC_0_05_DEG, "data sheet accuracy; unconfirmed", ("hesai", "pandar", "xt32", "xt16")
    ),
    LidarPreset(
        "robosense", 0.03, _ARC_0_05_DEG, "Airy and Helios; unconfirmed", ("rslidar", "robosense", "airy", "helios")
    ),
)
GENERIC_LIDAR = LidarPreset("generic-lidar", 0.03, _ARC_0_05_DEG, "middle of common sensors", ())


def find_imu_preset(*texts: str) -> ImuPreset | None:
    """The preset that one of the texts (a preset's name, topic, frame id) names, or None. Earlier texts win."""
    return _find(IMU_PRESETS, texts)


def find_lidar_preset(*texts: str) -> LidarPreset | None:
    """The preset that one of the texts (a preset's name, topic, frame id, layout) names, or None."""
    return _find(LIDAR_PRESETS, texts)


def _find(presets: tuple[_Preset, ...], texts: tuple[str, ...]) -> _Preset | None:
    for text in texts:
        lowered = text.lower()
        named = next((p for p in presets if p.name == lowered), None)
        if named is not None:
            return named
        # Words count only where no letter or digit runs on before them: "os1" is not in "pos1".
        for preset in presets:
            if any(re.search(rf"(?<![a-z0-9]){re.escape(word)}", lowered) for word in preset.words):
                return preset
    return None
