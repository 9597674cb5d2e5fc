"""The accumulated room: a box that is known, laid together from scans of a lidar that moves through it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_core import api
from calib_core.errors import InputError
from calib_core.maps.accumulate import MAP_DTYPE, RoomMap, accumulate
from calib_core.maps.room import Room, room_of
from calib_core.maps.surface import Mesh, mesh_of, without_strays
from calib_core.simulate import SCENARIOS, generate
from calib_core.simulate.sensors import VLP_16, Spinning
from calib_core.types import POINT_DTYPE, FloatArray, Scan, Trajectory

HALF_M = 2.0


def box_scans(n_scans: int = 12, n_points: int = 4000) -> tuple[list[Scan], Trajectory]:
    """A cube of 4 m seen from inside, without noise, from a place that moves along x; ring is the face's number."""
    rng = np.random.default_rng(3)
    R = np.broadcast_to(np.eye(3), (2, 3, 3)).copy()
    motion = Trajectory(1000, np.array([0.0, 2.0]), R, np.array([[-0.5, 0, 0], [0.5, 0, 0]]), np.ones(2, bool))
    scans = []
    for k in range(n_scans):
        face = rng.integers(0, 6, n_points)
        xyz = rng.uniform(-HALF_M, HALF_M, (n_points, 3))
        xyz[np.arange(n_points), face % 3] = np.where(face < 3, -HALF_M, HALF_M)
        points = np.zeros(n_points, POINT_DTYPE)
        points["offset_ns"] = np.arange(n_points) * 20_000
        time_s = k * 0.1 + points["offset_ns"] * 1e-9
        points["xyz"] = xyz - np.outer(-0.5 + 0.5 * time_s, [1.0, 0, 0])
        points["ring"], points["intensity"] = face, face * 10.0
        scans.append(Scan(k, 1000 + k * 100_000_000, points))
    return scans, motion


def test_each_voxel_keeps_one_return_as_it_was() -> None:
    """Mutations: the mean of a voxel's points; the last return; time without the offset in the scan."""
    scans, motion = box_scans()
    room = accumulate(scans, motion, 0.1)
    cells = np.floor(room.xyz_m.astype(np.float64) / 0.1).astype(int)
    assert len(np.unique(cells, axis=0)) == len(room.points) > 5000
    faces = room.points["ring"]
    side = np.where(faces < 3, -HALF_M, HALF_M)
    np.testing.assert_allclose(room.xyz_m[np.arange(len(faces)), faces % 3], side, atol=1e-5)
    np.testing.assert_array_equal(room.points["intensity"], faces * 10.0)
    assert (np.diff(room.points["time"]) >= 0).all()
    assert room.points["time"].max() > 1.1


def test_a_stray_goes_and_normals_look_at_the_lidar() -> None:
    """Mutations: keep the outliers instead; turn every normal away; normals at the lidar's first place only."""
    scans, motion = box_scans()
    room = accumulate(scans, motion, 0.1)
    stray = np.zeros(1, MAP_DTYPE)
    stray["x"], stray["z"] = 0.3, 0.4
    cleaned = without_strays(RoomMap(np.concatenate([room.points, stray]), 0.1))
    assert not ((np.abs(cleaned.xyz_m) < 1.0).all(axis=1)).any()
    assert len(cleaned.points) > 0.9 * len(room.points)
    whole = room_of(scans, motion, 0.1)
    inner = (np.sort(np.abs(whole.cloud.xyz_m), axis=1)[:, 1] < HALF_M - 0.3) & (
        np.abs(whole.normals).max(axis=1) > 0.99
    )
    faces = whole.cloud.points["ring"]
    towards = np.where(faces < 3, 1.0, -1.0)
    assert inner.mean() > 0.6
    assert (whole.normals[np.arange(len(faces)), faces % 3] * towards > 0.9)[inner].all()


def test_the_mesh_lies_on_the_box_and_only_where_it_was_seen() -> None:
    """Mutation: keep what the Poisson surface invents (the ceiling is never seen here)."""
    scans, motion = box_scans()
    whole = room_of(scans, motion, 0.1)
    seen = whole.cloud.points["ring"] != 5
    below = Room(RoomMap(whole.cloud.points[seen], 0.1), whole.normals[seen])
    mesh = mesh_of(below.cloud, below.normals)
    assert len(mesh.triangles) > 2000
    assert mesh.triangles.max() < len(mesh.vertices_m)
    assert mesh.vertices_m[:, 2].max() < HALF_M + 0.15
    ceiling = (mesh.vertices_m[:, 2] > HALF_M - 0.05) & (np.abs(mesh.vertices_m[:, :2]).max(axis=1) < HALF_M - 0.3)
    assert not ceiling.any()
    off_m = np.abs(np.abs(mesh.vertices_m).max(axis=1) - HALF_M)
    assert np.percentile(off_m, 95) < 0.05


def test_a_clump_in_mid_air_gets_no_surface() -> None:
    """A fist's width of points that strays make between them. Mutation: every piece of surface kept."""
    scans, motion = box_scans()
    whole = room_of(scans, motion, 0.1)
    direction = np.random.default_rng(5).normal(size=(12, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    clump = np.zeros(12, MAP_DTYPE)
    for axis, name in enumerate("xyz"):
        clump[name] = 0.08 * direction[:, axis]
    cloud = RoomMap(np.concatenate([whole.cloud.points, clump]), 0.1)
    mesh = mesh_of(cloud, np.concatenate([whole.normals, direction.astype(np.float32)]))
    assert len(mesh.triangles) > 2000
    assert not (np.abs(mesh.vertices_m).max(axis=1) < 1.0).any()


def test_a_light_mesh_lies_on_the_walls_of_a_simulated_room() -> None:
    """A lidar with 15 mm of noise, laid by its true motion: flat where the room is. Oracle: the simulator's planes.

    What is seen is judged by its area: flat parts need few corners, so those there are stand at edges. Mutations: no
    decimation; points left where the sweeps were published; an octree three times as coarse; the noise left in the points
    (half of the surface is aslant by 3 deg); what bulges out past the rims kept.
    """
    pattern = VLP_16.pattern
    assert isinstance(pattern, Spinning)
    lidar = replace(VLP_16, pattern=replace(pattern, column_period_ns=4 * pattern.column_period_ns))
    recording, truth = generate(replace(SCENARIOS["paper-normal"], lidar=lidar, duration_s=6.0), seed=2)
    times_s = 0.01 * np.arange(1, 598)
    R, p = truth.map_lidar(times_s)
    motion = Trajectory(truth.epoch_ns, times_s, R, p, np.ones(len(times_s), bool))
    room = room_of(recording.scans[1:-1:2], motion, 0.1)
    mesh = api.room_mesh(room, triangles=3000)
    assert 1000 < len(mesh.triangles) <= 3000
    planes = np.array([(*plane.normal, plane.offset_m) for plane in truth.planes])
    assert np.abs(mesh.vertices_m @ planes[:, :3].T + planes[:, 3]).min(axis=1).max() < 0.12
    place_m, normal = spread_over(mesh)
    off_m = np.abs(place_m @ planes[:, :3].T + planes[:, 3])
    assert np.percentile(off_m.min(axis=1), 95) < 0.03
    along = np.abs(np.sum(normal * planes[off_m.argmin(axis=1), :3], axis=1))
    assert np.degrees(np.arccos(np.median(along))) < 1.0
    # It goes as far as the points do: a plane aslant to the grid is in up to 1.7 cells for each cell's area of it.
    a, b, c = (mesh.vertices_m[mesh.triangles[:, corner]] for corner in range(3))
    area_m2 = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    cells = np.unique(np.floor(room.cloud.xyz_m / 0.2), axis=0)
    assert 0.5 * 0.04 * len(cells) < area_m2 < 1.1 * 0.04 * len(cells)


def spread_over(mesh: Mesh, count: int = 20_000) -> tuple[FloatArray, FloatArray]:
    """Places (count, 3), as many in each square metre, and the unit normals there (count, 3)."""
    a, b, c = (mesh.vertices_m[mesh.triangles[:, corner]].astype(np.float64) for corner in range(3))
    twice = np.cross(b - a, c - a)
    area = np.linalg.norm(twice, axis=1)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    across, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    place = (1 - across) * a[chosen] + across * (1 - along) * b[chosen] + across * along * c[chosen]
    return place, twice[chosen] / area[chosen, None]


def test_what_gives_no_room_is_one_sentence() -> None:
    """Mutations: an empty map written; a mesh of three points asked of Open3D."""
    scans, motion = box_scans(1)
    bridged = Trajectory(motion.epoch_ns, motion.times_s, motion.R_map_lidar, motion.p_map_lidar, np.zeros(2, bool))
    with pytest.raises(InputError, match=r"one map.*without a map\.$"):
        room_of(scans, bridged, 0.1)
    few = RoomMap(np.zeros(3, MAP_DTYPE), 0.1)
    with pytest.raises(InputError, match=r"at least 100 points"):
        api.room_mesh(Room(few, np.zeros((3, 3), np.float32)))


def test_the_fields_of_a_written_map() -> None:
    """Mutation: normals in front, so that x y z are no longer first."""
    scans, motion = box_scans(4)
    room = room_of(scans, motion, 0.2)
    names = room.with_normals().dtype.names
    assert names == ("x", "y", "z", "intensity", "time", "ring", "normal_x", "normal_y", "normal_z")
    np.testing.assert_array_equal(room.with_normals()["normal_z"], room.normals[:, 2])
