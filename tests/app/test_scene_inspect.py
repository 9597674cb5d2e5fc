"""The inspection's scene as data: which cloud is where, what a wipe cuts, what an old extrinsic would show."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from app.planes import palette
from app.results.thickness import measure_thickness
from app.scene.aim import stand
from app.scene.build import build_unsolved
from app.scene.compose import _motions
from app.scene.converge import build_converging, steady_up
from app.scene.inspect import build_inspection
from app.scene.items import Axes, Cloud, Label, Line
from app.scene.nudge import nudged, with_old
from app.scene.wipe import left_of
from app.schemas.view import Nudge, OldExtrinsic, ViewState
from calib_core.events import IterationEvent, PlaneResidual, SweepMotion
from tests.app.support import world
from tests.app.support.inspection import LOOK, MOTIONS, RECORDING, SOLVED, seen_from_above


def clouds_of(content):
    return {item.path: item for item in content.items if isinstance(item, Cloud)}


def test_deskewed_points_lie_where_the_room_was_and_raw_ones_do_not():
    """Oracle: the room points the scan was made from. Mutation: swapping raw and de-skewed."""
    _, seen = world.make_scan(5)
    clouds = clouds_of(build_inspection(RECORDING, LOOK, MOTIONS, None))
    deskewed, raw = clouds["/deskewed"].xyz, clouds["/raw"].xyz
    assert deskewed.dtype == np.float32
    np.testing.assert_allclose(deskewed, seen, atol=1e-3)
    assert np.linalg.norm(raw - seen, axis=1).max() > 0.2
    R, p = world.poses([5 * world.PERIOD_S])
    np.testing.assert_allclose(raw, RECORDING.scans[5].points["xyz"] @ R[0].T + p[0], atol=1e-3)
    assert (clouds["/raw"].rgb == palette.RAW).all()


def test_a_nudge_moves_the_deskewed_cloud_only():
    """Mutation: the raw cloud placed by the nudged motion hides what is compared."""
    wrong = nudged(SOLVED.trajectory, SOLVED.T_imu_lidar, Nudge(rx_deg=5.0))
    before = clouds_of(build_inspection(RECORDING, LOOK, MOTIONS, None))
    after = clouds_of(build_inspection(RECORDING, LOOK, replace(MOTIONS, shown=wrong), None))
    np.testing.assert_array_equal(before["/raw"].xyz, after["/raw"].xyz)
    assert np.linalg.norm(before["/deskewed"].xyz - after["/deskewed"].xyz, axis=1).max() > 0.05


@pytest.mark.parametrize("show", ["deskewed", "old"])
def test_the_map_accumulates_scans_on_the_walls(show):
    """The answer given as the old extrinsic shows the same room. Mutation: forgetting each scan's own pose."""
    look = replace(LOOK, show=show, extent="map", color_by="residual", limit=3000)
    old = OldExtrinsic(translation_m=tuple(world.P_IMU_LIDAR), quaternion_xyzw=tuple(world.QUAT_XYZW_IMU_LIDAR))
    content = build_inspection(RECORDING, look, replace(MOTIONS, old=with_old(SOLVED, old)), None)
    xyz = clouds_of(content)[f"/{show}"].xyz
    assert len(xyz) == 3000
    assert np.abs(np.abs(xyz) - world.HALF_M).min(axis=1).max() < 2e-3


def test_an_old_extrinsics_clock_counts_and_its_absence_borrows_the_answers():
    """Oracle: 20 ms more offset shift all instants by 20 ms. Mutation: the difference taken the other way round."""
    pose = {"translation_m": tuple(world.P_IMU_LIDAR), "quaternion_xyzw": tuple(world.QUAT_XYZW_IMU_LIDAR)}
    without = with_old(SOLVED, OldExtrinsic(**pose))
    later = with_old(SOLVED, OldExtrinsic(**pose, time_offset_s=SOLVED.time_offset_s + 0.02))
    np.testing.assert_allclose(without.times_s, SOLVED.trajectory.times_s, atol=1e-12)
    np.testing.assert_allclose(later.times_s - SOLVED.trajectory.times_s, 0.02, atol=1e-12)
    turned = with_old(SOLVED, OldExtrinsic(translation_m=(0, 0, 0), quaternion_xyzw=(0, 0, 0, 1)))
    R_map_imu = SOLVED.trajectory.R_map_lidar @ world.R_IMU_LIDAR.T
    np.testing.assert_allclose(  # with the identity the lidar turns as the IMU does
        np.swapaxes(turned.R_map_lidar[:-1], 1, 2) @ turned.R_map_lidar[1:],
        np.swapaxes(R_map_imu[:-1], 1, 2) @ R_map_imu[1:],
        atol=1e-9,
    )


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0)])
def test_an_old_rotation_has_to_be_one(quaternion):
    """Mutation: dividing by the length whatever it is."""
    with pytest.raises(ValidationError, match="unit quaternion"):
        OldExtrinsic(translation_m=(0, 0, 0), quaternion_xyzw=quaternion)


def test_what_is_drawn_left_of_a_line_is_left_of_it():
    """Oracle: from 10 m above with 90 deg of height and twice the width, the canvas is 20 m across at 10 m.

    Mutations: the aspect forgotten; the share counted from the right; depth taken from the wrong axis.
    """
    points = np.array([[-9.9, 0, 0], [-10.1, 0, 0], [-1, 3, 0], [1, 3, 0], [4.9, 0, 0], [5.1, 0, 0]], np.float32)
    camera = seen_from_above()
    assert left_of(points, camera, 0.0).tolist() == [False] * 1 + [False, False, False, False, False]
    assert left_of(points, camera, 0.5).tolist() == [True, True, True, False, False, False]
    assert left_of(points, camera, 0.625).tolist() == [True, True, True, True, True, False]
    raised = points + np.array([0, 0, 5.0], np.float32)  # half as far away: twice as wide
    assert left_of(raised, camera, 0.75).tolist() == [True, True, True, True, True, False]


def test_a_wipe_shows_each_point_once():
    """Raw left of the line, de-skewed right of it, the rest of each cut away. Mutation: both kept whole."""
    whole = clouds_of(build_inspection(RECORDING, LOOK, MOTIONS, None))
    camera = seen_from_above()
    content = build_inspection(RECORDING, replace(LOOK, show="wipe", wipe=0.5), MOTIONS, camera)
    cut = clouds_of(content)
    assert cut["/raw"].xyz[:, 0].max() < 0.0 <= cut["/deskewed"].xyz[:, 0].min()
    assert len(cut["/raw"].xyz) == (whole["/raw"].xyz[:, 0] < 0.0).sum() > 100
    assert len(cut["/deskewed"].xyz) == (whole["/deskewed"].xyz[:, 0] >= 0.0).sum() > 100
    assert "Left of the line: raw" in content.legend


@pytest.mark.parametrize("with_old_one", [False, True])
def test_side_by_side_is_the_same_clouds_apart(with_old_one):
    """Mutation: not shifting at all; shifting each by its own breadth."""
    old = OldExtrinsic(translation_m=(0, 0, 0), quaternion_xyzw=(0, 0, 0, 1))
    motions = replace(MOTIONS, old=with_old(SOLVED, old)) if with_old_one else MOTIONS
    whole = {
        show: clouds_of(build_inspection(RECORDING, replace(LOOK, show=show, limit=900), motions, None))[f"/{show}"]
        for show in ("raw", "deskewed")
    }
    content = build_inspection(RECORDING, replace(LOOK, show="side", limit=900 * len(whole)), motions, None)
    side = clouds_of(content)
    assert list(side) == (["/raw", "/old", "/deskewed"] if with_old_one else ["/raw", "/deskewed"])
    if not with_old_one:
        shifts = [np.mean(side[f"/{name}"].xyz - whole[name].xyz, axis=0) for name in ("raw", "deskewed")]
        np.testing.assert_allclose(shifts[0], -shifts[1], atol=1e-4)
        np.testing.assert_allclose(side["/raw"].xyz - whole["raw"].xyz, shifts[0] + 0 * side["/raw"].xyz, atol=1e-4)
    low = min(cloud.xyz[:, 0].max() for cloud in side.values())
    assert low < max(cloud.xyz[:, 0].min() for cloud in side.values()) + 8.0
    titles = [item.text for item in content.items if isinstance(item, Label) and item.path.startswith("/titles")]
    assert titles == (["Raw", "Old extrinsic", "De-skewed"] if with_old_one else ["Raw", "De-skewed"])


def test_another_run_is_called_by_its_name():
    """Mutations: one run called an old extrinsic over its cloud; in a legend."""
    old = OldExtrinsic(translation_m=(0, 0, 0), quaternion_xyzw=(0, 0, 0, 1), name="Run 3")
    motions = replace(MOTIONS, old=with_old(SOLVED, old), old_name=old.name)

    def shown(show, camera=None):
        return build_inspection(RECORDING, replace(LOOK, show=show, against="old", limit=900), motions, camera)

    assert [item.text for item in shown("side").items if isinstance(item, Label) and item.path == "/titles/old"] == [
        "Run 3"
    ]
    assert shown("both").legend == "Magenta: Run 3; blue: de-skewed."
    assert shown("wipe", seen_from_above()).legend.startswith("Left of the line: Run 3; right: de-skewed.")
    unnamed = build_inspection(
        RECORDING, replace(LOOK, show="both", against="old"), replace(motions, old_name=""), None
    )
    assert unnamed.legend == "Magenta: old extrinsic; blue: de-skewed."
    assert _motions(SOLVED, ViewState(old=old)).old_name == "Run 3"


@pytest.mark.parametrize("preset", ["overview", "top", "front"])
def test_clouds_beside_each_other_hide_none_of_one_another(preset):
    """From wherever one looks they stand in a row across the view, the raw one on the left. Oracle: the camera's own left and
    right. Mutations: one row for all, in which the front view has them behind one another; the row turned round.
    """
    old = OldExtrinsic(translation_m=(0, 0, 0), quaternion_xyzw=(0, 0, 0, 1))
    motions = replace(MOTIONS, old=with_old(SOLVED, old))
    content = build_inspection(RECORDING, replace(LOOK, show="side", preset=preset), motions, None)
    side = clouds_of(content)
    points = np.concatenate([cloud.xyz for cloud in side.values()]).astype(np.float64)
    camera = stand(points, content.stage, preset, fov_rad=1.0, aspect=1.6)
    ahead = camera.middle_m - camera.eye_m
    right = np.cross(ahead, content.stage.up)
    right /= np.linalg.norm(right)
    edges = [np.percentile(cloud.xyz @ right, [3, 97]) for cloud in side.values()]
    assert list(side) == ["/raw", "/old", "/deskewed"]
    assert all(left[1] < after[0] for left, after in pairwise(edges))
    ways = [after.xyz.mean(axis=0) - left.xyz.mean(axis=0) for left, after in pairwise(side.values())]
    assert all(abs(way @ right) > 0.99 * np.linalg.norm(way) for way in ways)


def test_frames_stand_where_the_sensors_were():
    """Oracle: the world's own poses and lever arm. Mutation: the IMU's frame by the transform instead of its inverse."""
    content = build_inspection(RECORDING, LOOK, MOTIONS, None)
    axes = {item.path: item for item in content.items if isinstance(item, Axes)}
    R, p = world.poses([5 * world.PERIOD_S])
    np.testing.assert_allclose(axes["/lidar"].R_scene_frame, R[0], atol=1e-9)
    imu = axes["/imu"]
    back = imu.R_scene_frame @ world.P_IMU_LIDAR + imu.p_scene_frame
    np.testing.assert_allclose(back, p[0], atol=1e-9)  # the lidar's origin, seen from the IMU
    np.testing.assert_allclose(imu.R_scene_frame @ world.R_IMU_LIDAR, R[0], atol=1e-9)
    lines = {item.path: item for item in content.items if isinstance(item, Line)}
    np.testing.assert_allclose(lines["/path/behind"].xyz[-1], p[0], atol=1e-6)
    assert len(lines["/path/behind"].xyz) < len(lines["/path/whole"].xyz)


@pytest.mark.parametrize("color_by", ["plane", "time", "residual", "intensity"])
def test_every_colouring_says_what_it_means_and_keeps_the_limit(color_by):
    """Mutation: a missing legend."""
    content = build_inspection(RECORDING, replace(LOOK, show="raw", color_by=color_by, limit=1000), MOTIONS, None)
    assert content.points_shown == 1000
    assert content.legend.endswith(".")
    assert build_unsolved(RECORDING, 3, color_by=color_by, limit=1000, note="x.").points_shown == 1000


def step_of(turn_rad_s):
    """A step that believes in this rate of turn and in the world's speed and walls."""
    sweeps = []
    for scan in RECORDING.scans[:6]:
        offset_s = np.array([0.0, 0.05, 0.099])
        start_s = (scan.stamp_ns - world.EPOCH_NS) * 1e-9
        _, p = world.poses(start_s + offset_s)
        half = 0.5 * (world.TURN_RAD_S * start_s + turn_rad_s * offset_s)
        quaternions = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
        sweep = {"offset_s": offset_s.tolist(), "quaternion_xyzw": quaternions.tolist(), "position_m": p.tolist()}
        sweeps.append(SweepMotion(stamp_ns=scan.stamp_ns, **sweep))
    planes = [
        PlaneResidual(name=n, rms_m=0.0, points=1, normal=list(normal), offset_m=w) for n, normal, w in world.WALLS
    ]
    numbers = {"rotation_std_deg": [0.0] * 3, "translation_std_m": [0.0] * 3, "time_offset_std_s": 0.0}
    return IterationEvent(
        iteration=1,
        round=1,
        cost=1.0,
        matrix=world.transform_matrix().tolist(),
        translation_m=[0.0] * 3,
        euler_xyz_deg=[0.0] * 3,
        time_offset_s=0.0,
        planes=planes,
        sweeps=tuple(sweeps),
        **numbers,
    )


def test_a_running_solves_walls_are_as_thick_as_it_is_wrong():
    """Oracle: the room. Mutation: sweeps moved by the first instant's pose only; scans taken by place, not by stamp."""
    later = replace(RECORDING, scans=RECORDING.scans[1:])  # some were left out: places differ, stamps do not
    right = build_converging(later, step_of(world.TURN_RAD_S), limit=60_000)
    xyz = clouds_of(right)["/sweeps"].xyz
    assert len(xyz) == 5 * 1500
    assert np.abs(np.abs(xyz) - world.HALF_M).min(axis=1).max() < 5e-3
    wrong = clouds_of(build_converging(later, step_of(0.5 * world.TURN_RAD_S), limit=60_000))["/sweeps"].xyz
    assert np.abs(np.abs(wrong) - world.HALF_M).min(axis=1).max() > 0.05
    assert "5 sweeps" in right.legend
    assert build_converging(replace(RECORDING, scans=[]), step_of(0.0), limit=10).note


def test_a_solve_that_has_ended_tells_the_thickness_that_every_screen_has():
    """Oracle: the numbers as measured. Mutation: those of the dozen sweeps that are drawn told on."""
    walls = measure_thickness(RECORDING, SOLVED.trajectory, world.plane_quality())
    walls = walls.model_copy(update={"before_rms_m": 0.0440, "after_rms_m": 0.0148})
    told = build_converging(RECORDING, step_of(world.TURN_RAD_S), limit=10_000, measured=walls).legend
    assert "14.8 mm thick (44.0 mm with the motion left in)" in told
    under_way = build_converging(RECORDING, step_of(world.TURN_RAD_S), limit=10_000).legend
    assert "14.8" not in under_way


def leaning(deg):
    """Gravity of a frame that leans so far about x, told by a step."""
    down = -9.81 * np.array([0.0, np.sin(np.radians(deg)), np.cos(np.radians(deg))])
    return step_of(world.TURN_RAD_S).model_copy(update={"gravity_m_s2": down.tolist()})


def test_a_run_that_is_told_from_another_scan_stands_upright():
    """The planes were seen in a scan that the IMU does not cover, so the run's frame leans against theirs.

    Who has turned the view is not turned back for a degree. Mutations: the planes' vertical whatever the run says; the run's
    own for every step, or with its sign lost.
    """
    z = np.array([0.0, 0.0, 1.0])
    up = steady_up(leaning(40.0), z)
    assert up is not None
    content = build_converging(RECORDING, leaning(40.0), limit=1000, up=up)
    np.testing.assert_allclose(content.stage.up, [0.0, np.sin(np.radians(40.0)), np.cos(np.radians(40.0))], atol=1e-12)
    assert steady_up(leaning(1.0), z) is z
    assert steady_up(step_of(world.TURN_RAD_S), z) is z  # of an older version, or the published method
    np.testing.assert_allclose(steady_up(leaning(0.0), None), z, atol=1e-12)
    assert steady_up(step_of(world.TURN_RAD_S), None) is None
