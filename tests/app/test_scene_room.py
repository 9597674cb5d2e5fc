"""The room as a room: names and vertical from the doctor, the cut, the ways to look, the part of a plane that was seen."""

from __future__ import annotations

import numpy as np
import pytest

from app.planes.operations import apply
from app.planes.palette import uniform
from app.planes.state import PlaneHistory, suggested
from app.planes.upright import named, room_of
from app.planes.wire import determinacy, wire_planes
from app.scene.aim import Stage, hidden, stage_of, stand, wall_of
from app.scene.apply import ShownScene
from app.scene.build import build_planes
from app.scene.cutaway import pieces
from app.scene.items import Cloud, Content, Sheet, point_size_m
from app.scene.support import CELLS, support_of
from app.scene.upright import vertical_of
from app.schemas.planes import Drop, Rename, Side
from calib_core.doctor.report import PlaneReport, PlanesReport
from calib_core.types import ImuData, Recording, Trajectory
from tests.app.support import world

PRESETS = ("overview", "inside", "top", "front")
PROPOSALS = world.make_proposals()
WALLS = np.array([(*patch.plane.normal, patch.plane.offset_m) for patch in PROPOSALS.patches])
UP = np.array([0.0, 0.0, 1.0])


#: Which of the proposals the doctor's sample shows, in its order.
SAMPLED = (5, 3, 1, 0, 4)


def report(*, off_m: float = 0.0, up=(0.0, 0.0, 1.0)) -> PlanesReport:
    """The doctor's planes; of the third there is nothing in the proposals."""
    seen = [(PROPOSALS.patches[place].plane, off_m) for place in SAMPLED]
    seen.insert(2, (PROPOSALS.patches[SAMPLED[0]].plane, 3.0))
    planes = tuple(
        PlaneReport(
            name=f"doctor's {rank}",
            kind="wall",
            tilt_deg=90.0,
            area_m2=1.0,
            distance_m=abs(plane.offset_m) + apart_m,
            points=1,
            rms_m=0.01,
            normal=tuple(plane.normal.tolist()),
        )
        for rank, (plane, apart_m) in enumerate(seen)
    )
    return PlanesReport(planes=planes, determinacy=1.0, determined=True, text="", up=up)


def plainly_named() -> PlaneHistory:
    """The proposals under the names that a search gives."""
    patches = suggested(PROPOSALS).patches
    plain = tuple(patch.model_copy(update={"name": f"plane {place + 1}"}) for place, patch in enumerate(patches))
    return PlaneHistory(
        cache_key="", revision=0, steps=(suggested(PROPOSALS).model_copy(update={"patches": plain}),), cursor=0
    )


def what_it_is(place: int) -> str:
    """By the box's own axes, z up."""
    z = PROPOSALS.patches[place].plane.normal[2]
    return "floor" if z > 0.5 else "ceiling" if z < -0.5 else "wall"


def test_planes_are_called_what_they_are_in_the_doctors_order_unless_somebody_named_them():
    """Oracle: the box. What only the sample shows leaves no gap, what it missed is named too, and comes last.

    Mutations: numbered by rank among the doctor's; what it missed left a plane; a name given by hand overwritten; another
    frame's names taken; up for down.
    """
    room = room_of(report(), PROPOSALS)
    order = (*SAMPLED, 2)
    walls = [place for place in order if what_it_is(place) == "wall"]
    wanted = {place: f"wall {walls.index(place) + 1}" if place in walls else what_it_is(place) for place in order}
    assert room.names == wanted
    assert len(walls) == 4
    plain = plainly_named()
    renamed = plain.push(
        apply(plain.current, Rename(op="rename", index=2, name="mine"), proposals=PROPOSALS, grow=lambda *_: None)
    )
    names = [patch.name for patch in named(renamed, room).current.patches]
    assert names == [wanted[0], wanted[1], "mine", *(wanted[place] for place in (3, 4, 5))]
    assert named(plain, room_of(report(off_m=0.5), PROPOSALS)) == plain
    assert room_of(None, PROPOSALS).up is None


def test_what_the_doctor_doubts_is_marked_on_the_plane_that_it_is_as_long_as_nobody_has_changed_it() -> None:
    """One that was cut or merged counts in a solve. Mutations: by the rank in the report; on the first plane; kept with a merge,
    with a box of its own, with a box of all.
    """
    doctor = report()
    place = SAMPLED.index(1) + 1  # what nobody sees stands before it in the report
    planes = list(doctor.planes)
    planes[place] = planes[place].model_copy(update={"doubt": "does not seem to be flat"})
    room = room_of(doctor.model_copy(update={"planes": tuple(planes)}), PROPOSALS)
    assert room.doubts == {1: "does not seem to be flat"}
    history = plainly_named()
    some = [
        patch.model_copy(update={"members": members})
        for patch, members in zip(history.current.patches, ((0,), (1,), (2, 1), (), (4,), (5,)), strict=True)
    ]
    edited = history.push(history.current.model_copy(update={"patches": tuple(some)}))
    shown = wire_planes(edited, static=True, doubts=room.doubts).patches
    assert [patch.doubt != "" for patch in shown] == [False, True, False, False, False, False]
    box = (Side(normal=[0.0, 0.0, 1.0], offset_m=0.5),)
    own = [patch.model_copy(update={"region": box}) for patch in some]
    for update in ({"patches": tuple(own)}, {"patches": tuple(some), "region": box}):
        cut = history.push(history.current.model_copy(update=update))
        assert not any(patch.doubt for patch in wire_planes(cut, static=True, doubts=room.doubts).patches)


def test_a_plane_that_was_grown_is_called_what_it_is_too():
    """The next of its kind, and never by a name that another has. Mutations: the search's name kept; a number that is taken."""
    room = room_of(report(), PROPOSALS)
    plain = plainly_named()
    first = next(place for place in range(6) if what_it_is(place) == "wall")
    for normal, wanted in ((plain.current.patches[first].normal, "wall 5"), ((0.0, 0.0, 1.0), "floor 2")):
        grown = plain.current.patches[first].model_copy(update={"name": "plane 7", "color": 6, "normal": normal})
        more = plain.push(plain.current.model_copy(update={"patches": (*plain.current.patches, grown)}))
        assert named(more, room).current.patches[-1].name == wanted
        assert len({patch.name for patch in named(more, room).current.patches}) == 7


def test_tilts_are_against_gravity_and_what_is_free_is_said_upright():
    """Oracle: the room's own axes, gravity along its x. Mutation: the map's z taken for the vertical."""
    history = PlaneHistory(cache_key="", revision=0, steps=(suggested(PROPOSALS),), cursor=0)
    x = np.array([1.0, 0.0, 0.0])
    for patch in wire_planes(history, static=True, up=x).patches:
        assert patch.tilt_deg == pytest.approx(np.degrees(np.arccos(abs(patch.normal[0]))), abs=1e-6)
    planes = history.current
    for place, patch in enumerate(planes.patches):
        if abs(patch.normal[2]) > 0.9:
            planes = apply(planes, Drop(op="drop", index=place), proposals=PROPOSALS, grow=lambda *_: None)
    assert "up and down" in determinacy(planes, UP).text


def test_what_a_camera_sees_from_behind_is_hidden_with_all_that_hangs_on_it():
    """Oracle: a box from 0 to 4 m. Mutations: the side swapped; points of two walls sent twice."""
    walls = np.array(
        [[1.0, 0, 0, 0], [-1.0, 0, 0, 4], [0, 1.0, 0, 0], [0, -1.0, 0, 4], [0, 0, 1.0, 0], [0, 0, -1.0, 4]]
    )
    assert not hidden(walls, np.array([2.0, 2.0, 2.0])).any()
    np.testing.assert_array_equal(np.flatnonzero(hidden(walls, np.array([-3.0, 2.0, 9.0]))), [0, 5])
    xyz = np.array([[0.1, 2, 2], [2, 2, 2], [2, 2, 3.9], [4.2, 2, 2]], np.float32)
    np.testing.assert_array_equal(wall_of(xyz, walls), [0, -1, 5, 1])
    parts = pieces(Cloud("/c", xyz, uniform(4, (1, 2, 3))), walls)
    assert [wall for wall, _ in parts] == [None, 0, 1, 5]
    assert sum(len(part.xyz) for _, part in parts) == 4
    assert len({part.path for _, part in parts}) == 4


def test_walls_that_come_and_go_are_cut_from_where_one_stands():
    """A box takes planes away, nobody's camera moves. Oracle: on which side of each wall the camera is. Mutation: what is
    hidden remembered by the walls' old numbers."""
    xyz = PROPOSALS.cloud_m[::20]
    scene = ShownScene(on_patch=lambda *_: None, on_ray=lambda *_: None)
    try:
        for walls in (WALLS, WALLS[::-1], WALLS[2:], WALLS[:3]):
            cloud = Cloud("/cloud", xyz, uniform(len(xyz), (9, 9, 9)))
            scene.show(Content((cloud,), "", aim="room", stage=stage_of(UP, walls)), dark=True)
            eye_m = np.array(scene._server.initial_camera.position)
            drawn = {each.wall: each.node.visible for each in scene._nodes.values() if each.wall is not None}
            assert drawn == {wall: bool(walls[wall, :3] @ eye_m + walls[wall, 3] > -0.05) for wall in drawn}
            assert set(drawn.values()) == {True, False}
    finally:
        scene.close()


def test_planes_to_be_clicked_stay_as_glass_where_the_room_is_cut_open():
    """Every one of the six has its sheet, outline and name on the canvas, and only what is seen from behind lacks its points.

    Mutations: what is cut away has no sheet; it keeps its points; the camera stands where it sees the rest alone.
    """
    told = []
    scene = ShownScene(on_patch=told.append, on_ray=lambda *_: None)
    try:
        scene.show(build_planes(PROPOSALS, suggested(PROPOSALS), limit=20_000, up=UP), dark=True)
        eye_m = np.array(scene._server.initial_camera.position)
        cut = {int(wall) for wall in np.flatnonzero(hidden(WALLS, eye_m))}
        assert cut
        nodes = [each for each in scene._nodes.values() if each.wall is not None]
        assert {each.wall for each in nodes if isinstance(each.item, Sheet) and each.node.visible} == set(range(6))
        assert all(each.node.visible for each in nodes if not isinstance(each.item, Cloud))
        assert {each.wall for each in nodes if isinstance(each.item, Cloud) and not each.node.visible} == cut
        for each in nodes:
            if isinstance(each.item, Sheet):
                assert (each.node.opacity < each.item.opacity) == (each.wall in cut)
        seen = stand(
            PROPOSALS.cloud_m.astype(np.float64), stage_of(UP, WALLS), "overview", fov_rad=0.9, aspect=1.6, whole=True
        )
        forward = (seen.middle_m - seen.eye_m) / np.linalg.norm(seen.middle_m - seen.eye_m)
        right = np.cross(forward, UP) / np.linalg.norm(np.cross(forward, UP))
        x, y, z = np.stack([right, np.cross(right, forward), forward]) @ (PROPOSALS.cloud_m - seen.eye_m).T
        half = np.tan(0.45)
        assert np.mean((np.abs(x) < 1.6 * half * z) & (np.abs(y) < half * z)) > 0.98
    finally:
        scene.close()


def test_glass_is_looked_through_by_clicks():
    """Two squares, the nearer one seen from behind: the farther one is meant first. Mutation: glass that is
    nearest is meant.
    """
    corners = np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], dtype=np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    walls = np.array([[1.0, 0.0, 0.0, -2.0], [-1.0, 0.0, 0.0, 4.0]])  # the room is from x = 2 to x = 4
    sheets = [
        Sheet(f"/planes/{k}", corners + np.float32([x_m, 0, 0]), faces, (9, 9, 9), 0.3, patch=k, wall=k)
        for k, x_m in enumerate((2.0, 4.0))
    ]
    told = []
    scene = ShownScene(on_patch=told.append, on_ray=lambda *_: None)
    try:
        scene.show(Content(tuple(sheets), "", aim="room", stage=stage_of(UP, walls), glass=True), dark=True)
        scene._cut(np.zeros(3))
        scene._clicked(0, np.zeros(3), np.array([1.0, 0.0, 0.0]))
        assert told == [1]
        scene._clicked(0, np.zeros(3), np.array([1.0, 0.0, 0.0]))
        assert told == [1, 1, 0]  # put right again, and the glass in front
    finally:
        scene.close()


@pytest.mark.parametrize("preset", PRESETS)
def test_every_way_to_look_has_the_floor_below(preset):
    """Laws: up is up on the canvas whatever way the map is tilted; from inside nothing is hidden, from above no floor is.

    Mutations: the map's z kept as up; inside without clearance; the overview from below.
    """
    tilt = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    points, walls = PROPOSALS.cloud_m @ tilt.T, np.column_stack([WALLS[:, :3] @ tilt.T, WALLS[:, 3]])
    up = tilt @ UP
    stage = stage_of(up, walls)
    np.testing.assert_allclose(stage.R_level_scene @ stage.R_level_scene.T, np.eye(3), atol=1e-9)
    found = stand(points[::20].astype(np.float64), stage, preset, fov_rad=1.2, aspect=1.5)
    cut = hidden(walls, found.eye_m)
    down = float((found.middle_m - found.eye_m) @ up)
    floor = int(np.argmax(walls[:, :3] @ up))
    assert not cut[floor]
    if preset == "inside":
        assert not cut.any()
    elif preset == "front":
        assert abs(down) < 0.1 * np.linalg.norm(found.middle_m - found.eye_m)
    else:
        assert down < 0


def test_who_stands_inside_is_not_held_by_a_cupboard():
    """A front in the middle of the room, with the wall behind it in sight, leaves the camera where it stood without it.

    Mutation: every plane taken for the end of the room.
    """
    cloud = PROPOSALS.cloud_m.astype(np.float64)
    bare = stand(cloud, stage_of(UP, WALLS), "inside", fov_rad=0.9, aspect=1.6)
    for normal in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]):
        middle = float(np.median(cloud @ np.array(normal)))
        furnished = stage_of(UP, np.vstack([WALLS, [*normal, -middle]]))
        with_it = stand(cloud, furnished, "inside", fov_rad=0.9, aspect=1.6)
        np.testing.assert_allclose(with_it.eye_m, bare.eye_m)


def test_a_patch_is_drawn_where_it_was_seen():
    """Oracle: an L of 4 by 3 m with a quarter missing, strays far off. Mutations: the hull of all; strays kept."""
    rng = np.random.default_rng(2)
    flat = rng.uniform([0, 0], [4, 3], (9000, 2))
    flat = flat[(flat[:, 0] < 2) | (flat[:, 1] < 1.5)]
    strays = rng.uniform([5, 4], [9, 8], (6, 2))
    points = np.column_stack([np.full(len(flat) + 6, 2.0), np.concatenate([flat, strays])]).astype(np.float32)
    support = support_of(points, np.array([1.0, 0, 0, -2.0]), UP)
    corners = support.vertices[support.faces].astype(np.float64)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    cell_m = (
        4.0 / CELLS
    )  # a cell is drawn whole that is seen in part, at most one all the 14 m around; the hull has 10.5
    assert 9.0 < area < 9.0 + 14.0 * cell_m
    np.testing.assert_allclose(support.vertices[:, 0], 2.0, atol=1e-5)
    assert support.vertices.max() < 4.2
    around = np.linalg.norm(support.edges[:, 1] - support.edges[:, 0], axis=1).sum()
    assert 12 < around < 16  # 14 m around the L
    assert support_of(points[:2], np.array([1.0, 0, 0, -2.0]), UP) is None


def test_points_are_as_large_as_they_are_far_apart():
    """Oracle: a square grid. Mutation: the breadth of the cloud instead of its spacing."""
    near = np.stack(np.meshgrid(np.arange(100), np.arange(100), [0.0]), axis=-1).reshape(-1, 3).astype(np.float32)
    assert point_size_m(near * 0.02) == pytest.approx(0.016, rel=0.3)
    assert point_size_m(near * 0.02) == pytest.approx(point_size_m(np.concatenate([near, near + 3000]) * 0.02), rel=0.1)


def test_up_is_where_the_accelerometer_points_on_average():
    """Oracle: a made motion with a known vertical. Mutation: the extrinsic's rotation left out, or applied backwards."""
    t = np.arange(0, 10, 0.01)
    angle = 0.6 * np.sin(2.0 * t)
    turn = np.array([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in angle])
    R_imu_lidar = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    up = np.array([0.6, 0.0, 0.8])
    shake = 2.0 * np.cos(5.0 * t)[:, None] * np.array([1.0, 1.0, 0.0])
    accel = np.einsum("nij,nj->ni", R_imu_lidar @ turn.transpose(0, 2, 1), 9.81 * up + shake)
    recording = Recording(
        name="", imu=ImuData((t * 1e9).astype(np.int64), np.zeros((len(t), 3)), accel), scans=(), coarse_offset_ns=0
    )
    motion = Trajectory(0, t, turn, np.zeros((len(t), 3)), np.ones(len(t), bool))
    T = np.eye(4)
    T[:3, :3] = R_imu_lidar
    np.testing.assert_allclose(vertical_of(recording, motion, T, time_offset_s=0.0), up, atol=0.02)
    short = Trajectory(0, t[:100], turn[:100], np.zeros((100, 3)), np.ones(100, bool))
    assert vertical_of(recording, short, T, time_offset_s=0.0) is None
    assert Stage().up.tolist() == [0.0, 0.0, 1.0]
