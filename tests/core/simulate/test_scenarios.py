"""The table of scenarios: that each can be made, says what it is, and refuses the impossible in one sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core.errors import Cancelled, SettingsError, UnsweepError
from calib_core.simulate import SCENARIOS, Mounting, generate, prepare
from calib_core.simulate.scenario import checked_mounting
from calib_core.simulate.scenarios import named

#: The estimator's issue names these.
ASKED_FOR = (
    "paper-normal paper-fast noise-free noise-free-fast handheld walking-person outliers partial-views outdoor attic "
    "ouster livox vehicle one-axis one-axis-in-place no-rotation static no-static-start imu-faults"
).split()


def test_every_scenario_that_was_asked_for_is_there() -> None:
    """Fails when a slug is misspelt or its entry's slug differs from its key."""
    assert set(ASKED_FOR) <= set(SCENARIOS)
    for slug, scenario in SCENARIOS.items():
        assert scenario.slug == slug
        assert scenario.text.endswith(".")


@pytest.mark.parametrize("slug", SCENARIOS)
def test_every_scenario_can_be_made(slug: str) -> None:
    """Fails when a scan is empty at the start, leaves its sweep, or a sensor starts inside a wall."""
    recording, truth = generate(slug, duration_s=0.5)
    assert recording.scans_total == len(recording.scans) == 5
    for index, scan in enumerate(recording.scans):
        offset = scan.points["offset_ns"]
        assert scan.index == index
        assert scan.points.shape[0] > 2_000
        assert np.isfinite(scan.points["xyz"]).all()
        assert offset.min() == 0
        assert offset.max() < 102_000_000
    assert truth.map_time_ns == recording.scans[0].stamp_ns
    inside = truth.lidar(np.linspace(0.0, SCENARIOS[slug].duration_s, 2_000)).p_m
    for face in truth.scenario.scene.faces:
        assert (inside @ face.unit_normal + face.offset_m > 0.3).all()
    assert abs(np.linalg.det(truth.R_imu_lidar) - 1.0) < 1e-12


def test_a_longer_recording_begins_like_a_shorter_one() -> None:
    """Fails when one generator runs through all sweeps."""
    short, _ = generate("paper-normal", seed=3, duration_s=0.5)
    long, _ = generate("paper-normal", seed=3, duration_s=0.9)
    for a, b in zip(short.scans, long.scans, strict=False):
        np.testing.assert_array_equal(a.points, b.points)


def test_clocks_of_different_epochs_are_told_apart_by_receive_times() -> None:
    """Fails when the coarse offset's sign is wrong: added to IMU stamps it gives the lidar's clock within a sweep."""
    recording, truth = generate("paper-normal", time_offset_s=1.5e9 + 0.0125, duration_s=0.6)
    assert abs(truth.time_offset_ns - 1_500_000_000_012_500_000) < 240
    assert abs(recording.coarse_offset_ns - truth.time_offset_ns) < 150_000_000
    assert recording.coarse_offset_ns != 0
    same, _ = generate("paper-normal", time_offset_s=5.0, duration_s=0.6)
    assert same.coarse_offset_ns == 0


def test_the_undetermined_is_undetermined() -> None:
    """Fails when one-axis also turns about a second axis, or one-axis-in-place moves anything but its own lever.

    A lever arm along the axis a adds R_wb a s to the IMU's position: constant if and only if R_wb a is.
    """
    t = np.linspace(0.0, 20.0, 500)
    for slug in ("one-axis", "one-axis-in-place"):
        truth = prepare(slug).truth
        rates = truth.lidar(t).omega_rad_s
        _, s, axes = np.linalg.svd(rates)
        assert s[0] > 1.0
        assert s[1] < 1e-12
        fixed = truth.lidar(t).R_world @ axes[0]
        assert np.ptp(fixed, axis=0).max() < 1e-12
    rig = SCENARIOS["one-axis-in-place"].motion.kinematics(t)
    assert not rig.v_m_s.any()
    assert not prepare("no-rotation").truth.imu(t).omega_rad_s.any()
    assert not prepare("static").truth.imu(t).a_m_s2.any()
    assert np.linalg.norm(prepare("no-static-start").truth.imu(np.zeros(1)).omega_rad_s) > 0.1


def test_a_vehicle_stays_level_on_its_plane() -> None:
    """Fails when pitch or roll exceed 0.15 degrees, or the wheels leave the ground."""
    t = np.linspace(0.0, 60.0, 5_000)
    rig = SCENARIOS["vehicle"].motion.kinematics(t)
    assert np.ptp(rig.p_m[:, 2]) < 1e-12
    up = rig.R_world[:, 2, :]
    assert np.rad2deg(np.abs(np.arcsin(up[:, :2]))).max() <= 0.1501
    assert np.rad2deg(np.abs(np.arcsin(up[:, :2]))).max() > 0.14
    forward = np.einsum("nji,nj->ni", rig.R_world, rig.v_m_s)
    assert np.abs(forward[:, 1]).max() < 0.01


def test_an_unknown_scenario_lists_the_names() -> None:
    """Fails when a KeyError gets out, or the sentence leaves a name out."""
    with pytest.raises(SettingsError) as caught:
        generate("paper-nromal")
    assert "'paper-nromal'" in str(caught.value)
    assert all(slug in str(caught.value) for slug in SCENARIOS)
    assert "\n" not in str(caught.value)


def test_impossible_wishes_are_refused_in_a_sentence() -> None:
    """Fails when a quaternion of zeros, a negative seed or an endless duration is taken."""
    zero: Mounting = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(SettingsError, match="quaternion"):
        prepare("static", mounting=zero)
    with pytest.raises(SettingsError, match="seed"):
        prepare("static", seed=-1)
    for bad in (0.0, -3.0, float("nan"), 1e9):
        with pytest.raises(SettingsError, match="duration"):
            prepare("static", duration_s=bad)
    for bad in (float("inf"), 3e9):
        with pytest.raises(SettingsError, match="time offset"):
            prepare("static", time_offset_s=bad)
    assert np.linalg.norm(checked_mounting((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.001))[3:]) == pytest.approx(1.0, abs=1e-15)


def test_cancelling_is_an_error_of_our_own() -> None:
    """Fails when a cancelled generation returns half a recording."""
    with pytest.raises(Cancelled) as caught:
        generate("static", duration_s=0.5, should_cancel=lambda: True)
    assert isinstance(caught.value, UnsweepError)


def test_no_noise_means_none_of_either_sensor() -> None:
    """Fails when `noise=False` silences one sensor only, or changes the motion."""
    walk = replace(SCENARIOS["partial-views"], gyro_bias_rad_s=(0.0, 0.0, 0.0), accel_bias_m_s2=(0.0, 0.0, 0.0))
    one, truth = generate(walk, seed=1, duration_s=0.6, noise=False)
    other, _ = generate(walk, seed=2, duration_s=0.6, noise=False)
    np.testing.assert_array_equal(one.scans[3].points, other.scans[3].points)
    np.testing.assert_array_equal(one.imu.gyro_rad_s, other.imu.gyro_rad_s)
    exact = truth.imu(truth.seconds(one.imu.stamps_ns + truth.time_offset_ns))
    np.testing.assert_allclose(one.imu.gyro_rad_s, exact.omega_rad_s, atol=1e-9)
    noisy, _ = generate(walk, seed=2, duration_s=0.6)
    assert (noisy.imu.gyro_rad_s != other.imu.gyro_rad_s).any()


def test_a_scenario_behind_another_lidar() -> None:
    """The README's tables name such, which the command line did not know. Mutations: the lidar left as it was; its name dropped,
    by which the noise is drawn; an unknown lidar taken for the scenario's own."""
    behind, own = named("handheld+xt32"), SCENARIOS["handheld"]
    assert (behind.lidar.frame_id, behind.imu, behind.slug) == ("PandarXT-32", own.imu, "handheld+xt32")
    assert named("handheld") is own
    recording, _ = generate("handheld+os1", duration_s=0.5)
    assert recording.name == "handheld+os1"
    for wrong in ("handheld+vlp", "hand+os1", "handheld+"):
        with pytest.raises(SettingsError, match=r"choose one of .*handheld.* with \+vlp16, \+xt32"):
            named(wrong)
