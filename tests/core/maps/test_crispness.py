"""How crisp a map is, and the motion carried by the IMU alone, against closed forms and the exact motion."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from calib_core.deskew import deskew_points, lidar_poses
from calib_core.geometry import exp
from calib_core.maps.carry import Mounting, carried
from calib_core.maps.crispness import CUBE_M, compare_rooms, crispness_of, laid, sampled
from calib_core.simulate import Truth, generate
from calib_core.types import Recording, Scan, Trajectory


def wall(noise_m: float, n: int = 200_000) -> np.ndarray:
    """Points of one level wall, 4 by 4 m, off the middle of the cubes' faces."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-2.0, 2.0, (n, 3))
    points[:, 2] = 0.05 + noise_m * rng.normal(size=n)
    return points


def true_motion(truth: Truth, duration_s: float) -> Trajectory:
    times_s = 0.005 * np.arange(1, int(duration_s * 200) - 1)
    R, p = truth.map_lidar(times_s)
    return Trajectory(truth.epoch_ns, times_s, R, p, np.ones(len(times_s), bool))


@pytest.fixture(scope="module")
def simulated() -> tuple[Recording, Truth, Trajectory]:
    """Nine seconds of the paper's fast motion with noise, and the exact motion."""
    recording, truth = generate("paper-fast", seed=2, duration_s=9.0)
    return recording, truth, true_motion(truth, 9.0)


def test_a_noisy_wall_has_the_entropy_and_thickness_of_its_closed_form() -> None:
    """A square of side a with noise s: variances a2/12 (twice) and s2. Mutations: the largest eigenvalue for the
    smallest; a mean over cubes of the root; a factor 2 pi e once instead of three times.

    Half a cube's shift leaves strips half as wide at the wall's ends: a twentieth of the points, in two grids of four for
    each side. Tolerance: with 500 points a cube the log of each variance is biased by about 1/500."""
    (room,) = compare_rooms([wall(0.01)]) or []
    side2 = CUBE_M**2 / 12
    expected = 0.5 * np.log((2 * np.pi * np.e) ** 3 * side2**2 * 0.01**2) - 0.05 * np.log(2.0)
    assert room.mean_entropy_nat == pytest.approx(expected, abs=0.01)
    assert room.thickness_std_m == pytest.approx(0.01, rel=0.01)
    assert room.points == pytest.approx(200_000, rel=0.01)


def test_thinner_is_crisper_and_the_same_points_count_in_both() -> None:
    """Mutation: count each map's own points; a map that scatters most points out of their cubes then looks crisp."""
    thin, thick = wall(0.01), wall(0.01)
    rng = np.random.default_rng(1)
    lost = rng.uniform(size=len(thick)) < 0.9
    thick[lost, 2] += rng.uniform(5.0, 500.0, int(lost.sum()))
    a, b = compare_rooms([thin, thick]) or []
    assert a.points == b.points < 30_000
    c, d = compare_rooms([wall(0.005), wall(0.01)]) or []
    assert d.mean_entropy_nat - c.mean_entropy_nat == pytest.approx(np.log(2.0), abs=0.01)


def test_too_little_room_is_not_measured() -> None:
    """Mutation: mean of nothing."""
    assert compare_rooms([np.zeros((0, 3))]) is None
    assert compare_rooms([wall(0.01, 300)]) is None


def test_without_its_motion_the_room_is_crisper(simulated: tuple[Recording, Truth, Trajectory]) -> None:
    """The lidar's noise is 20 mm along the ray, walls stand at all angles to it. Mutation: before and after exchanged."""
    recording, _, motion = simulated
    crispness = crispness_of(recording.scans, motion)
    assert crispness is not None
    assert crispness.before.mean_entropy_nat > crispness.after.mean_entropy_nat + 0.5
    assert crispness.before.thickness_std_m > 1.5 * crispness.after.thickness_std_m
    assert 0.010 < crispness.after.thickness_std_m < 0.020
    assert "crisper" in crispness.text
    assert crispness == crispness_of(recording.scans, motion)


def test_carried_with_the_true_mounting_the_motion_is_the_true_one(
    simulated: tuple[Recording, Truth, Trajectory],
) -> None:
    """Without biases; three seconds of white noise come to millimetres. Mutations: p_imu_lidar with the other sign; the
    time offset taken off; the place not fitted; gravity left out."""
    recording, truth, motion = simulated
    alone = carried(
        motion, recording.imu, Mounting(truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns), np.zeros(3)
    )
    assert alone is not None
    R, p = lidar_poses(motion, alone.times_s)
    assert np.sqrt(np.mean(np.sum((alone.p_map_lidar - p) ** 2, axis=1))) < 0.003
    assert np.abs(alone.R_map_lidar - R).max() < 0.003


def test_where_the_room_is_no_crisper_the_answer_is_not_blamed(simulated: tuple[Recording, Truth, Trajectory]) -> None:
    """Scans without motion in them, from which it is taken out all the same. Oracle: how far that moves their points.

    Mutations: the lidar is said to have stood still; the points' places for their shifts; a mean of the axes.
    """
    recording, _, motion = simulated
    scans = []
    for scan in sampled(recording.scans, motion):
        points = scan.points.copy()
        points["xyz"] = deskew_points(scan, motion)
        scans.append(Scan(scan.index, scan.stamp_ns, points))
    crispness = crispness_of(scans, motion)
    assert crispness is not None
    assert "no crisper" in crispness.text
    far_m = np.concatenate([np.linalg.norm(deskew_points(s, motion) - s.points["xyz"], axis=1) for s in scans])
    assert "hardly moved" not in crispness.text
    assert f"moves the points by {1e3 * np.sqrt(np.mean(far_m**2)):.0f} mm (rms)" in crispness.text
    assert crispness.text.endswith("this measure alone does not tell whether the answer fits.")


def test_the_right_mounting_makes_a_crisper_room_than_wrong_ones(
    simulated: tuple[Recording, Truth, Trajectory],
) -> None:
    """Half a degree about each axis, 20 mm along each. Mutation: carry with the true mounting whatever is asked."""
    recording, truth, motion = simulated
    R, p, dt = truth.R_imu_lidar, truth.p_imu_lidar, truth.time_offset_ns
    wrong = [Mounting(R @ exp(np.radians(0.5) * axis), p, dt) for axis in np.eye(3)]
    wrong += [Mounting(R, p + 0.020 * axis, dt) for axis in np.eye(3)]
    chosen = sampled(recording.scans, motion)
    maps = []
    for mounting in [Mounting(R, p, dt), *wrong]:
        alone = carried(motion, recording.imu, mounting, np.zeros(3))
        assert alone is not None
        maps.append(laid(chosen, alone))
    right, *others = compare_rooms(maps) or []
    assert all(other.mean_entropy_nat > right.mean_entropy_nat + 1e-4 for other in others)


def test_open3d_stays_out_of_a_calibration() -> None:
    """Mutation: `import open3d` on top of maps/files.py."""
    code = "import sys, calib_core.calibrate, calib_core.maps.files, calib_core.maps.room; assert 'open3d' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
