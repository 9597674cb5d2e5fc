"""A guess replaces what was found, unless both sensors' turning refutes it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.errors import Refused
from calib_core.full.initialise.initial_guess import HELD_REFUTED, start_from_guess, with_lever_arm
from calib_core.full.initialise.linear import linear_steps
from calib_core.full.initialise.rotation import best_turns, left_by, rotation_start
from calib_core.full.initialise.start import LidarTrack, RotationStart
from calib_core.settings import CalibrateSettings, Prior
from calib_core.simulate import SCENARIOS, Truth
from calib_core.simulate.motions import ONE_AXIS, PAPER_FAST
from calib_core.types import FloatArray, InitialGuess
from tests.core.full.initialise.perfect_tracks import SCENARIO, imu_readings, tracked_lidar, truth_of

OFFSET_S = 0.31


def _world(*, one_axis: bool = False) -> tuple[Truth, LidarTrack, FloatArray, FloatArray]:
    truth = truth_of(replace(SCENARIO, motion=ONE_AXIS if one_axis else PAPER_FAST))
    stamps, gyro, _ = imu_readings(truth, 5.0, 35.0, OFFSET_S)
    return truth, tracked_lidar(truth, 10.0, 30.0, noise=0.01), stamps, gyro


def _begun(
    guess: InitialGuess,
    *,
    one_axis: bool = False,
    held: bool = False,
    priors: tuple[Prior, ...] = (),
    R_gyro: FloatArray = np.eye(3),  # noqa: B008
):
    """The start, whether its rotation is the guess's, what was said, and the truth.   R_gyro: of the gyroscope's axes."""
    truth, track, stamps, gyro = _world(one_axis=one_axis)
    gyro = gyro @ R_gyro
    said: list[str] = []
    run = SimpleNamespace(
        clocks=SimpleNamespace(imu_s=stamps, offset_s=lambda ns: ns * 1e-9),
        recording=SimpleNamespace(imu=SimpleNamespace(gyro_rad_s=gyro)),
        settings=CalibrateSettings(estimate_time_offset=not held, priors=priors),
        say=lambda level, code, text: said.append(f"{level} {code} {text}"),
    )
    start, as_guessed = start_from_guess(run, track, rotation_start(track, stamps, gyro), guess)  # type: ignore[arg-type]
    return start, as_guessed, said, truth


def test_what_a_rotation_leaves() -> None:
    """Oracle: a vector that is turned by an angle is off by twice the sine of its half, across the axis; across all axes that is
    the root of two thirds of it. Mutations: the rotation applied the other way round; the bias left in; leaps counted.
    """
    truth, track, stamps, gyro = _world()
    turns, readings, _ = best_turns(track, stamps, gyro + np.array([0.3, 0.0, 0.0]))
    rate = turns.rate_rad_s.copy()
    rate[::17] += 3.0  # as where a track leapt
    turns = replace(turns, rate_rad_s=rate)
    turned = [truth.R_imu_lidar]
    for axis in np.eye(3):
        turned += [truth.R_imu_lidar @ Rotation.from_rotvec(0.5 * axis).as_matrix()]
    own, *others = left_by(turns, readings, OFFSET_S, np.stack(turned))
    assert own < 0.06
    assert np.sqrt(np.mean(np.square(others))) == pytest.approx(2.0 * np.sin(0.25) * np.sqrt(2.0 / 3.0), rel=0.1)


@pytest.mark.parametrize(
    ("off_deg", "refuted"), [((0, 3, 4), False), ((180, 0, 0), True), ((0, 0, 90), True), ((20, 0, 20), True)]
)
def test_a_rotation_that_the_turning_refutes(off_deg: tuple[float, ...], refuted: bool) -> None:
    """Mutations: never refuted; always; the guess's begun with all the same; compared with its own inverse."""
    turn = Rotation.from_rotvec(off_deg, degrees=True)
    wrong = truth_of(SCENARIO).R_imu_lidar @ turn.as_matrix()
    start, as_guessed, said, truth = _begun(InitialGuess(wrong, None, None))
    assert as_guessed is not refuted
    begun_deg = np.degrees(Rotation.from_matrix(truth.R_imu_lidar.T @ start.R_imu_lidar).magnitude())
    assert begun_deg == pytest.approx(0.0 if refuted else np.linalg.norm(off_deg), abs=0.3)
    assert len(said) == refuted
    for text in said:
        assert text.startswith("warning start.guess_refuted ")
        assert float(text.split("initial guess is ")[1].split(" deg")[0]) == pytest.approx(
            float(np.linalg.norm(off_deg)), abs=0.5
        )
        assert "its inverse" not in text


HELD = tuple(Prior(axis=axis, value=0.0, std=1e-6) for axis in ("rx", "ry", "rz"))


@pytest.mark.parametrize(
    ("off_deg", "off_s", "one_axis", "refuted"),
    [
        ((0, 0, 0), 0.0, False, None),
        ((0, 3, 4), 0.04, False, None),
        ((20, 0, 20), 0.0, False, "turned by 28.3 deg$"),
        ((180, 0, 0), None, False, "turned by 180 deg$"),
        ((0, 0, 0), -0.7, False, r"turned by 0\.\d+ deg and off by -0.7 s$"),
        ((0, 0, 0), 0.0, True, None),
        ((90, 90, 0), 0.0, True, "rotation and time offset$"),
    ],
)
def test_a_calibration_that_is_held_is_refused_where_the_turning_refutes_it(
    off_deg: tuple[float, ...], off_s: float | None, one_axis: bool, refuted: str | None
) -> None:
    """Another rig's calibration took a motion out that never was. Where a guess is no more than a start, nothing is refused.

    Mutations: begun with the own rotation and said (a guess); asked at the own time offset; an open turn told; priors not asked.
    """
    scenario = replace(SCENARIO, motion=ONE_AXIS) if one_axis else SCENARIO
    turn = Rotation.from_rotvec(off_deg, degrees=True)
    R = truth_of(scenario).R_imu_lidar @ turn.as_matrix()
    guess = InitialGuess(R, None, None if off_s is None else round((OFFSET_S + off_s) * 1e9))
    if refuted is None:
        _, as_guessed, said, _ = _begun(guess, one_axis=one_axis, priors=HELD)
        assert (as_guessed, said) == (True, [])
        return
    with pytest.raises(Refused, match=refuted) as refusal:
        _begun(guess, one_axis=one_axis, priors=HELD)
    assert refusal.value.code == HELD_REFUTED
    loose = (*HELD[:2], Prior(axis="rz", value=0.0, std=0.3))
    for priors in ((), HELD[:2], loose):
        assert len(_begun(guess, one_axis=one_axis, priors=priors)[2]) == (not one_axis)


@pytest.mark.parametrize("seed", range(6))
def test_a_right_calibration_is_never_refused_for_its_gyroscope_s_axes(seed: int) -> None:
    """They may be some degrees off those of the accelerometer, which the calibration is of: three sigmas of the widest prior,
    any way. Mutation: anything beyond twice the own rotation's refuted (without a share of all turning).
    """
    away = np.random.default_rng(seed).normal(size=3)
    R_gyro = Rotation.from_rotvec(0.03 * away / np.linalg.norm(away)).as_matrix()
    guess = InitialGuess(truth_of(SCENARIO).R_imu_lidar, None, round(OFFSET_S * 1e9))
    _, as_guessed, said, _ = _begun(guess, priors=HELD, R_gyro=R_gyro)
    assert (as_guessed, said) == (True, [])


def test_a_rotation_written_the_other_way_round_is_called_that() -> None:
    """Mutation: the inverse not asked."""
    truth = truth_of(replace(SCENARIO, mounting=(0.1, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5)))
    track = tracked_lidar(truth, 10.0, 30.0)
    stamps, gyro, _ = imu_readings(truth, 5.0, 35.0, OFFSET_S)
    said: list[str] = []
    run = SimpleNamespace(
        clocks=SimpleNamespace(imu_s=stamps),
        recording=SimpleNamespace(imu=SimpleNamespace(gyro_rad_s=gyro)),
        settings=CalibrateSettings(),
        say=lambda level, code, text: said.append(text),
    )
    guess = InitialGuess(truth.R_imu_lidar.T, None, None)
    found = rotation_start(track, stamps, gyro)
    _, as_guessed = start_from_guess(run, track, found, guess)  # type: ignore[arg-type]
    assert not as_guessed
    (text,) = said
    assert "its inverse fits, so it may be T_lidar_imu" in text


def test_what_the_turning_leaves_open_is_the_guess_s() -> None:
    """All turning about one axis: how the IMU is turned about it is for the guess to say. Nothing found: all of it is.

    Mutations: asked all the same; the turn about the axis left open.
    """
    wrong = SCENARIOS["paper-normal"]
    R = truth_of(wrong).R_imu_lidar @ Rotation.from_rotvec([0.0, 0.0, 70.0], degrees=True).as_matrix()
    start, as_guessed, said, _ = _begun(InitialGuess(R, None, None), one_axis=True)
    assert (as_guessed, said, start.open_axis_imu) == (True, [], None)
    np.testing.assert_array_equal(start.R_imu_lidar, R)
    truth, track, _, _ = _world()
    nothing, as_guessed = start_from_guess(SimpleNamespace(), track, [], InitialGuess(truth.R_imu_lidar, None, None))  # type: ignore[arg-type]
    assert as_guessed
    np.testing.assert_array_equal(nothing.R_imu_lidar, truth.R_imu_lidar)


@pytest.mark.parametrize(
    ("off_s", "held", "begun_off_s", "says"),
    [(0.02, False, 0.02, 0), (0.5, False, 0.0, 1), (-0.7, False, 0.0, 1), (0.5, True, 0.5, 0)],
)
def test_a_time_offset_at_which_nothing_turns_alike(off_s: float, held: bool, begun_off_s: float, says: int) -> None:
    """Mutations: begun with all the same; one that is held given up; the sign of how far it is off."""
    start, _, said, _ = _begun(InitialGuess(None, None, round((OFFSET_S + off_s) * 1e9)), held=held)
    assert start.time_offset_s == pytest.approx(OFFSET_S + begun_off_s, abs=3e-3)
    assert len(said) == says
    for text in said:
        assert f"is {abs(off_s):.3g} s {'above' if off_s > 0 else 'below'} the one" in text.replace(
            "0.501", "0.5"
        ).replace("0.499", "0.5").replace("0.699", "0.7").replace("0.701", "0.7")


@pytest.mark.parametrize(
    ("off_m", "one_axis", "prior", "refuted"),
    [
        ((0.02, 0.0, 0.02), False, False, False),
        ((0.0, 0.0, 2.0), False, False, True),
        ((1.0, 1.0, 0.0), False, True, False),
        ((0.0, 0.0, 2.0), True, False, False),
    ],
)
def test_a_lever_arm_that_both_motions_refute(
    off_m: tuple[float, ...], one_axis: bool, prior: bool, refuted: bool
) -> None:
    """Along an axis about which alone it turns nothing is told. Seen: 2 m off, the answer 2 sigmas elsewhere, with two tones.

    Mutations: never refuted; always; begun with all the same; what a prior holds put aside; not held while it is asked.
    """
    truth = truth_of(replace(SCENARIO, motion=ONE_AXIS if one_axis else PAPER_FAST))
    track = tracked_lidar(truth, 10.0, 30.0, noise=0.002)
    stamps, gyro, accel = imu_readings(truth, 5.0, 35.0, OFFSET_S)
    said: list[str] = []
    priors = (Prior(axis="tx", value=0.0, std=1.0),) if prior else ()
    run = SimpleNamespace(
        settings=CalibrateSettings(priors=priors), say=lambda _, code, text: said.append(f"{code} {text}")
    )
    rotation = RotationStart(OFFSET_S, truth.R_imu_lidar, np.zeros(3), 0.01, 1.0, None)
    axis = np.linalg.svd(gyro, full_matrices=False)[2][0]  # of most turning
    away_m = off_m[2] * axis if one_axis else np.array(off_m)
    given_m = truth.p_imu_lidar + away_m
    found, as_given = (
        linear_steps(track, stamps, accel, rotation, gravity_m_s2=9.81, lever_arm_m=each).start
        for each in (None, given_m)
    )
    np.testing.assert_allclose(as_given.p_imu_lidar, given_m, atol=1e-2)
    begun = with_lever_arm(run, found, as_given, given_m)  # type: ignore[arg-type]
    np.testing.assert_array_equal(begun.p_imu_lidar, found.p_imu_lidar if refuted else given_m)
    assert [
        text.startswith("start.guess_refuted the translation of the initial guess is 2 m from") for text in said
    ] == ([True] * refuted)
