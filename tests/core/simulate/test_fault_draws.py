"""Faults by name and size, and drawn: each by itself, and as large as the sensor's prior where no size is given."""

from __future__ import annotations

import numpy as np
import pytest

from calib_core.errors import SettingsError
from calib_core.presets import find_imu_prior, find_lidar_prior
from calib_core.simulate import SCENARIOS, parse_faults, prepare
from calib_core.simulate.faults import PROFILES, Fault
from tests.core.simulate.faulty import STATIC, made, truth_of


def test_a_draw_is_the_faults_own() -> None:
    """Mutations: one generator for all faults, so that asking for one more changes the others; the same numbers for two."""
    alone = truth_of(made("accel-scale=0.005"), "accelerometer_scale")
    among = truth_of(made("laser-offsets,gyro-scale,accel-scale=0.005"), "accelerometer_scale")
    assert alone == among
    gyro = truth_of(made("gyro-scale=0.005"), "gyroscope_scale")
    assert not np.allclose(list(gyro.values()), list(alone.values()))
    other = prepare(STATIC, seed=6, faults=parse_faults("accel-scale=0.005"))
    assert truth_of(other, "accelerometer_scale") != alone
    drawn = [
        truth_of(prepare(STATIC, seed=seed, faults=parse_faults("laser-offsets=1")), "laser_range_offset")
        for seed in range(40)
    ]
    values = np.array([list(each.values()) for each in drawn])
    assert values.std() == pytest.approx(1.0, abs=0.15)
    assert abs(values.mean()) < 0.15


def test_a_salt_gives_a_recording_noise_of_its_own() -> None:
    """Mutation: the salt left out of the seed. Without one, scenarios share their noise, on which paired figures rely."""
    plain = prepare("paper-normal", seed=3, duration_s=1.0)
    for scenario, salt, shared in (("walking-person", "", True), ("walking-person", "walking-person", False)):
        other = prepare(scenario, seed=3, duration_s=1.0, salt=salt)
        noise = [
            (s.imu_messages.gyro_rad_s - s.truth.imu(s.imu_messages.true_ns * 1e-9).omega_rad_s) for s in (plain, other)
        ]
        likeness = np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]
        assert (likeness > 0.99) if shared else abs(likeness) < 0.2


def test_without_a_size_a_fault_is_as_large_as_the_sensors_prior() -> None:
    """Mutations: the unknown sensor's prior for every sensor; the laser's elevation in degrees."""
    for slug, imu, lidar in (("ouster", "ouster-icm20948", "ouster-os"), ("handheld", "", "velodyne")):
        drawn = [
            prepare(slug, seed=s, faults=parse_faults("accel-scale,imu-axes,laser-elevation")).faults for s in range(60)
        ]
        axes = np.array([each.imu.accel_axes_rad for each in drawn])
        assert axes.std() == pytest.approx(find_imu_prior(imu).accelerometer_axes_std_rad, rel=0.25)
        scale = np.array([each.imu.accel_scale for each in drawn])
        assert scale.std() == pytest.approx(find_imu_prior(imu).accelerometer_scale_std, rel=0.25)
        angles = np.array([each.lidar.laser_elevation_rad for each in drawn])
        assert angles.std() == pytest.approx(find_lidar_prior(lidar).laser_elevation_std_rad, rel=0.1)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("slug", ["handheld", "ouster", "outdoor", "livox"])
def test_profiles_fit_every_lidar(profile: str, slug: str) -> None:
    """Mutations: lasers counted from the VLP-16; an encoder in a rosette."""
    simulation = made(profile, SCENARIOS[slug], duration_s=1.0)
    lasers = len(simulation.scenario.lidar.pattern.ring)
    for block in ("laser_range_offset", "laser_elevation", "laser_azimuth"):
        assert set(truth_of(simulation, block)) == {str(number) for number in range(lasers)}
    assert bool(truth_of(simulation, "eccentricity")) == (slug != "livox")
    assert simulation.sweep(2).valid.any()


def test_names_sizes_and_units_are_read() -> None:
    """Mutations: the first of two sizes counts; a unit of another quantity is taken."""
    assert parse_faults("") == ()
    assert parse_faults("laser-offsets=8mm, accel-scale=0.5%,clock-rate") == (
        Fault("laser-offsets", 0.008),
        Fault("accel-scale", 0.005),
        Fault("clock-rate"),
    )
    of_profile = {fault.name: fault.size for fault in parse_faults("industrial,laser-offsets=0.01")}
    assert of_profile["laser-offsets"] == 0.01
    assert of_profile["gyro-scale"] == 0.0005
    for wrong, said in (
        ("laser", "choose some of industrial"),
        ("laser-offsets=3deg", "in m or mm"),
        ("industrial=2", "no size"),
    ):
        with pytest.raises(SettingsError, match=said):
            parse_faults(wrong)
