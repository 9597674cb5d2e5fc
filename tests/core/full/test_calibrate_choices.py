"""Choices of a calibration obeyed: what is given is used as given, and what cannot be known is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import chi2

from calib_core.calibrate import calibrate
from calib_core.result import CalibrationResult
from calib_core.settings import CalibrateSettings, Gravity, ImuNoise, Prior
from calib_core.simulate import Scenario, Truth, generate
from calib_core.simulate.motions import ONE_AXIS_IN_PLACE
from calib_core.types import InitialGuess, Recording
from tests.core.full.answers import errors_of


def _used_as_given(
    recording: Recording, truth: Truth, settings: CalibrateSettings, *, offset_within_s: float, normals_within: float
) -> CalibrationResult:
    """The result, with the true planes and the truth for a guess: gravity, the prior of tz and the cap of points are kept to."""
    guess = InitialGuess(truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns)
    result = calibrate(recording, settings, planes=truth.planes, initial_guess=guess).result
    errors = errors_of(result, truth)
    assert abs(errors[6]) < offset_within_s
    assert result.gravity_m_s2 == pytest.approx(9.80665, abs=1e-5)
    assert result.uncertainty is not None
    assert (np.degrees(np.abs(errors[:3])) < 4.0 * np.array(result.uncertainty.rotation_std_deg)).all()
    assert max(result.uncertainty.rotation_std_deg) < 0.1
    assert np.abs(errors[3:5]).max() < 0.02
    # The data alone leave more than a millimetre open: so near to the prior it comes by the prior only.
    assert errors[5] == pytest.approx(2e-4, abs=2e-5)
    for found, given in zip(result.quality.planes, truth.planes, strict=True):
        assert found.points <= 150 * len(recording.scans)
        np.testing.assert_allclose(found.normal, given.normal, atol=normals_within)
    assert result.quality.points_used > 10_000
    assert result.provenance.settings["points_per_plane_per_scan"] == 150
    return result


def test_given_planes_guess_and_offset_are_used_as_given(noisy: tuple[Recording, Truth]) -> None:
    """Fails when `estimate_time_offset` or `estimate_planes` is not obeyed, or a cap of points is a cap for the scan."""
    recording, truth = noisy
    settings = CalibrateSettings(
        estimate_time_offset=False,
        estimate_planes=False,
        intrinsics="off",
        crispness=False,
        points_per_plane_per_scan=150,
        field_of_view_deg=60.0,
        gravity=Gravity(magnitude_m_s2=9.80665, std_m_s2=0.0),
        imu_noise=ImuNoise(gyroscope_noise_density_rad_s_sqrt_hz=2e-4, accelerometer_noise_density_m_s2_sqrt_hz=2e-3),
        bias_model="constant",
        priors=(Prior(axis="tz", value=float(truth.p_imu_lidar[2]) + 2e-4, std=1e-6),),
    )
    result = _used_as_given(recording, truth, settings, offset_within_s=1e-8, normals_within=3e-3)
    assert result.uncertainty is not None
    # A solve that ended in damped steps once stated a third of what so few points tell.
    assert min(result.uncertainty.rotation_std_deg) > 0.03


def test_what_sensors_alone_leave_weak_is_no_matter_of_the_motion(short: Scenario) -> None:
    """A rig that turned by 15 deg/s about all axes was asked to turn about two, where the sensors were counted and not estimated.

    Oracle: the same readings, estimated, are calibrated. Mutations: turning advised all the same; what is considered left in for
    what is weak anyhow.
    """
    recording, _ = generate(replace(short, duration_s=8.0), seed=5)
    counted, estimated = (
        calibrate(recording, CalibrateSettings(intrinsics=mode, crispness=False)).result
        for mode in ("consider", "auto")
    )
    assert (counted.status, estimated.status) == ("weak", "calibrated")
    (advice,) = counted.observability.advice
    assert "weak only because of possible sensor errors" in advice
    assert "turn" not in advice
    assert not estimated.observability.advice


def test_turning_in_place_about_one_axis_is_weak_and_says_what_is_missing(short: Scenario) -> None:
    """Fails when an undetermined direction's standing prior passes for knowledge, or the open turn starts anywhere.

    Two directions are open: the lever arm along the axis, and the turn about it. That turn is where walls are plumb and the
    floor is level, which they are to a degree or two; across both directions the errors are those that are stated.
    """
    recording, truth = generate(replace(short, motion=ONE_AXIS_IN_PLACE, duration_s=8.0), seed=5)
    result = calibrate(recording, CalibrateSettings(crispness=False)).result
    assert result.status == "weak"
    assert ["does not determine" in d.text for d in result.observability.weak_directions] == [True, True]
    assert result.observability.advice
    assert result.T_imu_lidar is not None
    assert result.uncertainty is not None
    assert np.abs(result.T_imu_lidar.translation_m).max() < 0.5
    errors = errors_of(result, truth)
    assert np.degrees(np.linalg.norm(errors[:3])) < 5.0
    units = np.array([np.radians(1.0)] * 3 + [0.01] * 3 + [1e-3])
    open_directions = np.array([d.vector for d in result.observability.weak_directions])
    across = null_space(open_directions) / units[:, None]
    left = across.T @ errors
    covariance = across.T @ np.array(result.uncertainty.covariance) @ across
    assert left @ np.linalg.solve(covariance, left) < chi2.ppf(0.999, len(left))


def test_given_planes_priors_and_limits_are_used_as_given(noisy: tuple[Recording, Truth]) -> None:
    """Fails when a prior's value is taken for zero, or a cap is drawn from the whole scan."""
    recording, truth = noisy
    offset = Prior(axis="dt", value=truth.time_offset_s, std=1e-9)
    settings = CalibrateSettings(
        intrinsics="off",
        crispness=False,
        points_per_plane_per_scan=150,
        field_of_view_deg=60.0,
        gravity=Gravity(magnitude_m_s2=9.80665, std_m_s2=0.0),
        imu_noise=ImuNoise(gyroscope_noise_density_rad_s_sqrt_hz=2e-4, accelerometer_noise_density_m_s2_sqrt_hz=2e-3),
        bias_model="constant",
        priors=(Prior(axis="tz", value=float(truth.p_imu_lidar[2]) + 2e-4, std=1e-6), offset),
    )
    _used_as_given(recording, truth, settings, offset_within_s=1e-7, normals_within=5e-3)


def test_a_plane_is_the_same_either_way_round(noisy: tuple[Recording, Truth]) -> None:
    """Seen: walls of a file whose normals point outwards, on which no point lay, and not a word. Oracle: the others' answer.

    Mutations: as they were given; the normal turned round alone; the length left in.
    """
    recording, truth = noisy
    settings = CalibrateSettings(intrinsics="off", crispness=False)
    given = [replace(plane, suggested=False) for plane in truth.planes]
    turned = [
        replace(plane, normal=-1.001 * plane.normal, offset_m=-1.001 * plane.offset_m) if k % 2 else plane
        for k, plane in enumerate(given)
    ]
    one, other = (calibrate(recording, settings, planes=planes).result for planes in (given, turned))
    assert one.T_imu_lidar is not None
    assert other.T_imu_lidar is not None
    np.testing.assert_allclose(other.T_imu_lidar.matrix, one.T_imu_lidar.matrix, atol=1e-7)
    for mine, theirs in zip(other.quality.planes, one.quality.planes, strict=True):
        assert (mine.name, mine.points) == (theirs.name, theirs.points)
        np.testing.assert_allclose(mine.normal, theirs.normal, atol=1e-7)
