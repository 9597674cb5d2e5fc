"""The whole method on simulated recordings; the simulator shares no formula with it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.errors import Cancelled, Refused
from calib_core.paper import ImuStates, PaperOptions, PaperSolution, calibrate_paper
from calib_core.paper.front_end import Selection, run_front_end
from calib_core.settings import CalibrateSettings, Gravity
from calib_core.simulate import SCENARIOS, generate
from calib_core.types import InitialGuess

#: The least that has all of the motion: a static second, the ramp, a few of the slowest sine's quarters.
DURATION_S = 7.0
SETTINGS = CalibrateSettings(method="paper", gravity=Gravity(magnitude_m_s2=9.80665))


#: Of the exact recording: none would agree with an answer of zero, too.
BIASED = replace(SCENARIOS["noise-free"], gyro_bias_rad_s=(0.004, -0.003, 0.002), accel_bias_m_s2=(0.02, -0.01, 0.03))


@pytest.fixture(scope="module")
def exact():
    return generate(BIASED, seed=1, duration_s=DURATION_S)


@pytest.fixture(scope="module")
def noisy():
    return generate("paper-fast", seed=2, duration_s=6.0)


@pytest.fixture(scope="module")
def solved(exact):
    return calibrate_paper(exact[0], SETTINGS)


def angle_deg(R, truth):
    return np.degrees(Rotation.from_matrix(R @ truth.R_imu_lidar.T).magnitude())


def true_states(recording, truth):
    stamps = np.array([scan.stamp_ns for scan in recording.scans], dtype=np.int64)
    k = truth.imu(truth.seconds(stamps))
    return ImuStates(k.R_world, k.p_m - k.p_m[0], k.v_m_s)


def test_noise_free_recording_gives_the_truth(exact, solved):
    """A hundredth of the paper's table I (i), with the poses estimated.

    Mutations: eq. (3) without its 1/2; t + delta t; a bias of zero, or its last change taken from it; gravity upwards.
    """
    _, truth = exact
    assert isinstance(solved, PaperSolution)
    assert solved.gravity_m_s2 == SETTINGS.gravity.magnitude_m_s2
    assert solved.converged
    assert angle_deg(solved.R_imu_lidar, truth) < 1e-3
    assert np.linalg.norm(solved.p_imu_lidar - truth.p_imu_lidar) < 5e-5
    assert abs(solved.time_offset_s - truth.time_offset_s) < 1e-6
    np.testing.assert_allclose(solved.gyro_bias_rad_s, truth.gyro_bias_rad_s, atol=1e-5)
    np.testing.assert_allclose(solved.accel_bias_m_s2, truth.accel_bias_m_s2, atol=1e-3)


def test_trajectory_is_the_lidars(exact, solved):
    """Every reported pose against the simulator's, in the map. Mutation: p_imu_lidar not taken back out of the map."""
    _, truth = exact
    track = solved.trajectory
    R, p = truth.map_lidar(track.times_s + (track.epoch_ns - truth.epoch_ns) * 1e-9)
    inside = track.times_s < DURATION_S - 0.15
    np.testing.assert_allclose(track.R_map_lidar[inside], R[inside], atol=5e-5)
    np.testing.assert_allclose(track.p_map_lidar[inside], p[inside], atol=2e-4)
    assert np.all(np.diff(track.times_s) > 0.0)


def test_scans_that_lose_a_plane_are_dropped_and_counted(exact, solved):
    """Used and dropped add up; dropped ones are not valid in the trajectory.

    Mutation: a dropped scan counted as used.
    """
    recording, _ = exact
    assert solved.scans_used + solved.scans_dropped == solved.scans_total == len(recording.scans)
    assert solved.scans_dropped > 0
    assert np.mean(~solved.trajectory.valid) == pytest.approx(solved.scans_dropped / solved.scans_total, abs=0.02)
    assert any(message.code == "paper.scans_dropped" for message in solved.messages)


def test_point_cap_and_field_of_view(exact):
    """100 points of each plane and +-45 deg by default, explicit settings win.

    Mutation: the cap per scan, not per plane.
    """
    recording, _ = exact
    arguments = {"planes": None, "on_event": lambda _: None, "should_cancel": lambda: False}
    front = run_front_end(recording.scans, range(3), selection=Selection(100, 45.0, 0), **arguments)
    for scan in front.scans:
        assert np.all(np.abs(np.degrees(np.arctan2(scan.points_lidar[:, 1], scan.points_lidar[:, 0]))) <= 45.0)
        np.testing.assert_array_equal(np.bincount(scan.plane), 100)
        assert np.all(np.diff(scan.elapsed_s) >= 0.0)
    everything = run_front_end(recording.scans, range(1), selection=Selection(None, 30.0, 0), **arguments)
    assert np.all(np.abs(np.degrees(np.arctan2(*everything.scans[0].points_lidar.T[1::-1]))) <= 30.0)
    assert everything.scans[0].plane.size > 1000


def test_points_on_an_edge_belong_to_neither_plane(exact):
    """Without noise, static: every kept point lies on its plane to a millimetre. Mutation: edges not taken out."""
    recording, _ = exact
    front = run_front_end(
        recording.scans,
        range(5),
        planes=None,
        selection=Selection(None, 45.0, 0),
        on_event=lambda _: None,
        should_cancel=lambda: False,
    )
    normals, offsets = np.array([p.normal for p in front.planes]), np.array([p.offset_m for p in front.planes])
    for scan in front.scans:
        d = np.einsum("ni,ni->n", scan.points_lidar, normals[scan.plane]) + offsets[scan.plane]
        assert np.abs(d).max() < 1e-3
    # The driver's single precision is all the noise there is.
    assert front.range_std_m < 1e-4


def test_noisy_recording_at_the_published_size(noisy):
    """Within what capped points and a map of one scan allow.

    Mutation: weights of eq. (14) on the lidar factors instead.
    """
    recording, truth = noisy
    solution = calibrate_paper(recording, SETTINGS)
    assert isinstance(solution, PaperSolution)
    assert angle_deg(solution.R_imu_lidar, truth) < 0.6
    assert np.linalg.norm(solution.p_imu_lidar - truth.p_imu_lidar) < 0.03
    assert abs(solution.time_offset_s - truth.time_offset_s) < 3e-4
    assert 0.01 < solution.rms_m < 0.02
    assert np.all(np.linalg.eigvalsh(solution.covariance) > 0.0)


def test_exact_poses_and_a_motionless_sweep(exact):
    """Table I: with known poses (i) is exact and (ii) is not. Mutation: `fixed_knots` ignored in `_hold`."""
    recording, truth = exact
    recording = replace(recording, scans=list(recording.scans[:45]))
    known = true_states(recording, truth)
    first = calibrate_paper(recording, SETTINGS, options=PaperOptions(fixed_states=known, refinement_rounds=1))
    second = calibrate_paper(
        recording, SETTINGS, options=PaperOptions(fixed_states=known, motion_in_sweep="none", refinement_rounds=1)
    )
    assert np.linalg.norm(first.p_imu_lidar - truth.p_imu_lidar) < 2e-5
    assert angle_deg(first.R_imu_lidar, truth) < 1e-3
    assert np.linalg.norm(second.p_imu_lidar - truth.p_imu_lidar) > 2e-3
    R, _ = truth.map_lidar((np.array([recording.scans[0].stamp_ns]) - truth.epoch_ns) * 1e-9)
    np.testing.assert_allclose(first.trajectory.R_map_lidar[0], R[0], atol=1e-9)


def test_clocks_of_different_epochs(exact):
    """IMU stamps decades away change the answer by the difference of epochs, to the nanosecond, and nothing else.

    Mutation: the coarse offset added in float seconds.
    """
    recording, truth = exact
    imu, away_ns, guess_ns = recording.imu, 1_600_000_000_000_000_007, 30_000_000
    few = replace(recording, scans=list(recording.scans[:40]))
    # The reader's guess is 30 ms off; the same error without the epochs: stamps that are 30 ms late.
    far = replace(few, imu=replace(imu, stamps_ns=imu.stamps_ns - away_ns), coarse_offset_ns=away_ns + guess_ns)
    near = replace(few, imu=replace(imu, stamps_ns=imu.stamps_ns + guess_ns))
    options = PaperOptions(refinement_rounds=0)
    apart, together = (calibrate_paper(each, SETTINGS, options=options) for each in (far, near))
    assert apart.time_offset_ns == together.time_offset_ns + guess_ns + away_ns
    assert abs(apart.time_offset_ns - (truth.time_offset_ns + away_ns)) < 20_000
    np.testing.assert_array_equal(apart.R_imu_lidar, together.R_imu_lidar)


def test_given_planes_and_guess_are_used(exact):
    """The truth's planes keep their names; an offset no search would find is taken from the guess.

    Mutation: the guess's time offset with its sign turned, or not looked at.
    """
    recording, truth = exact
    used = [p for p in truth.planes if p.name in {"floor", "wall west", "wall south"}]
    late = replace(recording.imu, stamps_ns=recording.imu.stamps_ns + 2_000_000_000)
    guess = InitialGuess(truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns - 2_000_000_000)
    solution = calibrate_paper(
        replace(recording, imu=late, scans=list(recording.scans[:40])),
        SETTINGS,
        planes=used,
        initial_guess=guess,
        options=PaperOptions(refinement_rounds=0),
    )
    assert [each.plane.name for each in solution.planes] == [p.name for p in used]
    assert abs(solution.time_offset_ns - guess.time_offset_ns) < 1000
    assert np.linalg.norm(solution.p_imu_lidar - truth.p_imu_lidar) < 2e-4


def test_refusals_say_why(exact):
    """Two planes; a view too narrow for any; too few scans. Mutation: solving with what there is."""
    recording, truth = exact
    few = replace(recording, scans=list(recording.scans[:14]))
    two = [p for p in truth.planes if p.name in {"floor", "wall west"}]
    narrow = SETTINGS.model_copy(update={"field_of_view_deg": 4.0})
    for settings, planes, found in ((SETTINGS, two, "found 2;"), (narrow, None, "found 0;")):
        with pytest.raises(Refused, match=found) as refused:
            calibrate_paper(few, settings, planes=planes)
        assert refused.value.code == "paper.planes"
    with pytest.raises(Refused, match="found 6 of 6"):
        calibrate_paper(replace(recording, scans=list(recording.scans[:6])), SETTINGS)


@pytest.mark.parametrize("patience", [3, 60])
def test_cancelled_between_scans_and_between_steps(exact, patience: int):
    """Cancel is heard in the front end and in the solve. Mutation: should_cancel polled in only one of them."""
    recording, _ = exact
    few = replace(recording, scans=list(recording.scans[:59]))
    asked = 0

    def enough():
        nonlocal asked
        asked += 1
        return asked > patience

    with pytest.raises(Cancelled):
        calibrate_paper(few, SETTINGS, should_cancel=enough)


def test_events_follow_the_solve(exact):
    """Stages in order, iterations numbered without a gap, cost falling within each round. Mutation: numbers restart."""
    recording, truth = exact
    events = []
    calibrate_paper(replace(recording, scans=list(recording.scans[:30])), SETTINGS, on_event=events.append)
    stages = [e.stage for e in events if e.event == "stage"]
    assert list(dict.fromkeys(stages)) == ["track", "initialise", "solve"]
    steps = [e for e in events if e.event == "iteration"]
    assert [e.iteration for e in steps] == list(range(1, len(steps) + 1))
    for number in {e.round for e in steps}:
        assert np.all(np.diff([e.cost for e in steps if e.round == number]) < 0.0)
    assert np.linalg.norm(np.array(steps[-1].translation_m) - truth.p_imu_lidar) < 0.02


def test_same_recording_same_answer(exact):
    """Bit for bit, twice. Mutation: an unseeded choice of points."""
    recording, _ = exact
    few = replace(recording, scans=list(recording.scans[:22]))
    once, again = (calibrate_paper(few, SETTINGS, options=PaperOptions(refinement_rounds=1)) for _ in range(2))
    np.testing.assert_array_equal(once.R_imu_lidar, again.R_imu_lidar)
    np.testing.assert_array_equal(once.covariance, again.covariance)
