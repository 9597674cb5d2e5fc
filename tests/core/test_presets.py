"""Presets by name, and their numbers against the table of formats.md, converted here a second time."""

from __future__ import annotations

import pytest

from calib_core.presets import IMU_PRESETS, LIDAR_PRESETS, find_imu_preset, find_lidar_preset

DEG_S, MICRO_G = 0.017453292519943295, 9.80665e-6


@pytest.mark.parametrize(
    ("name", "gyro", "accel"),
    [
        ("livox-mid360", 0.0045 * DEG_S, 100 * MICRO_G),
        ("livox-avia", 0.014 * DEG_S, 175 * MICRO_G),
        ("xsens-mti-3", 0.007 * DEG_S, 120 * MICRO_G),
        ("xsens-mti-300", 0.01 * DEG_S, 60 * MICRO_G),
        ("xsens-mti-630", 0.007 * DEG_S, 60 * MICRO_G),
        ("vectornav-vn100", 0.0035 * DEG_S, 140 * MICRO_G),
        ("ouster-icm20948", 0.015 * DEG_S, 230 * MICRO_G),
        ("ouster-iam20680", 0.015 * DEG_S, 235 * MICRO_G),
        ("invensense-mpu6050", 0.005 * DEG_S, 400 * MICRO_G),
    ],
)
def test_densities_follow_from_the_data_sheets(name: str, gyro: float, accel: float) -> None:
    """Mutation: write an accelerometer density without the factor ten, as public lists do."""
    preset = find_imu_preset(name)
    assert preset is not None
    assert preset.noise.gyroscope_noise_density_rad_s_sqrt_hz == pytest.approx(gyro, rel=0.03)
    assert preset.noise.accelerometer_noise_density_m_s2_sqrt_hz == pytest.approx(accel, rel=0.03)


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (("/livox/imu",), "livox-avia"),
        (("/mid360/imu", "livox_frame"), "livox-mid360"),
        (("/imu/data", "os_imu"), "ouster-icm20948"),
        (("VectorNav-VN100",), "vectornav-vn100"),
        (("/vectornav/imu",), "vectornav-vn100"),
        (("/imu/data", "imu_link"), None),
        (("/pos1/imu", ""), None),
        (("", "xsens"), "xsens-mti-3"),
    ],
)
def test_sensors_are_found_by_their_names(texts: tuple[str, ...], expected: str | None) -> None:
    """Mutation: search words anywhere inside a word ("pos1" is then an Ouster)."""
    found = find_imu_preset(*texts)
    assert (found.name if found else None) == expected


def test_every_preset_has_a_source_and_a_name_of_its_own() -> None:
    """Mutation: name two presets alike."""
    for presets in (IMU_PRESETS, LIDAR_PRESETS):
        assert len({p.name for p in presets}) == len(presets)
        assert all(p.source and p.words for p in presets)
    lidar = find_lidar_preset("/velodyne_points", "velodyne")
    assert lidar is not None
    assert lidar.range_std_m == 0.02
