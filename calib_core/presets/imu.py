"""IMUs: densities as data sheets give them (deg/s and ug per root of a hertz), in-run bias stabilities, scales and axes.

Tolerances that a sheet calls typical are taken as one standard deviation, limits as two.
"""

from __future__ import annotations

import math

from calib_core.intrinsics import STANDARD_GRAVITY_M_S2, UNKNOWN_IMU, ImuPrior
from calib_core.presets.records import ImuPreset
from calib_core.presets.walks import accelerometer_walk, gyroscope_walk
from calib_core.settings import ImuNoise

_DEG = math.pi / 180.0
#: In-run bias stability of parts whose sheets give none: that of a middling uncompensated part, doubled for warming up.
_UNGIVEN_DEG_H, _UNGIVEN_UG = 20.0, 100.0


def _noise(
    gyro_deg_s: float, accel_ug: float, in_run_deg_h: float = _UNGIVEN_DEG_H, in_run_ug: float = _UNGIVEN_UG
) -> ImuNoise:
    return ImuNoise(
        gyroscope_noise_density_rad_s_sqrt_hz=gyro_deg_s * _DEG,
        accelerometer_noise_density_m_s2_sqrt_hz=accel_ug * 1e-6 * STANDARD_GRAVITY_M_S2,
        gyroscope_random_walk=gyroscope_walk(in_run_deg_h),
        accelerometer_random_walk=accelerometer_walk(in_run_ug),
    )


def _prior(
    scale: tuple[float, float],
    axes: tuple[float, float],
    between: float,
    delay_s: float,
    *,
    felt_deg_s_g: float = 0.1,
    bent_mg: float = 1.0,
) -> ImuPrior:
    """scale, axes [rad]: of gyroscope and accelerometer.   between [rad]: the two against each other.   felt_deg_s_g: of
    forces by the gyroscope.   bent_mg: of what the accelerometer reads too much at one g for the bend of its line."""
    return ImuPrior(
        gyroscope_scale_std=scale[0],
        gyroscope_axes_std_rad=axes[0],
        gyroscope_rotation_std_rad=between,
        accelerometer_scale_std=scale[1],
        accelerometer_axes_std_rad=axes[1],
        accelerometer_delay_std_s=delay_s,
        accelerometer_quadratic_std_s2_m=bent_mg * 1e-3 / STANDARD_GRAVITY_M_S2,
        g_sensitivity_std_rad_s_m_s2=felt_deg_s_g * _DEG / STANDARD_GRAVITY_M_S2,
    )


#: Calibrated one by one over temperature: 0.03 to 0.1 % of scale, 0.02 to 0.05 deg between axes; the two sensors' filters
#: and sampling are aligned to less than half a millisecond, the gyroscope feels 0.003 to 0.006 deg/s a g (unconfirmed); lines
#: bend by 0.03 % of 20 g.
CALIBRATED = _prior((0.0007, 0.0007), (0.0005, 0.0005), 0.0005, 0.0003, felt_deg_s_g=0.006, bent_mg=0.05)
#: Factory-calibrated modules whose sheets promise less: 0.1 deg between axes, some 0.5 % of scale, 0.015 deg/s a g.
MODULE = _prior((0.004, 0.003), (0.0012, 0.0012), 0.0012, 0.0005, felt_deg_s_g=0.015, bent_mg=0.3)
#: One die for both sensors, or two in a package, trimmed at the end of the line. Sheets give 0.5 % of the range, 2 g at the
#: least, as the most by which an accelerometer's line bends: a parabola of 5 mg at one g does that; most do a fifth of it.
CHIP = _prior((0.005, 0.005), (0.005, 0.005), 0.005, 0.002)

_MTI = "gyroscope and accelerometer calibrated one by one over temperature"
_BUILT_IN = "fitment as commonly stated"

#: The particular before the general: the first whose words are found wins.
IMU_PRESETS: tuple[ImuPreset, ...] = (
    ImuPreset(
        "livox-mid360",
        _noise(0.0045, 100.0),
        _prior((0.005, 0.005), (0.0075, 0.0075), 0.005, 0.002),
        f"TDK ICM-40609-D, data sheet DS-000330: densities, scale 0.5 %; cross axis unconfirmed; {_BUILT_IN}",
        ("mid360", "mid-360", "icm40609", "icm-40609", "mid_360"),
    ),
    ImuPreset(
        "livox-avia",
        _noise(0.014, 175.0),
        CHIP,
        "Bosch BMI088, BST-BMI088-DS001: 160 ug across, 190 ug along z; the fitment and tolerances unconfirmed",
        ("livox", "avia", "bmi088"),
    ),
    ImuPreset(
        "bosch-bmi085",
        _noise(0.0109, 135.0),
        CHIP,
        "Hilti 2022 and Oxford Spires data set files; data sheet 0.014 deg/s, 120 to 135 ug, unconfirmed",
        ("bmi085", "alphasense", "hilti"),
    ),
    ImuPreset(
        "bosch-bmi160",
        _noise(0.007, 180.0),
        _prior((0.01, 0.005), (0.01, 0.01), 0.005, 0.002),
        "Bosch BST-BMI160-DS000, unconfirmed",
        ("bmi160",),
    ),
    ImuPreset(
        "bosch-bmi270",
        _noise(0.007, 160.0),
        _prior((0.01, 0.004), (0.005, 0.005), 0.005, 0.002),
        "Bosch BST-BMI270-DS000, unconfirmed; gyroscope without component retrimming",
        ("bmi270",),
    ),
    ImuPreset(
        "tdk-icm42688",
        _noise(0.0028, 70.0),
        _prior((0.005, 0.005), (0.006, 0.005), 0.005, 0.002),
        "TDK ICM-42688-P, data sheet DS-000347: densities; scale 0.5 %, cross axis 1 to 1.25 % unconfirmed",
        ("icm42688", "icm-42688"),
    ),
    ImuPreset(
        "st-lsm6",
        _noise(0.0038, 70.0),
        _prior((0.01, 0.01), (0.005, 0.005), 0.005, 0.002),
        "ST LSM6DSO, DS12140: unconfirmed; sensitivity within 1 %, cross axis not given",
        ("lsm6",),
    ),
    ImuPreset(
        "ouster-iam20680",
        _noise(0.0149, 234.5),
        _prior((0.01, 0.005), (0.01, 0.01), 0.005, 0.002),
        f"TDK IAM-20680HT in newer OS0 and OS1: ENWIDE data set files, accelerometer corrected by ten; {_BUILT_IN}",
        ("iam20680", "iam-20680"),
    ),
    ImuPreset(
        "ouster-icm20948",
        _noise(0.015, 230.0),
        _prior((0.0075, 0.005), (0.01, 0.01), 0.005, 0.002),
        "TDK ICM-20948, data sheet DS-000189: 230 ug, accelerometer scale 0.5 %, cross axis 2 %; gyroscope scale 1.5 % as a "
        f"limit, unconfirmed; Ouster generations 1 and 2, {_BUILT_IN}",
        ("ouster", "os_imu", "os_cloud", "os0", "os1", "os2", "icm20948", "icm-20948"),
    ),
    ImuPreset(
        "xsens-mti-630",
        _noise(0.007, 60.0, 8.0, 15.0),
        CALIBRATED,
        f"Xsens MTi 600-series data sheet MT1603P and iilab benchmark table; {_MTI}; in-run figures unconfirmed",
        ("mti-6", "mti6", "mti_6", "mti-600"),
    ),
    ImuPreset(
        "xsens-mti-300",
        _noise(0.01, 60.0, 10.0, 15.0),
        CALIBRATED,
        f"Xsens MTi 100-series, manual MT0605P; {_MTI}; accelerometer's in-run figure unconfirmed",
        (
            "mti-300",
            "mti300",
            "mti-3xx",
            "mti-100",
            "mti100",
            "mti-200",
            "mti200",
            "mti-g",
            "mti-7xx",
            "mti-700",
            "mti-710",
        ),
    ),
    ImuPreset(
        "xsens-mti-30",
        _noise(0.03, 60.0, 18.0, 15.0),
        CALIBRATED,
        f"Xsens MTi 10-series, manual MT0605P; {_MTI}; figures unconfirmed",
        ("mti-30", "mti30", "mti-20", "mti20", "mti-10", "mti10"),
    ),
    ImuPreset(
        "xsens-mti-3",
        _noise(0.007, 120.0, 10.0, 30.0),
        CALIBRATED,
        f"Xsens MTi-1 series, earlier hardware: 2023 journal table quoting the data sheet, in-run figures too; {_MTI}",
        ("xsens", "mti-3", "mti3", "mti-1", "mti1", "mti"),
    ),
    ImuPreset(
        "vectornav-vn100",
        _noise(0.0035, 140.0, 7.0, 40.0),
        _prior((0.001, 0.001), (0.0009, 0.0009), 0.0009, 0.0003, felt_deg_s_g=0.015, bent_mg=0.3),
        "VectorNav VN-100 and VN-200: public Kalibr file quoting the data sheet and the vendor's support; alignment within "
        "0.05 deg and in-run figures unconfirmed",
        ("vectornav", "vn100", "vn-100", "vn_100", "vn200", "vn-200", "vn_200"),
    ),
    ImuPreset(
        "invensense-mpu6050",
        _noise(0.005, 400.0),
        _prior((0.015, 0.015), (0.01, 0.01), 0.005, 0.002),
        "InvenSense PS-MPU-6000A revision 3.4; scale 3 % as a limit, cross axis 2 %, unconfirmed",
        ("mpu6050", "mpu-6050", "mpu6000", "mpu9250"),
    ),
    ImuPreset(
        "microstrain-gx5-25",
        _noise(0.004, 18.4, 8.0, 40.0),
        _prior((0.0005, 0.0005), (0.0009, 0.0009), 0.0009, 0.0003, felt_deg_s_g=0.015, bent_mg=0.3),
        "Microstrain 3DM-GX5-25: LIO-SAM's discrete 1.56e-3 rad/s and 3.99e-3 m/s², taken at its 500 Hz; scale 0.05 %, "
        "alignment 0.05 deg and in-run figures unconfirmed",
        ("microstrain", "gx5", "3dm"),
    ),
    ImuPreset(
        "adis16448",
        _noise(0.0135, 230.0, 14.5, 250.0),
        MODULE,
        "Analog Devices ADIS16448 data sheet; unconfirmed",
        ("adis16448", "adis1644"),
    ),
    ImuPreset(
        "adis16475",
        _noise(0.0025, 23.0, 2.0, 3.6),
        _prior((0.002, 0.002), (0.0017, 0.0017), 0.0017, 0.0003, felt_deg_s_g=0.015, bent_mg=0.3),
        "Analog Devices ADIS16475 data sheet: 0.15 deg per root of an hour, 2 deg/h, 3.6 ug, axes within 0.1 deg; "
        "accelerometer's density and scales unconfirmed",
        ("adis16475", "adis16465", "adis16467", "adis16477", "adis165"),
    ),
    ImuPreset(
        "adis16488",
        _noise(0.0059, 63.0, 5.1, 70.0),
        MODULE,
        "Analog Devices ADIS16488 data sheet; unconfirmed",
        ("adis1648", "adis1649"),
    ),
    ImuPreset(
        "adis16470",
        _noise(0.008, 100.0, 8.0, 13.0),
        MODULE,
        "Analog Devices ADIS16470 data sheet: 0.008 deg/s, 8 deg/h, 13 ug; accelerometer's density and tolerances unconfirmed",
        ("adis",),
    ),
)

#: For an IMU nobody names: the middle of the consumer sensors above. Callers inflate it.
GENERIC_IMU = ImuPreset("generic-mems", _noise(0.0115, 204.0), UNKNOWN_IMU, "middle of common MEMS sensors", ())
