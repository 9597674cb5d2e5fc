"""Start values from exact two-sensor motion: any mounting, any lag, no guess."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.errors import Refused
from calib_core.events import ignore_event, never_cancel
from calib_core.full.initialise.agreement import mean_rate
from calib_core.full.initialise.initialise import initialise
from calib_core.full.initialise.linear import Steps, double_integral, linear_start, linear_steps
from calib_core.full.initialise.rotation import _fit_rotations, rotation_start
from calib_core.full.initialise.single_axis import _alike, turns_about, upright
from calib_core.full.initialise.start import LinearStart, RotationStart, Start
from calib_core.full.initialise.time_offset import GyroTurns, LidarTurns, candidate_lags, turns_of
from calib_core.full.prepare.prepare import prepare
from calib_core.geometry import exp, log
from calib_core.settings import CalibrateSettings
from calib_core.simulate import SCENARIOS, Mounting, Truth, generate
from calib_core.simulate.motion import Pose
from calib_core.simulate.motions import HINGE, ONE_AXIS, ONE_AXIS_IN_PLACE
from calib_core.types import FloatArray
from tests.core.full.initialise.perfect_tracks import (
    ACCEL_BIAS,
    GYRO_BIAS,
    SCENARIO,
    SWEEP_S,
    imu_readings,
    tracked_lidar,
    truth_of,
)
from tests.core.full.joint.conftest import true_motions


def _mounting(seed: int) -> Mounting:
    """A mounting over the whole of SO(3), a hand's breadth to half a metre away."""
    rng = np.random.default_rng(seed)
    x, y, z = (float(v) for v in 0.25 * rng.normal(size=3))
    qx, qy, qz, qw = (float(v) for v in Rotation.random(rng=rng).as_quat())
    return (x, y, z, qx, qy, qz, qw)


@pytest.mark.parametrize(("seed", "offset_s"), [(1, -0.073), (2, 1.87), (3, -12.4), (4, 143.21)])
def test_offset_and_rotation_of_any_mounting_at_any_lag(seed: int, offset_s: float) -> None:
    """Fails when the lag's sign is flipped, or R maps the IMU's rates to the lidar's (u and v of Kabsch exchanged).

    The IMU runs from 9 s before the lidar to 6 s after it. A mean rate over a sweep of 1.5 Hz motion is good to
    1 % of itself, and its time to a millisecond: the joint solve starts from a degree and 20 ms without trouble.
    """
    truth = truth_of(replace(SCENARIO, mounting=_mounting(seed)))
    track = tracked_lidar(truth, 10.0, 30.0)
    stamps, gyro, _ = imu_readings(truth, 1.0, 36.0, offset_s)
    start = rotation_start(track, stamps, gyro)[0]
    assert abs(start.time_offset_s - offset_s) < 2e-3
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ start.R_imu_lidar))) < 0.3
    np.testing.assert_allclose(start.gyro_bias, GYRO_BIAS, atol=3e-3)
    assert start.residual < 0.05
    assert start.correlation > 0.95
    assert start.open_axis_imu is None


def test_candidates_hold_the_true_lag_among_few_and_apart() -> None:
    """Fails when a found peak is not blanked out: six times the same lag."""
    truth = truth_of(SCENARIO)
    stamps, gyro, _ = imu_readings(truth, 0.0, 30.0, -4.3)
    lags = candidate_lags(turns_of(tracked_lidar(truth, 5.0, 25.0))[0], GyroTurns(stamps, gyro), stamps)
    values = np.array([lag for lag, _ in lags])
    assert abs(values[0] + 4.3) < 0.03
    assert np.diff(np.sort(values)).min() > 0.2
    correlations = [c for _, c in lags]
    assert correlations == sorted(correlations, reverse=True)


def test_sensors_that_share_no_time_have_no_start() -> None:
    """Fails when a fit is made from fewer than ten sweeps."""
    truth = truth_of(SCENARIO)
    stamps, gyro, _ = imu_readings(truth, 10.0, 10.6, 0.0)
    assert rotation_start(tracked_lidar(truth, 10.0, 30.0), stamps, gyro) == []


def test_lags_tried_at_once_are_as_each_by_itself() -> None:
    """Some at which the recordings share a part only, and one at which they share nothing. Twin: each with the turns that count.

    Mutations: the median over the turns that do not count, too; weights not scaled by how many count; lags out of order.
    """
    truth = truth_of(SCENARIO)
    turns = turns_of(tracked_lidar(truth, 10.0, 30.0))[1]
    stamps, gyro, _ = imu_readings(truth, 12.0, 26.0, 0.0)
    gyro_turns = GyroTurns(stamps, gyro)
    lags = np.array([-7.0, -0.1, 0.0, 0.01, 4.0, 40.0])
    together = _fit_rotations(turns, gyro_turns, lags, 0.9)
    assert together[5] is None
    for one, lag in zip(together[:5], lags, strict=False):
        use = np.isfinite(gyro_turns.over(turns.start_s - lag, turns.end_s - lag)[:, 0])
        counting = LidarTurns(turns.start_s[use], turns.end_s[use], turns.rate_rad_s[use])
        alone = _fit_rotations(counting, gyro_turns, lag[None], 0.9)[0]
        assert one is not None
        assert alone is not None
        assert one.time_offset_s == lag
        np.testing.assert_allclose(one.R_imu_lidar, alone.R_imu_lidar, atol=1e-12)
        np.testing.assert_allclose(one.gyro_bias, alone.gyro_bias, atol=1e-12)
        assert one.residual == pytest.approx(alone.residual, rel=1e-9)


def test_outlying_sweeps_do_not_turn_the_rotation() -> None:
    """Fails when Kabsch's two factors change places."""
    truth = truth_of(SCENARIO)
    track = tracked_lidar(truth, 5.0, 25.0)
    track.omega_rad_s[40:100:3] += [0.5, -0.7, 0.6]
    track.R[40:100:3] = track.R[40:100:3] @ exp(np.array([0.05, -0.07, 0.06]))
    stamps, gyro, _ = imu_readings(truth, 4.0, 26.0, 0.01)
    start = rotation_start(track, stamps, gyro)[0]
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ start.R_imu_lidar))) < 0.3


def test_turning_about_one_axis_leaves_the_turn_about_it_open() -> None:
    """Fails when the largest singular value is looked at instead of the second, or the axis is the lidar's.

    The axis of the simulated hinge, turned into the IMU; the rotation is right up to a turn about it.
    """
    truth = truth_of(replace(SCENARIOS["one-axis"], motion=ONE_AXIS))
    track = tracked_lidar(truth, 5.0, 25.0, noise=0.01)
    stamps, gyro, _ = imu_readings(truth, 4.0, 26.0, 0.02)
    start = rotation_start(track, stamps, gyro)[0]
    hinge = truth.R_imu_lidar @ (np.array(HINGE) / np.linalg.norm(HINGE))
    assert start.open_axis_imu is not None
    axis = start.open_axis_imu / np.linalg.norm(start.open_axis_imu)
    assert abs(axis @ hinge) > 0.9999
    np.testing.assert_allclose(start.R_imu_lidar @ truth.R_imu_lidar.T @ hinge, hinge, atol=0.02)
    turns = turns_about(axis, start.R_imu_lidar, 24)
    nearest = min(np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ R))) for R in turns)
    assert nearest < 8.0


def _trials(
    truth: Truth, noise: float, slid_m: FloatArray | None = None
) -> tuple[list[Start], Callable[[RotationStart], Steps]]:
    """What the accelerations say at 24 turns about the axis, and how they were asked. slid_m: (N, 3) that a track is off by."""
    track = tracked_lidar(truth, 5.0, 25.0, noise=noise)
    if slid_m is not None:
        track = replace(track, p=track.p + slid_m[: len(track.p)])
    stamps, gyro, accel = imu_readings(truth, 4.0, 26.0, 0.02)
    start = rotation_start(track, stamps, gyro)[0]
    assert start.open_axis_imu is not None

    def trial(rotation: RotationStart) -> Start:
        return Start(rotation, linear_start(track, stamps, accel, rotation, gravity_m_s2=9.807))

    def steps(rotation: RotationStart) -> Steps:
        return linear_steps(track, stamps, accel, rotation, gravity_m_s2=9.807)

    turns = turns_about(start.open_axis_imu, start.R_imu_lidar, 24)
    return [trial(replace(start, R_imu_lidar=R)) for R in turns], steps


def _seen(truth: Truth, *normals_world: tuple[float, float, float]) -> FloatArray:
    """Normals in the map frame."""
    R_world_map = truth.lidar(np.zeros(1)).R_world[0]
    return np.array([np.array(n) / np.linalg.norm(n) for n in normals_world]) @ R_world_map


FLOOR, WALLS, RAMP = (0.02, -0.01, 1.0), ((1.0, 0.03, 0.0), (0.02, -1.0, 0.03)), (0.3, 0.2, 0.9)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("normals", [(FLOOR, *WALLS), (RAMP, FLOOR, *WALLS), (*WALLS, RAMP)])
def test_an_open_turn_is_taken_where_planes_are_plumb_and_level(
    normals: tuple[tuple[float, float, float], ...], seed: int
) -> None:
    """Fails when the best fit is taken (up to 180 deg off), or a slope counts in full instead of as one at most.

    Turning in place about a hinge that is not upright; floor and walls a degree or two off.
    """
    scenario = SCENARIOS["one-axis-in-place"]
    truth = truth_of(replace(scenario, motion=ONE_AXIS_IN_PLACE, mounting=_mounting(seed)))
    trials, steps = _trials(truth, 0.002)
    chosen = upright(trials, _seen(truth, *normals), steps)
    off = np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ chosen.rotation.R_imu_lidar)))
    assert off < 4.0


@pytest.mark.parametrize("slid_m", [0.0, 0.8])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_in_a_box_that_is_as_plumb_a_quarter_of_a_turn_on_the_lidar_stands(seed: int, slid_m: float) -> None:
    """Nodding in place about a level axis along a wall; the track may be 0.8 m away wherever the lidar
    looks far down or up, as past what it follows.

    Seen: a wall was taken for the floor, 96 deg off. Mutations: the lowest of the slopes counts, leaning or not; gravity by the
    fit of all steps, which a track that slides turns.
    """
    nod = replace(ONE_AXIS_IN_PLACE.turns[0], axis=(0.0, 1.0, 0.0))
    motion = replace(ONE_AXIS_IN_PLACE, turns=(nod,), base=Pose(position_m=(1.2, 1.2, 0.9)))
    truth = truth_of(replace(SCENARIOS["one-axis-in-place"], motion=motion, mounting=_mounting(seed)))
    nodded = np.array([np.linalg.norm(log(R)) for R in tracked_lidar(truth, 5.0, 25.0).R])
    away = (nodded > np.quantile(nodded, 0.7))[:, None] * np.array([-0.6, 0.0, 0.8])
    trials, steps = _trials(truth, 0.002, slid_m * away)
    chosen = upright(trials, _seen(truth, FLOOR, *WALLS, (-0.02, 0.01, -1.0), (-1.0, 0.0, 0.02)), steps)
    off = np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ chosen.rotation.R_imu_lidar)))
    assert off < 5.0


def _steps_off(off_m: FloatArray) -> Steps:
    """Steps of which each is off by so much, seen whole."""
    n = len(off_m)
    shown = off_m[:, None] * np.array([0.6, 0.0, 0.8])
    nothing = LinearStart(np.zeros(3), np.zeros(3), np.zeros(3), 1.0)
    return Steps(nothing, np.arange(n), shown, np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)), np.zeros(3))


def test_a_turn_is_told_where_all_stretches_of_the_track_tell_it() -> None:
    """A fifth worse by the one stretch in which the track slid is no worse; a fifth worse all along is; a hundredth is not.

    Oracle: by construction. Mutations: the sums alone count, a twentieth at most; only stretches count.
    """
    rng = np.random.default_rng(3)
    off_m = np.abs(rng.normal(0.010, 0.003, 240))
    slid, all_along = off_m.copy(), off_m * 1.2
    slid[60:75] = 0.05
    told = [_steps_off(each) for each in (off_m, slid, all_along, off_m * 1.01)]
    assert _alike(told).tolist() == [True, True, False, True]


def test_a_lidar_that_stands_is_likelier_than_one_on_its_side_that_fits_better_by_chance() -> None:
    """Nodding in place, tried a quarter of a turn on from the truth, which fits a hundredth better there.

    Mutation: the best fit stays wherever it is as plumb.
    """
    nod = replace(ONE_AXIS_IN_PLACE.turns[0], axis=(0.0, 1.0, 0.0))
    motion = replace(ONE_AXIS_IN_PLACE, turns=(nod,), base=Pose(position_m=(1.2, 1.2, 0.9)))
    truth = truth_of(replace(SCENARIOS["one-axis-in-place"], motion=motion, mounting=_mounting(2)))
    trials, steps = _trials(truth, 0.0005)
    found = trials[0].rotation
    assert found.open_axis_imu is not None
    family = []
    for R in turns_about(found.open_axis_imu, truth.R_imu_lidar, 24):
        rotation = replace(found, R_imu_lidar=R)
        family.append(Start(rotation, steps(rotation).start))
    least = min(t.linear.rms for t in family)
    family[6] = replace(family[6], linear=replace(family[6].linear, rms=0.99 * least))
    chosen = upright(family, _seen(truth, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)), steps)
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ chosen.rotation.R_imu_lidar))) < 5.0


def test_a_turn_that_the_accelerations_tell_is_left_to_them() -> None:
    """Fails when trials count as alike that fit twice as badly: then it is the turn at which the ramp is level.

    Turning about one axis while moving along all three, before nothing but a ramp.
    """
    truth = truth_of(replace(SCENARIOS["one-axis"], motion=ONE_AXIS, mounting=_mounting(4)))
    trials, steps = _trials(truth, 0.002)
    chosen = upright(trials, _seen(truth, RAMP), steps)
    assert chosen is min(trials, key=lambda t: t.misfit)


def test_about_an_upright_axis_the_accelerations_keep_their_say() -> None:
    """Fails when the planes are asked although no turn about an upright axis makes any of them more level.

    A robot on a level floor that turns to and fro and shifts by a millimetre: little, but all there is.
    """
    upright_hinge = replace(ONE_AXIS_IN_PLACE.turns[0], axis=(0.0, 0.0, 1.0))
    level = Pose(position_m=(1.2, 1.2, 0.9))
    x, y, _ = (tuple(replace(wave, amplitude=0.008 * wave.amplitude) for wave in waves) for waves in ONE_AXIS.position)
    motion = replace(ONE_AXIS_IN_PLACE, turns=(upright_hinge,), base=level, position=(x, y, ()))
    truth = truth_of(replace(SCENARIOS["one-axis-in-place"], motion=motion))
    trials, steps = _trials(truth, 0.002)
    alike = [t for t in trials if t.misfit < 1.05 * min(t.misfit for t in trials)]
    assert len(alike) >= 3
    assert upright(trials, _seen(truth, FLOOR, *WALLS), steps) is min(trials, key=lambda t: t.misfit)


def test_the_turn_that_fits_best_stays_where_no_other_is_more_upright() -> None:
    """Fails when a turn is taken for the sake of a slope of a plane that is plumb and level nowhere on the way round."""
    truth = truth_of(replace(SCENARIOS["one-axis-in-place"], motion=ONE_AXIS_IN_PLACE, mounting=_mounting(1)))
    trials, steps = _trials(truth, 0.002)
    hinge = np.array(HINGE) / np.linalg.norm(HINGE)
    R_map_lidar = truth.map_lidar(np.zeros(1))[0][0]
    along = (R_map_lidar @ hinge)[None]
    best = min(trials, key=lambda t: t.misfit)
    assert (
        10.0 < np.degrees(np.arccos(abs(along[0] @ best.linear.gravity) / np.linalg.norm(best.linear.gravity))) < 80.0
    )
    assert upright(trials, along, steps) is best


def test_turns_go_once_round() -> None:
    """Fails when the turn is applied on the right: about the lidar's axis, not the IMU's."""
    R = Rotation.random(rng=np.random.default_rng(1)).as_matrix()
    axis = np.array([0.0, 0.0, 2.0])
    turns = turns_about(axis, R, 6)
    for k, turn in enumerate(turns):
        np.testing.assert_allclose(turn, Rotation.from_rotvec([0, 0, k * np.pi / 3]).as_matrix() @ R, atol=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gravity_lever_arm_and_bias_by_linear_least_squares(seed: int) -> None:
    """Fails when the lever arm's rows have the sign of R(m) - R(m+1).

    With the true rotation and offset. What is left: rates held constant over each sweep, a per cent of 0.5 Hz motion.
    """
    truth = truth_of(replace(SCENARIOS["paper-normal"], mounting=_mounting(seed)))
    track = tracked_lidar(truth, 2.5, 25.0)
    stamps, gyro, accel = imu_readings(truth, 1.0, 27.0, 0.013)
    found = rotation_start(track, stamps, gyro)[0]
    start = replace(found, time_offset_s=0.013, R_imu_lidar=truth.R_imu_lidar)
    linear = linear_start(track, stamps, accel, start, gravity_m_s2=9.807)
    gravity_map = truth.lidar(np.zeros(1)).R_world[0].T @ truth.gravity_world_m_s2
    angle = np.degrees(np.arccos(linear.gravity @ gravity_map / np.linalg.norm(linear.gravity) / 9.80665))
    assert angle < 0.5
    assert np.linalg.norm(linear.gravity) == pytest.approx(9.80665, abs=0.05)
    np.testing.assert_allclose(linear.p_imu_lidar, truth.p_imu_lidar, atol=0.03)
    np.testing.assert_allclose(linear.accel_bias, ACCEL_BIAS, atol=0.08)
    wrong = replace(start, R_imu_lidar=exp(np.array([0.0, 0.5, 0.0])) @ truth.R_imu_lidar)
    assert linear_start(track, stamps, accel, wrong, gravity_m_s2=9.807).rms > 3 * linear.rms


def test_steps_that_the_accelerometer_has_not_felt_are_found_and_do_not_count() -> None:
    """A track that slides by 0.6 m within four scans and stays there: gravity and lever arm are those of the others, and the
    steps felt are the true ones.

    Mutations: no passes of weights (the lever arm is 6 cm off and more); every step counts as sound; felt for shown.
    """
    truth = truth_of(SCENARIOS["paper-normal"])
    track = tracked_lidar(truth, 2.5, 25.0)
    stamps, gyro, accel = imu_readings(truth, 1.0, 27.0, 0.013)
    start = replace(rotation_start(track, stamps, gyro)[0], time_offset_s=0.013, R_imu_lidar=truth.R_imu_lidar)
    slid = np.clip((np.arange(len(track.start_s)) - 80) / 4.0, 0.0, 1.0)[:, None] * np.array([0.2, -0.3, 0.48])
    steps = linear_steps(replace(track, p=track.p + slid), stamps, accel, start, gravity_m_s2=9.807)
    np.testing.assert_array_equal(steps.step[steps.astray], [80, 81, 82, 83])
    np.testing.assert_allclose(steps.start.p_imu_lidar, truth.p_imu_lidar, atol=0.03)
    np.testing.assert_allclose(steps.felt_m, track.p[steps.step + 1] - track.p[steps.step], atol=0.02)
    sound = linear_steps(track, stamps, accel, start, gravity_m_s2=9.807)
    assert not sound.astray.any()
    np.testing.assert_array_equal(
        sound.start.p_imu_lidar, linear_start(track, stamps, accel, start, gravity_m_s2=9.807).p_imu_lidar
    )


def test_what_no_plane_tells_of_a_step_is_left_to_the_imu() -> None:
    """A track that strays along one way, which its scans do not tell: lever arm and bias are those of the other two, no step
    has gone astray, and the steps felt go along it as the lidar did, but for a start velocity and a pull that nobody knows.

    Mutations: the open way counts as seen, in the fit (the lever arm is 2 cm and more off) or in what is astray; felt as shown.
    """
    truth = truth_of(SCENARIOS["paper-normal"])
    track = tracked_lidar(truth, 2.5, 25.0)
    stamps, gyro, accel = imu_readings(truth, 1.0, 27.0, 0.013)
    start = replace(rotation_start(track, stamps, gyro)[0], time_offset_s=0.013, R_imu_lidar=truth.R_imu_lidar)
    along = np.array([0.8, -0.6, 0.0])
    unseen = np.outer(along, along)
    strays = np.cumsum(np.random.default_rng(6).normal(0.0, 0.2, len(track.p)))[:, None] * along
    every = np.tile(unseen, (len(track.p), 1, 1))
    steps = linear_steps(replace(track, p=track.p + strays, unseen=every), stamps, accel, start, gravity_m_s2=9.807)
    np.testing.assert_allclose(steps.start.p_imu_lidar, truth.p_imu_lidar, atol=0.03)
    np.testing.assert_allclose(steps.start.accel_bias, ACCEL_BIAS, atol=0.08)
    gravity_map = truth.lidar(np.zeros(1)).R_world[0].T @ truth.gravity_world_m_s2
    np.testing.assert_allclose(steps.start.gravity, gravity_map, atol=0.2)
    assert not steps.astray.any()
    wrong_m = steps.felt_m - np.diff(track.p, axis=0)[steps.step]
    t_s = track.start_s[steps.step]
    unknown = np.polynomial.Polynomial.fit(t_s, wrong_m @ along, 1)
    np.testing.assert_allclose(wrong_m @ along, unknown(t_s), atol=0.01)
    np.testing.assert_allclose(wrong_m @ (np.eye(3) - unseen), 0.0, atol=0.02)


def test_double_integrals_of_lines_and_parabolas() -> None:
    """Fails when the inner integral's weights are 1/4 and 1/4 instead of 1/3 and 1/6.

    Linear samples are integrated exactly between any marks; so is their integral.
    """
    t = np.sort(np.concatenate([[0.0, 4.0], np.random.default_rng(2).uniform(0.0, 4.0, 60)]))
    marks = np.array([0.2, 0.9, 1.0, 2.71, 3.9])
    V, P = double_integral(t, np.column_stack([np.ones_like(t), 2.0 * t - 1.0]), marks)
    a, b = marks[:-1], marks[1:]
    np.testing.assert_allclose(V, np.column_stack([b - a, (b**2 - a**2) - (b - a)]), atol=1e-12)
    slope_part = (b**3 - a**3) / 3 - a**2 * (b - a) - (b - a) ** 2 / 2
    np.testing.assert_allclose(P, np.column_stack([(b - a) ** 2 / 2, slope_part]), atol=1e-12)


def test_a_sweep_too_short_to_show_its_rate_leaves_the_turns_between_scans() -> None:
    """Fails when only the turns within sweeps are looked at: the rotation is then 20 deg off, the offset 30 ms.

    What a narrow view makes of the paper's motion: half a radian a second of noise within the sweep, half a degree on
    the poses.
    """
    truth = truth_of(SCENARIOS["paper-normal"])
    rng = np.random.default_rng(5)
    track = tracked_lidar(truth, 0.0, 5.0, noise=0.5)
    track = replace(track, R=track.R @ exp(np.radians(0.3) * rng.normal(size=(len(track.R), 3))))
    stamps, gyro, _ = imu_readings(truth, -1.0, 7.0, 0.004)
    start = rotation_start(track, stamps, gyro)[0]
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ start.R_imu_lidar))) < 3.0
    assert abs(start.time_offset_s - 0.004) < 6e-3


def test_gyro_turns_are_the_products_of_scipys_rotations_and_nothing_beyond_the_recording() -> None:
    """Fails when a span that leaves the recording is cut short instead of refused, or the running product is reversed.

    Two turns about fixed axes, one after the other: their product is known in closed form.
    """
    t = np.linspace(0.0, 2.0, 401)
    rate = np.where(t[:, None] < 1.0, [0.0, 0.0, 0.8], [0.6, 0.0, 0.0])
    start, end = np.array([0.1, 0.5, 1.95, -0.1]), np.array([0.4, 1.7, 2.05, 0.3])
    both = Rotation.from_rotvec([0.0, 0.0, 0.4]) * Rotation.from_rotvec([0.42, 0.0, 0.0])
    expected = np.array([[0.0, 0.0, 0.8], both.as_rotvec() / 1.2, [np.nan] * 3, [np.nan] * 3])
    np.testing.assert_allclose(GyroTurns(t, rate).over(start, end), expected, atol=3e-3)


def test_nothing_is_told_of_what_an_imu_was_silent_over() -> None:
    """Half a second without readings of a motion to and fro: a line from the last reading to the next one is off by 20 deg and
    half a metre a second. The steps of an exact track that are told are all felt, and none of them lies across the silence.

    Mutations: turns over a silence told; steps over one; a mean rate over one.
    """
    truth = truth_of(SCENARIO)
    track = tracked_lidar(truth, 5.0, 25.0)
    stamps, gyro, accel = imu_readings(truth, 1.0, 30.0, 0.0)
    kept = (stamps < 15.02) | (stamps > 15.53)
    stamps, gyro, accel = stamps[kept], gyro[kept] - GYRO_BIAS, accel[kept]
    across = (track.start_s + SWEEP_S > 15.02) & (track.start_s < 15.53)
    turns = GyroTurns(stamps, gyro).over(track.start_s, track.start_s + SWEEP_S)
    np.testing.assert_array_equal(np.isnan(turns[:, 0]), across)
    rates = mean_rate(stamps, gyro, track.start_s, track.start_s + SWEEP_S)
    np.testing.assert_array_equal(np.isnan(rates), across)
    rotation = RotationStart(0.0, truth.R_imu_lidar, np.zeros(3), 0.0, 1.0, None)
    steps = linear_steps(track, stamps, accel, rotation, gravity_m_s2=truth.scenario.gravity_m_s2)
    np.testing.assert_array_equal(steps.step, 1 + np.flatnonzero(~across[1:-1]))
    assert steps.off_m.max() < 0.02


def test_a_track_between_its_scans_runs_on_at_constant_rates() -> None:
    """Fails when the position is held from one scan to the next."""
    truth = truth_of(SCENARIOS["paper-normal"])
    track = tracked_lidar(truth, 5.0, 8.0)
    R, p = track.at(np.array([5.04, 7.95]))
    R_true, p_true = truth.map_lidar(np.array([5.04, 7.95]))
    np.testing.assert_allclose(R, R_true, atol=2e-3)
    np.testing.assert_allclose(p, p_true, atol=1e-3)


@pytest.mark.parametrize(("scenario", "asked"), [("no-rotation", False), ("paper-normal", True)])
def test_sweeps_are_held_against_turns_that_the_gyroscope_has_felt(
    scenario: str, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen: a rig that was shifted about, whose track turned by errors, refused for clouds whose motion was taken out.

    Mutation: asked in any case.
    """
    recording, truth = generate(SCENARIOS[scenario], seed=11, duration_s=8.0)
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    motions = true_motions(truth, run.clocks.lidar_epoch_ns, run.clocks.scan_s)
    calls = []
    monkeypatch.setattr(
        "calib_core.full.initialise.initialise.require_measured_sweeps", lambda *_: calls.append("asked")
    )
    initialise(run, motions, truth.planes, None)
    assert calls == ["asked"] * asked


def test_where_only_noise_turns_the_rotation_comes_from_the_accelerations() -> None:
    """A rig shifted about without a turn; the rates within sweeps, that of a tenth of a second's points, turn by 0.05 rad/s.

    Oracle: simulated truth. Mutation: ask the lidar's rates alone whether it turns: the rotation is 140 deg off, the offset
    seconds.
    """
    recording, truth = generate(SCENARIOS["no-rotation"], seed=11, duration_s=12.0)
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    clocks, rng = run.clocks, np.random.default_rng(0)
    motions = [
        replace(motion, omega_rad_s=motion.omega_rad_s + 0.03 * rng.normal(size=3))
        for motion in true_motions(truth, clocks.lidar_epoch_ns, clocks.scan_s)
    ]
    _, start = initialise(run, motions, truth.planes, None)
    assert np.degrees(np.linalg.norm(log(truth.R_imu_lidar.T @ start.rotation.R_imu_lidar))) < 3.0
    assert abs(clocks.offset_ns(start.rotation.time_offset_s) - truth.time_offset_ns) < 2e7


@pytest.mark.parametrize(
    ("followed", "end", "code", "said"),
    [
        (8, 80, "planes.lost", "could be followed over only 8 of 80 scans"),
        (70, 80, "start.no_overlap", "overlap too little .* of different times; see"),
        (
            12,
            12,
            "start.no_overlap",
            "^1.1 s of scans, from 14.0 s of the recording on, are too few .* take more of it",
        ),
    ],
)
def test_a_lidar_that_was_soon_lost_is_refused_as_that(
    monkeypatch: pytest.MonkeyPatch, followed: int, end: int, code: str, said: str
) -> None:
    """No start at all is found. Seen: 8 scans of 299 in a corridor, and stamps of another time were told for the reason; so they
    were of what somebody had cut to its last second.

    Mutations: one reason for all; stamps in any case.
    """
    recording, truth = generate(SCENARIOS["no-rotation"], seed=11, duration_s=8.0)
    skipped_s = 0.0 if end == len(recording.scans) else 14.0
    recording = replace(recording, scans=recording.scans[:end], skipped_s=skipped_s)
    run = prepare(recording, CalibrateSettings(), ignore_event, never_cancel)
    motions = true_motions(truth, run.clocks.lidar_epoch_ns, run.clocks.scan_s)[:followed]
    begin = "calib_core.full.initialise.initialise."
    monkeypatch.setattr(begin + "rotation_start", lambda *_: [])
    monkeypatch.setattr(begin + "acceleration_start", lambda *_: [])
    with pytest.raises(Refused, match=said) as refused:
        initialise(run, motions, truth.planes, None)
    assert refused.value.code == code
