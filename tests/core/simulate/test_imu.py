"""Inertial readings against textbook motion, against their own integral, and their noise against its law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from calib_core.simulate import SCENARIOS, generate, prepare
from calib_core.simulate.motion import Kinematics, Pose, Sway
from calib_core.simulate.scenario import Scenario, mounting_from
from calib_core.simulate.sensors import MTI_3, ImuFaults
from calib_core.types import FloatArray

STATIC = replace(SCENARIOS["static"], duration_s=30.0)


class Turntable:
    """A body at the origin that turns about the world's z at a constant rate: closed form, no waves."""

    rate_rad_s = 2.5

    def kinematics(self, t_s: FloatArray) -> Kinematics:
        n = t_s.shape[0]
        zero = np.zeros((n, 3))
        spin = np.tile([0.0, 0.0, self.rate_rad_s], (n, 1))
        R = Rotation.from_rotvec(self.rate_rad_s * t_s[:, None] * np.array([0.0, 0.0, 1.0])).as_matrix()
        return Kinematics(R, zero, zero, zero, spin, zero)


def test_an_imu_on_a_turntable_feels_the_centripetal_force() -> None:
    """Fails when gravity's sign flips, when the lever arm is T_imu_lidar's own translation instead of its inverse's,
    or when rates are left in the lidar's axes.

    The IMU sits at radius r on the turntable, its x axis pointing outwards: specific force -w^2 r along x, +g along z.
    """
    radius = 0.4
    # T_lidar_imu: turned by 90 degrees about z, at (0, r, 0); its x axis is the lidar's y axis, outwards.
    R_lidar_imu, p_lidar_imu = Rotation.from_euler("z", 90.0, degrees=True), np.array([0.0, radius, 0.0])
    x, y, z = -R_lidar_imu.inv().apply(p_lidar_imu)
    qx, qy, qz, qw = R_lidar_imu.inv().as_quat()
    scenario = replace(STATIC, motion=Turntable(), mounting=(x, y, z, qx, qy, qz, qw), noise=False, duration_s=1.0)
    recording, _ = generate(scenario)
    n = recording.imu.stamps_ns.shape[0]
    np.testing.assert_allclose(recording.imu.gyro_rad_s, np.tile([0.0, 0.0, 2.5], (n, 1)), atol=1e-12)
    np.testing.assert_allclose(
        recording.imu.accel_m_s2, np.tile([-(2.5**2) * radius, 0.0, 9.80665], (n, 1)), atol=1e-12
    )


def test_readings_integrate_to_the_motion() -> None:
    """Fails when a reading is taken half a sample early, or R is transposed in the specific force.

    Strapdown by the midpoint rule at 4 kHz, whose error over 3 s is about h^2 times a few units: below 1e-5.
    """
    scenario = replace(SCENARIOS["noise-free"], imu=replace(MTI_3, rate_hz=4000.0), duration_s=4.0)
    simulation = prepare(scenario)
    messages, truth = simulation.imu_messages, simulation.truth
    t_s = messages.true_ns * 1e-9
    used = np.flatnonzero((t_s > 0.9) & (t_s < 3.9))
    start, end = truth.imu(t_s[used[:1]]), truth.imu(t_s[used[-1:]])
    R, v, p = start.R_world[0], start.v_m_s[0], start.p_m[0]
    for i in used[:-1]:
        h = t_s[i + 1] - t_s[i]
        turn = Rotation.from_rotvec((messages.gyro_rad_s[i] + messages.gyro_rad_s[i + 1]) / 2.0 * h).as_matrix()
        force = (R @ messages.accel_m_s2[i] + R @ turn @ messages.accel_m_s2[i + 1]) / 2.0
        a = force - np.array([0.0, 0.0, 9.80665])
        R, p, v = R @ turn, p + h * v + h * h / 2.0 * a, v + h * a
    np.testing.assert_allclose(R, end.R_world[0], atol=1e-6)
    np.testing.assert_allclose(v, end.v_m_s[0], atol=1e-5)
    np.testing.assert_allclose(p, end.p_m[0], atol=1e-5)
    assert np.linalg.norm(p - start.p_m[0]) > 0.01


@pytest.mark.parametrize("offset_s", [0.15, -0.15, 0.0037])
def test_the_offset_added_to_a_stamp_gives_the_lidars_time(offset_s: float) -> None:
    """Fails when the offset is subtracted where it must be added.

    The lidar sees motion begin 1 s after its own zero; the stamps of the first moving IMU readings, plus the offset,
    must say the same.
    """
    scenario = replace(SCENARIOS["noise-free"], imu=replace(MTI_3, rate_hz=1000.0))
    recording, truth = generate(scenario, time_offset_s=offset_s, duration_s=1.6)
    moving = np.linalg.norm(recording.imu.gyro_rad_s, axis=1) > 0.0
    first = recording.imu.stamps_ns[np.argmax(moving)] + round(offset_s * 1e9)
    assert 0 < first - truth.epoch_ns - 1_000_000_000 < 2_000_000
    assert truth.to_file().time_offset_s == pytest.approx(offset_s)


def test_white_noise_has_the_densitys_level() -> None:
    """Fails when sigma is density / sqrt(rate), or deg/s are not made rad/s. Chi-square at 1e-4, two sides."""
    messages = prepare(STATIC, seed=11).imu_messages
    n = messages.true_ns.shape[0]
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], n - 1)
    up = SCENARIOS["static"].R_imu_lidar @ Pose((0.0, 35.0, -135.0)).R.T @ np.array([0.0, 0.0, 9.80665])
    gyro_sigma, accel_sigma = np.deg2rad(0.007) * 10.0, 120e-6 * 9.80665 * 10.0
    for values, sigma, mean in (
        (messages.gyro_rad_s, gyro_sigma, np.zeros(3)),
        (messages.accel_m_s2, accel_sigma, up),
    ):
        sums = ((values - values.mean(axis=0)) ** 2).sum(axis=0) / sigma**2
        assert ((sums > low) & (sums < high)).all()
        assert (np.abs(values.mean(axis=0) - mean) < 4.5 * sigma / np.sqrt(n)).all()
        neighbours = (values[1:] - mean) * (values[:-1] - mean)
        assert (np.abs(neighbours.mean(axis=0)) < 4.5 * sigma**2 / np.sqrt(n)).all()


def test_biases_are_added_and_walk_with_the_root_of_time() -> None:
    """Fails when the walk's steps are not scaled by 1 / sqrt(rate), or the truth tells another bias."""
    walk = 2e-3
    still = replace(
        STATIC,
        imu=replace(MTI_3, gyroscope_random_walk=walk, gyroscope_noise_density_rad_s_sqrt_hz=0.0),
        gyro_bias_rad_s=(0.1, -0.2, 0.3),
        duration_s=5.0,
    )
    ends = []
    for seed in range(25):
        simulation = prepare(still, seed=seed)
        readings = simulation.imu_messages.gyro_rad_s
        np.testing.assert_allclose(readings[0], [0.1, -0.2, 0.3], atol=1e-12)
        ends.append(readings[-1] - readings[0])
        np.testing.assert_allclose(simulation.truth.gyro_bias_rad_s, readings.mean(axis=0), atol=1e-12)
    total = float((np.array(ends) ** 2).sum()) / (walk**2 * 5.39)
    assert stats.chi2.ppf(1e-4, 75) < total < stats.chi2.ppf(1 - 1e-4, 75)


def test_an_imu_in_g_reads_one_at_rest_and_is_given_in_metres() -> None:
    """Fails when the published unit is m/s2, or the recording in memory keeps g."""
    scenario = replace(SCENARIOS["livox"], noise=False, accel_bias_m_s2=(0.0, 0.0, 0.0))
    simulation = prepare(scenario, duration_s=1.0)
    np.testing.assert_allclose(np.linalg.norm(simulation.imu_records.accel[:50], axis=1), 1.0, atol=1e-12)
    recording, _ = generate(scenario, duration_s=1.0)
    np.testing.assert_allclose(np.linalg.norm(recording.imu.accel_m_s2[:50], axis=1), 9.80665, atol=1e-11)


def test_faults_do_what_they_are_called() -> None:
    """Fails when a gap keeps a message, when duplicates are dropped before they are sent, or nothing is swapped."""
    faults = ImuFaults(gaps_s=((5.0, 0.5),), missing=0.01, duplicated=0.02, swapped=0.03, jitter_s=0.001)
    clean = prepare(replace(STATIC, imu_faults=ImuFaults()), seed=4).imu_messages
    bad = prepare(replace(STATIC, imu_faults=faults), seed=4).imu_messages
    t_s = bad.true_ns * 1e-9
    assert not ((t_s >= 5.0) & (t_s < 5.5)).any()
    kept, counts = np.unique(bad.true_ns, return_counts=True)
    n = clean.true_ns.shape[0]
    assert 10 < n - 50 - kept.shape[0] < 60
    assert 30 < (counts == 2).sum() < 100
    assert 45 < (np.diff(bad.true_ns) < 0).sum() < 140
    jitter = bad.stamp_error_ns * 1e-9
    assert np.abs(jitter).max() <= 1e-3
    assert jitter.std() == pytest.approx(1e-3 / np.sqrt(3.0), rel=0.03)
    assert np.isin(bad.true_ns, clean.true_ns).all()
    where = np.searchsorted(clean.true_ns, bad.true_ns)
    np.testing.assert_array_equal(bad.gyro_rad_s, clean.gyro_rad_s[where])
    recording, _ = generate(replace(STATIC, imu_faults=faults, duration_s=3.0), seed=4)
    assert (np.diff(recording.imu.stamps_ns) > 0).all()


def test_samples_fall_between_scans() -> None:
    """Fails when the first sample's phase is 0: a simulation whose clocks tick together hides interpolation errors."""
    recording, truth = generate("paper-normal", duration_s=2.0)
    imu_ns = recording.imu.stamps_ns + truth.time_offset_ns
    starts = np.array([scan.stamp_ns for scan in recording.scans])
    assert np.abs(imu_ns[:, None] - starts[None, :]).min() > 50_000
    assert imu_ns[0] < starts[0] - 100_000_000
    assert imu_ns[-1] > recording.scans[-1].stamp_ns + 200_000_000


def test_a_scenario_of_ones_own() -> None:
    """Fails when `generate` takes names only, or forgets a given mounting."""
    mine = Scenario(
        slug="mine",
        title="Mine",
        text="A test's own.",
        scene=SCENARIOS["attic"].scene,
        motion=Sway(Pose((0.0, 10.0, 20.0), (2.5, 2.5, 1.2))),
        mounting=mounting_from((0.1, 0.2, 0.3), angle_deg=120.0, axis=(1.0, 1.0, 1.0)),
        duration_s=1.0,
    )
    recording, truth = generate(mine)
    assert recording.scans_total == 10
    np.testing.assert_allclose(truth.R_imu_lidar, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_array_equal(truth.p_imu_lidar, [0.1, 0.2, 0.3])
