"""The IMU's noise: as a solve will measure it, beside what its preset says, and which of the two is used."""

from __future__ import annotations

from calib_core.doctor.report import ImuNoiseReport
from calib_core.full.prepare.imu_noise import noise_of
from calib_core.full.prepare.settings import LENGTH
from calib_core.imu.quantisation import resolution
from calib_core.presets import ImuPreset
from calib_core.settings import ImuNoise
from calib_core.types import ImuData

#: Measured noise further from an identified preset than this is remarked on.
_FAR = 4.0


def measured_noise(imu: ImuData) -> ImuNoiseReport | None:
    """The noise that a solve measures in readings that were taken at these times; None where there are too few."""
    if imu.stamps_ns.size < LENGTH.fewest_readings:
        return None
    stamps_s = (imu.stamps_ns - imu.stamps_ns[0]) * 1e-9
    level, still = noise_of(stamps_s, imu)
    still_s = 0.0 if still is None else float(stamps_s[still.stop - 1] - stamps_s[still.start])
    return ImuNoiseReport(
        origin="measured",
        noise=ImuNoise(
            gyroscope_noise_density_rad_s_sqrt_hz=float(level.density.gyro_rad_s_sqrt_hz[0]),
            accelerometer_noise_density_m_s2_sqrt_hz=float(level.density.accel_m_s2_sqrt_hz[0]),
        ),
        source=level.source,
        static_s=round(still_s, 3) if "standstill" in level.source else 0.0,
        gyroscope_resolution_rad_s=float(resolution(imu.gyro_rad_s).max()),
        accelerometer_resolution_m_s2=float(resolution(imu.accel_m_s2).max()),
    )


def noise_in_words(measured: ImuNoiseReport | None, preset: ImuPreset, *, identified: bool) -> str:
    """Both numbers and which is used, in a sentence or two."""
    known = f"The preset {preset.name}" if identified else f"The preset {preset.name} (the IMU was not recognised)"
    says = f"{known} says {_densities(preset.noise)}"
    if measured is None:
        return f"{says}; too few readings to measure it."
    text = f"Measured and used: {_densities(measured.noise)}, from {measured.source}. {says}."
    gyro = measured.noise.gyroscope_noise_density_rad_s_sqrt_hz / preset.noise.gyroscope_noise_density_rad_s_sqrt_hz
    accel = (
        measured.noise.accelerometer_noise_density_m_s2_sqrt_hz / preset.noise.accelerometer_noise_density_m_s2_sqrt_hz
    )
    if identified and max(gyro, accel) > _FAR:
        text += f" That is {max(gyro, accel):.0f} times the preset's: the mounting vibrates, or it is another sensor."
    return text


def _densities(noise: ImuNoise) -> str:
    return (
        f"{noise.gyroscope_noise_density_rad_s_sqrt_hz:.2g} rad/s/\N{SQUARE ROOT}Hz and "
        f"{noise.accelerometer_noise_density_m_s2_sqrt_hz:.2g} m/s\N{SUPERSCRIPT TWO}/\N{SQUARE ROOT}Hz"
    )
