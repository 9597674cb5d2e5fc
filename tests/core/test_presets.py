"""Presets by name, and their numbers against the data sheets' own units, converted here a second time."""

from __future__ import annotations

from dataclasses import astuple, fields

import numpy as np
import pytest

from calib_core.errors import SettingsError
from calib_core.intrinsics import UNKNOWN_IMU, UNKNOWN_LIDAR, ImuPrior, LidarPrior
from calib_core.presets import (
    IMU_PRESETS,
    LIDAR_PRESETS,
    USUAL_WALK,
    find_imu_preset,
    find_imu_prior,
    find_lidar_preset,
    find_lidar_prior,
    named_imu,
    named_lidar,
    random_walks,
)
from calib_core.settings import ImuNoise

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


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (("/velodyne_points", "velodyne"), "velodyne"),
        (("ultra_puck",), "velodyne-vlp32c"),
        (("vlp16_front",), "velodyne-vlp16"),
        (("VLP-32C",), "velodyne-vlp32c"),
        (("hdl32e",), "velodyne-hdl32e"),
        (("/os0/points",), "ouster-os0"),
        (("/os1_cloud_node/points",), "ouster-os"),
        (("os2",), "ouster-os2"),
        (("PandarXT-32",), "hesai-xt32"),
        (("Pandar64",), "hesai-pandar40"),
        (("/hesai/pandar",), "hesai"),
        (("rs16",), "robosense-16"),
        (("/rslidar_points", "rslidar"), "robosense"),
        (("rs_bpearl", "bpearl"), "robosense-bpearl"),
        (("/livox/lidar", "livox_frame"), "livox-avia"),
        (("livox_hap",), "livox-hap"),
        (("/happy/points",), None),
        (("/hap/points",), "livox-hap"),
        (("vlpoints",), None),
    ],
)
def test_lidars_are_found_by_their_names(texts: tuple[str, ...], expected: str | None) -> None:
    """Mutations: the general before the particular; short words that others begin with."""
    found = find_lidar_preset(*texts)
    assert (found.name if found else None) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("mti-30", "xsens-mti-30"),
        ("mti-300", "xsens-mti-300"),
        ("mti-1", "xsens-mti-3"),
        ("mti-680g", "xsens-mti-630"),
        ("vn200", "vectornav-vn100"),
        ("bmi270", "bosch-bmi270"),
        ("icm-42688-p", "tdk-icm42688"),
        ("lsm6dsox", "st-lsm6"),
        ("adis16477", "adis16475"),
        ("adis16448", "adis16448"),
        ("adis16460", "adis16470"),
    ],
)
def test_models_of_one_maker_are_told_apart(text: str, expected: str) -> None:
    """Mutation: `mti-3` before `mti-30` and `mti-300`."""
    found = find_imu_preset(text)
    assert found is not None
    assert found.name == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("os1-64", "ouster-os"),
        ("Ouster OS-2 128", "ouster-os2"),
        ("Velodyne VLP 16", "velodyne-vlp16"),
        ("RS-LiDAR 16", "robosense-16"),
        ("Helios 5515", "robosense"),
        ("hesai", "hesai"),
        ("HAP", "livox-hap"),
        ("velodyne-99", None),
        ("hesai qt128", None),
        ("robosense-64", None),
        ("sonar", None),
        ("", None),
    ],
)
def test_a_lidar_is_named_as_people_write_it(text: str, expected: str | None) -> None:
    """A number beside a maker's name is a model, which is not guessed. Mutations: one spelling alone; makers as models."""
    if expected is None:
        with pytest.raises(SettingsError, match=rf"one of livox-mid360, .*robosense, but found `{text}`"):
            named_lidar(text)
    else:
        assert named_lidar(text).name == expected


def test_presets_are_known_by_all_their_words() -> None:
    """Mutation: the text as written before the ways it may be spelled (`mti-700` is then any of its maker's)."""
    for preset in LIDAR_PRESETS:
        assert {named_lidar(text).name for text in (*preset.words, preset.name)} == {preset.name}
    for imu in IMU_PRESETS:
        assert {named_imu(text).name for text in (*imu.words, imu.name)} == {imu.name}
    assert [named_imu(text).name for text in ("ICM 20948", "bmi-270", "MTi 300")] == [
        "ouster-icm20948",
        "bosch-bmi270",
        "xsens-mti-300",
    ]


def test_a_random_walk_is_no_larger_than_its_allan_deviation() -> None:
    """Simulated: the Allan deviation of the walk alone, at 100 s, is the in-run bias stability of the sheet (MTi-1: 10
    deg/h). Mutation: the walk without its factor sqrt(3)."""
    gyro, accel = random_walks("xsens-mti-3")
    rng = np.random.default_rng(7)
    walk = np.cumsum(gyro * rng.standard_normal((400, 20_000)) * np.sqrt(0.1), axis=1)
    means = walk.reshape(400, 20, 1000).mean(axis=2)
    deviation = np.sqrt(0.5 * np.mean(np.diff(means, axis=1) ** 2))
    assert deviation == pytest.approx(10.0 * DEG_S / 3600.0, rel=0.03)
    assert accel / gyro == pytest.approx(30.0 * MICRO_G / (10.0 * DEG_S / 3600.0))


def test_a_presets_walks_are_used_and_an_unnamed_imu_walks_more_than_any_named_one() -> None:
    """Mutation: the usual walk whatever was named."""
    own = ImuNoise(
        gyroscope_noise_density_rad_s_sqrt_hz=1e-4,
        accelerometer_noise_density_m_s2_sqrt_hz=1e-3,
        gyroscope_random_walk=1e-6,
        accelerometer_random_walk=2e-6,
    )
    assert random_walks(own) == (1e-6, 2e-6)
    assert random_walks(None) == random_walks("nobody knows") == USUAL_WALK
    for preset in IMU_PRESETS:
        walks = random_walks(preset.name)
        assert walks == (preset.noise.gyroscope_random_walk, preset.noise.accelerometer_random_walk)
        assert walks <= USUAL_WALK
        assert walks[1] <= USUAL_WALK[1]


def test_priors_go_with_the_sensor() -> None:
    """Mutations: one prior for all; an unknown sensor taken for a good one (its scale of 0.5 %); degrees for radians, per cent
    for shares."""
    assert find_imu_prior("/imu/data", "imu_link") is UNKNOWN_IMU
    assert find_lidar_prior("/points") is UNKNOWN_LIDAR
    assert find_imu_prior("xsens").accelerometer_scale_std < 0.3 * UNKNOWN_IMU.accelerometer_scale_std
    assert find_lidar_prior("os1").laser_elevation_std_rad < 0.3 * UNKNOWN_LIDAR.laser_elevation_std_rad
    for record, presets in ((ImuPrior, IMU_PRESETS), (LidarPrior, LIDAR_PRESETS)):
        names = [field.name for field in fields(record)]
        for preset in presets:
            assert all(0.0 < value <= 0.02 for value in astuple(preset.prior)), (preset.name, names)
    for imu in IMU_PRESETS:
        if imu.name == "invensense-mpu6050":  # of the hobby boards alone: an unknown one is not taken for it
            continue
        assert all(own <= loosest for own, loosest in zip(astuple(imu.prior), astuple(UNKNOWN_IMU), strict=True)), (
            imu.name
        )
