"""The scene as data: what is in it, where its points are, what a click means, what a nudge does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.arrays.recording import read_recording, write_recording
from app.planes import palette
from app.planes.state import suggested
from app.results.thickness import measure_thickness
from app.results.thinning import spread
from app.scene.aim import whole_view
from app.scene.apply import BACKGROUNDS
from app.scene.build import Solved, build_first, build_planes
from app.scene.items import Axes, Cloud, Sheet, fingerprint
from app.scene.nudge import nudged, wall_blur
from app.scene.picking import pick
from app.scene.straighten import fastest_scan, straighten
from app.scene.viser_poses import quat_wxyz, rotation_matrix
from app.schemas.view import Nudge
from calib_core import api
from tests.app.support import world

RECORDING = world.make_recording()
SOLVED = Solved(world.make_trajectory(), world.plane_quality(), [0, 1, 2, 3, 4, 5], world.transform_matrix())


def cloud_of(content, path):
    return next(item for item in content.items if isinstance(item, Cloud) and item.path == path)


def test_planes_scene_has_a_clickable_sheet_per_patch_and_colours_by_patch():
    """Mutations: points of a dropped patch in its full colour; the patch's colour taken for a confirmed one's trace."""
    proposals = world.make_proposals()
    planes = suggested(proposals)
    content = build_planes(proposals, planes, limit=100_000, shaded=False)
    sheets = [item for item in content.items if isinstance(item, Sheet)]
    assert [sheet.patch for sheet in sheets] == [0, 1, 2, 3, 4, 5]
    assert sheets[5].opacity < sheets[0].opacity  # the last is dropped
    rgb = cloud_of(content, "/cloud").rgb
    for k in range(5):
        assert (rgb[proposals.cloud_patch == k] == palette.plane_rgb(k)).all()
    assert (rgb[proposals.cloud_patch == 5] == palette.faint(palette.plane_rgb(5))).all()
    assert (rgb[proposals.cloud_patch == -1] == palette.NO_PLANE).all()
    assert cloud_of(build_planes(proposals, planes, limit=1000), "/cloud").xyz.shape == (1000, 3)


def test_thinning_is_spread_evenly_and_repeatable():
    """Mutation: taking the first ones shows the start of the sweep only."""
    kept = spread(1000, 10)
    assert (kept[0], kept[-1], len(kept)) == (0, 999, 10)
    assert np.diff(kept).min() >= 110
    np.testing.assert_array_equal(spread(5, 10), np.arange(5))


def test_thickness_is_the_motion_before_and_nothing_after():
    """Oracle: distances computed here from the room's own points. Mutation: choosing points by their raw place."""
    walls = measure_thickness(RECORDING, SOLVED.trajectory, world.plane_quality())
    assert walls.after_rms_m < 1e-3
    squares = []
    for scan in RECORDING.scans:
        _, wall = world.room_points(len(scan.points), seed=100 + scan.index)
        R, p = world.poses([scan.index * world.PERIOD_S])
        rigid = scan.points["xyz"] @ R[0].T + p[0]
        normals = np.array([normal for _, normal, _ in world.WALLS])[wall]
        offsets = np.array([w for _, _, w in world.WALLS])[wall]
        squares.append(((rigid * normals).sum(axis=1) + offsets) ** 2)
    assert walls.before_rms_m == pytest.approx(np.sqrt(np.mean(np.concatenate(squares))), rel=0.02)
    assert sum(wall.points for wall in walls.walls) == sum(len(scan.points) for scan in RECORDING.scans)


def test_rigid_points_keep_their_mutual_distances():
    """Law of a rigid body. Mutation: not transposing the rotation."""
    scan = RECORDING.scans[7]
    moved = api.raw_map_points(scan, SOLVED.trajectory)
    before, after = scan.points["xyz"][:50], moved[:50]
    np.testing.assert_allclose(
        np.linalg.norm(before[:, None] - before, axis=2), np.linalg.norm(after[:, None] - after, axis=2), atol=1e-3
    )
    R, p = world.poses([0.7])
    np.testing.assert_allclose(moved, scan.points["xyz"] @ R[0].T + p[0], atol=1e-3)


def test_no_nudge_changes_nothing():
    """Law. Mutation: applying the lever arm twice."""
    same = nudged(SOLVED.trajectory, SOLVED.T_imu_lidar, Nudge())
    np.testing.assert_allclose(same.R_map_lidar, SOLVED.trajectory.R_map_lidar, atol=1e-12)
    np.testing.assert_allclose(same.p_map_lidar, SOLVED.trajectory.p_map_lidar, atol=1e-12)


@pytest.mark.parametrize("nudge", [Nudge(rx_deg=2), Nudge(ty_m=0.1), Nudge(dt_s=0.02), Nudge(rz_deg=-1, tx_m=0.03)])
def test_a_nudged_motion_is_the_imus_motion_seen_with_the_wrong_extrinsic(nudge):
    """Oracle: relative poses by 4x4 matrices, one knot at a time. Mutation: perturbing on the left."""
    T_right = SOLVED.T_imu_lidar
    angle = np.radians([nudge.rx_deg, nudge.ry_deg, nudge.rz_deg])
    axis = int(np.abs(angle).argmax())
    T_wrong = T_right.copy()
    T_wrong[:3, :3] = T_right[:3, :3] @ world.turn(axis, angle[axis : axis + 1])[0]
    T_wrong[:3, 3] += [nudge.tx_m, nudge.ty_m, nudge.tz_m]
    wrong = nudged(SOLVED.trajectory, T_right, nudge)
    right = SOLVED.trajectory

    def pose(trajectory, k):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = trajectory.R_map_lidar[k], trajectory.p_map_lidar[k]
        return T

    for i, j in ((0, 40), (13, 90)):
        imu_moved = np.linalg.inv(pose(right, i) @ np.linalg.inv(T_right)) @ pose(right, j) @ np.linalg.inv(T_right)
        lidar_moved = np.linalg.inv(pose(wrong, i)) @ pose(wrong, j)
        np.testing.assert_allclose(lidar_moved, np.linalg.inv(T_wrong) @ imu_moved @ T_wrong, atol=1e-10)
    np.testing.assert_allclose(pose(wrong, 0), pose(right, 0), atol=1e-12)
    np.testing.assert_allclose(wrong.times_s - right.times_s, nudge.dt_s)


def test_a_nudge_blurs_the_walls():
    """Mutation: measuring the solved trajectory twice shows no cost."""
    wrong = nudged(SOLVED.trajectory, SOLVED.T_imu_lidar, Nudge(rx_deg=3.0))
    blur = wall_blur(RECORDING, SOLVED, wrong)
    assert blur.solved_rms_m < 1e-3
    assert blur.nudged_rms_m > 0.02


def test_a_nudge_is_told_beside_the_thickness_that_every_screen_has():
    """Oracle: the walls as measured, and squares that add up. Mutation: the sample's own thickness told for the walls'."""
    measured = measure_thickness(RECORDING, SOLVED.trajectory, world.plane_quality())
    walls = measured.model_copy(update={"after_rms_m": 0.0147})
    own = wall_blur(RECORDING, SOLVED, wrong := nudged(SOLVED.trajectory, SOLVED.T_imu_lidar, Nudge(rx_deg=3.0)))
    blur = wall_blur(RECORDING, replace(SOLVED, walls=walls), wrong)
    assert blur.solved_rms_m == pytest.approx(0.0147)
    assert blur.nudged_rms_m**2 - 0.0147**2 == pytest.approx(own.nudged_rms_m**2 - own.solved_rms_m**2)
    same = wall_blur(RECORDING, replace(SOLVED, walls=walls), SOLVED.trajectory)
    assert same.nudged_rms_m == pytest.approx(same.solved_rms_m, abs=1e-6)


def test_straightening_takes_a_constant_turn_out():
    """Oracle: the closed form of a constant turn. Mutation: R instead of R^T between the frames."""
    scan = RECORDING.scans[fastest_scan(RECORDING)]
    points = straighten(scan, RECORDING.imu, T_imu_lidar=world.transform_matrix(), time_offset_s=0.0)
    angle = world.TURN_RAD_S * scan.points["offset_ns"] * 1e-9
    R = world.turn(2, angle)
    lever = -world.R_IMU_LIDAR.T @ world.P_IMU_LIDAR  # the IMU's place in the lidar frame: it is what turns in place
    expected = np.einsum("nij,nj->ni", R, scan.points["xyz"] - lever) + lever
    # Half a slice of the sweep is the only approximation: 5 m x 0.9 rad/s x 0.5 ms.
    np.testing.assert_allclose(points, expected, atol=5 * world.TURN_RAD_S * 0.0006)
    far = straighten(scan, RECORDING.imu, T_imu_lidar=np.eye(4), time_offset_s=1000.0)
    np.testing.assert_array_equal(far, scan.points["xyz"])


def test_a_click_picks_the_nearest_surface_on_its_ray():
    """Oracle: the room: a ray from outside through the west wall first meets that wall. Mutation: ignoring depth."""
    cloud = world.make_proposals().cloud_m
    target = cloud[np.abs(cloud[:, 0] + 4.0) < 1e-5][0].astype(np.float64)
    origin = np.array([-12.0, 0.5, 0.3])
    picked = pick(cloud, origin, 3.0 * (target - origin))
    assert picked[0] == pytest.approx(-4.0, abs=1e-5)
    assert np.linalg.norm(picked - target) < 0.15
    front, back = [5.0, 0.02, 0.0], [10.0, 0.0, 0.0]  # the nearer surface wins although the ray passes it by 2 cm
    np.testing.assert_allclose(pick(np.array([back, front], np.float32), np.zeros(3), np.array([1.0, 0, 0])), front)
    assert pick(cloud, origin, np.array([-1.0, 0.0, 0.0])) is None
    assert pick(cloud, origin, np.zeros(3)) is None
    assert pick(np.zeros((0, 3), dtype=np.float32), origin, target) is None


def test_quaternions_for_the_viewer_have_the_scalar_first():
    """Oracle: half-angle formula. Mutation: SciPy's own order."""
    quarter = world.turn(2, np.array([np.pi / 2]))[0]
    np.testing.assert_allclose(quat_wxyz(quarter), [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-12)


def test_fingerprints_tell_changes_and_only_changes():
    """Mutation: leaving the colours out shows yesterday's."""
    xyz = np.zeros((5, 3), dtype=np.float32)
    rgb = palette.uniform(5, (1, 2, 3))
    same = fingerprint(Cloud("/a", xyz, rgb))
    assert fingerprint(Cloud("/a", xyz.copy(), rgb.copy())) == same
    assert fingerprint(Cloud("/a", xyz + 1, rgb)) != same
    assert fingerprint(Cloud("/a", xyz, rgb + 1)) != same
    assert fingerprint(Axes("/f", np.eye(3), np.zeros(3), 1.0)) != fingerprint(Axes("/f", np.eye(3), np.ones(3), 1.0))


def contrast(one, other):
    """Of two sRGB colours, 1 to 21."""
    linear = [
        np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
        for c in (np.array(one) / 255, np.array(other) / 255)
    ]
    low, high = sorted(float(c @ [0.2126, 0.7152, 0.0722]) for c in linear)
    return (high + 0.05) / (low + 0.05)


def test_scales_run_from_end_to_end_and_grey_out_the_unknown():
    """What lies right is seen on either background (WCAG 2.1's contrast). Mutations: not clipping wraps bright values to dark
    ones; one scale for both backgrounds: white on pale grey.
    """
    rgb = palette.diverging(np.array([-1, -0.05, 0, 0.05, 1, np.nan], dtype=np.float32), 0.05)
    np.testing.assert_array_equal(rgb[0], rgb[1])
    np.testing.assert_array_equal(rgb[3], rgb[4])
    assert rgb[2].min() > 220
    assert rgb[0][2] > rgb[0][0]
    assert rgb[4][0] > rgb[4][2]
    np.testing.assert_array_equal(rgb[5], palette.NO_PLANE)
    for dark, background in BACKGROUNDS.items():
        for one in palette.diverging(np.linspace(-1, 1, 21, dtype=np.float32), 1.0, dark=dark):
            assert contrast(one, background) > 2.4
    light = palette.sequential(np.linspace(0, 1, 50, dtype=np.float32), 0.0, 1.0) @ [0.2126, 0.7152, 0.0722]
    assert np.diff(light).min() >= -1.0  # lightness alone tells the order


def test_a_recording_survives_the_array_file(tmp_path):
    """Oracle: the recording itself. Mutation: writing float64 stamps loses the last nanoseconds."""
    write_recording(tmp_path / "r", RECORDING)
    back = read_recording(tmp_path / "r")
    assert (back.name, back.lidar, back.sha256) == (RECORDING.name, RECORDING.lidar, RECORDING.sha256)
    np.testing.assert_array_equal(back.imu.stamps_ns, RECORDING.imu.stamps_ns)
    assert len(back.scans) == world.N_SCANS
    for mine, theirs in zip(RECORDING.scans, back.scans, strict=True):
        assert (mine.index, mine.stamp_ns) == (theirs.index, theirs.stamp_ns)
        np.testing.assert_array_equal(mine.points, theirs.points)
    assert back.scans[-1].stamp_ns == RECORDING.scans[-1].stamp_ns
    assert [scan.index for scan in back.scans[2:4]] == [2, 3]
    assert not list(tmp_path.glob("*.part"))


def test_the_whole_is_on_the_canvas_and_fills_it():
    """Oracle: the pinhole, point by point, and the picture in the middle of the canvas.

    Mutations: the aspect forgotten; the nearer points' depth ignored; looking at the middle of the box around the points.
    """
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (4000, 3)) * [9.0, 4.0, 2.0] + [3.0, -5.0, 1.0]
    for aspect in (0.8, 2.2):
        middle, eye = whole_view(points, fov_rad=1.0, aspect=aspect)
        forward = (middle - eye) / np.linalg.norm(middle - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        seen = (points - eye) @ np.stack([right, down, forward], axis=1)
        across = seen[:, 0] / seen[:, 2] / (np.tan(0.5) * aspect)
        along = seen[:, 1] / seen[:, 2] / np.tan(0.5)
        assert (seen[:, 2] > 0).all()
        assert np.mean((np.abs(across) < 1) & (np.abs(along) < 1)) > 0.98
        assert max(np.abs(across).max(), np.abs(along).max()) > 0.8
        for place in (across, along):  # as much room on one side as on the other
            assert abs(np.percentile(place, 99.5) + np.percentile(place, 0.5)) < 0.06


def test_cameras_aim_anew_when_the_planes_replace_the_first_scans():
    """Mutation: the first scans without an aim of their own: the room is then cut off at the canvas's edges."""
    first = build_first(RECORDING.scans[0].points, limit=1000, note="")
    proposals = world.make_proposals()
    planes = build_planes(proposals, suggested(proposals), limit=1000)
    assert first.aim
    assert planes.aim not in {"", first.aim}


def test_a_rotation_survives_the_viewers_order():
    """Law: there and back. Mutation: the scalar read last."""
    rotation = world.R_IMU_LIDAR
    np.testing.assert_allclose(rotation_matrix(np.array(quat_wxyz(rotation))), rotation, atol=1e-12)
