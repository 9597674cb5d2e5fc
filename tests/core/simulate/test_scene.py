"""Ray casting against walks along each ray: solids as inequalities, faces as triangles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib_core.simulate import rooms
from calib_core.simulate.bodies import Body, Box, Cylinder, Path, Rays, Sphere
from calib_core.simulate.motion import Wave
from calib_core.simulate.scene import Face, Scene
from calib_core.types import BoolArray, FloatArray

BODIES: dict[str, Body] = {
    "box": Box("box", (0.4, -0.2, 0.3), (1.0, 0.5, 0.7), (20.0, -35.0, 50.0)),
    "cylinder": Cylinder("cylinder", (-0.3, 0.5, 0.1), 0.4, 0.9),
    "sphere": Sphere("sphere", (0.1, 0.2, -0.3), 0.6),
}


def _everywhere(rng: np.random.Generator, n: int) -> Rays:
    """Rays in all directions from where the rig is held."""
    directions = rng.standard_normal((3, n))
    origins = np.repeat([[1.2], [1.1], [0.9]], n, axis=1)
    return Rays(origins, directions / np.linalg.norm(directions, axis=0), np.zeros(n), origins, np.zeros(3))


def _rays(rng: np.random.Generator, n: int) -> Rays:
    """Rays from a shell of radius 3 m, many of them towards the middle."""
    direction = rng.standard_normal((3, n))
    origins = 3.0 * direction / np.linalg.norm(direction, axis=0)
    aim = rng.uniform(-1.2, 1.2, (3, n)) - origins
    return Rays(origins, aim / np.linalg.norm(aim, axis=0), np.zeros(n), origins, np.zeros(3))


def _inside(body: Body, points: FloatArray) -> BoolArray:
    """Whether points (3, ...) lie in the body, by its definition."""
    local = points - np.asarray(body.center_m).reshape(3, *([1] * (points.ndim - 1)))
    if isinstance(body, Box):
        turned = np.tensordot(Rotation.from_rotvec(body.rotvec_deg, degrees=True).inv().as_matrix(), local, axes=1)
        half = np.asarray(body.size_m).reshape(3, *([1] * (points.ndim - 1))) / 2.0
        return np.asarray((np.abs(turned) <= half).all(axis=0))
    if isinstance(body, Cylinder):
        return (np.hypot(local[0], local[1]) <= body.radius_m) & (np.abs(local[2]) <= body.height_m / 2.0)
    assert isinstance(body, Sphere)
    return np.linalg.norm(local, axis=0) <= body.radius_m


@pytest.mark.parametrize("name", BODIES)
def test_a_ray_stops_where_it_first_enters_the_solid(name: str) -> None:
    """Fails when the far root is taken, when a lid is missing, or when the box is turned the other way.

    The oracle walks along the ray in steps of 4 mm; it may miss only grazing hits shorter than a step.
    """
    body = BODIES[name]
    rays = _rays(np.random.default_rng(3), 1500)
    hits = Scene((), (body,)).cast(rays)
    steps = np.arange(0.0, 6.0, 0.004)
    along = rays.origins_m[:, :, None] + rays.directions[:, :, None] * steps
    inside = _inside(body, along)
    met = inside.any(axis=1)
    first = steps[np.argmax(inside, axis=1)]
    assert met.sum() > 200
    assert np.isfinite(hits.range_m[met]).all()
    assert (hits.range_m[met] <= first[met] + 1e-12).all()
    assert (hits.range_m[met] >= first[met] - 0.004).all()
    assert np.isfinite(hits.range_m[~met]).sum() < 10
    assert (hits.surface[met] == 0).all()
    assert (hits.surface[~np.isfinite(hits.range_m)] == -1).all()


@pytest.mark.parametrize("name", BODIES)
def test_cosine_of_incidence_is_that_of_the_surface(name: str) -> None:
    """Fails when a cosine is taken of the wrong axis or left unnormalised.

    The oracle casts two neighbouring rays and takes the normal of the three hits.
    """
    body = BODIES[name]
    rng = np.random.default_rng(4)
    rays = _rays(rng, 1000)
    scene = Scene((), (body,))
    rays = rays.subset(np.flatnonzero(np.isfinite(scene.cast(rays).range_m)))
    hits = scene.cast(rays)
    sides = []
    for _ in range(2):
        offset = np.cross(rays.directions.T, rng.standard_normal(3)).T * 1e-6
        moved = Rays(rays.origins_m + offset, rays.directions, rays.t_s, rays.lidar_m, rays.home_m)
        near = scene.cast(moved)
        sides.append((offset + (near.range_m - hits.range_m) * rays.directions).T)
    good = (np.linalg.norm(sides[0], axis=1) < 1e-4) & (np.linalg.norm(sides[1], axis=1) < 1e-4)
    normal = np.cross(sides[0][good], sides[1][good])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    cosine = np.abs(np.einsum("ni,in->n", normal, rays.directions[:, good]))
    assert good.sum() > 60
    assert np.mean(np.abs(cosine - hits.cos_incidence[good]) < 1e-3) > 0.97


def test_a_bounded_face_is_its_triangles() -> None:
    """Fails when the outline is ignored, when an edge's side flips, or when the back of a face is seen.

    The oracle solves for barycentric coordinates in a fan of triangles.
    """
    corners = np.array([[1.0, -1.0, 0.2], [1.5, 0.6, 0.4], [0.2, 1.3, 0.3], [-1.1, 0.4, 0.0]])
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    corners[3] -= normal * (normal @ (corners[3] - corners[0])) / (normal @ normal)
    outline = tuple((float(x), float(y), float(z)) for x, y, z in corners)
    face = Face("face", (float(normal[0]), float(normal[1]), float(normal[2])), outline[0], outline)
    rays = _rays(np.random.default_rng(5), 2000)
    hits = Scene((face,)).cast(rays)
    expected = np.full(2000, np.inf)
    for a, b, c in ((0, 1, 2), (0, 2, 3)):
        for i in range(2000):
            o, d = rays.origins_m[:, i], rays.directions[:, i]
            u, v, reach = np.linalg.solve(
                np.column_stack([corners[b] - corners[a], corners[c] - corners[a], -d]), o - corners[a]
            )
            if u >= 0 and v >= 0 and u + v <= 1 and reach > 0 and d @ normal < 0:
                expected[i] = min(expected[i], reach)
    assert np.isfinite(expected).sum() > 200
    np.testing.assert_allclose(hits.range_m, expected, rtol=1e-9)


def test_the_nearest_of_everything_wins() -> None:
    """Fails when a later surface overwrites a nearer one: with its bodies in reverse the scene must look the same."""
    room = rooms.closed_room((6.0, 5.0, 2.8), bodies=rooms.FURNISHED_ROOM.bodies)
    turned = Scene(room.faces, tuple(reversed(room.bodies)))
    rays = _everywhere(np.random.default_rng(6), 4000)
    one, other = room.cast(rays), turned.cast(rays)
    np.testing.assert_array_equal(one.range_m, other.range_m)
    bare = Scene(room.faces).cast(rays)
    assert (one.range_m <= bare.range_m).all()
    assert (one.range_m < bare.range_m).any()


def test_a_moving_body_is_where_it_is_at_each_rays_own_time() -> None:
    """Fails when the coarse look is too narrow (`wander_m` is 0) or a body stays where it was at the sweep's start.

    The oracle casts every ray alone, at a still body put where the moving one is then.
    """
    path = Path(((Wave(0.8, 0.9, 0.3),), (Wave(0.5, 1.3),), ()), carried=0.6)
    rng = np.random.default_rng(7)
    n = 600
    lidar = np.array([3.0, 0.0, 0.2])[:, None] + np.linspace(0.0, 0.12, n) * np.array([[0.3], [1.0], [-0.2]])
    aim = rng.uniform(-1.2, 1.2, (3, n)) - lidar
    home = np.array([2.9, -0.3, 0.1])
    rays = Rays(lidar, aim / np.linalg.norm(aim, axis=0), np.linspace(1.0, 1.4, n), lidar, home)
    hits = Scene((), (Sphere("ball", (0.0, 0.0, 0.0), 0.5, path=path),)).cast(rays)
    expected = np.empty(n)
    for i in range(n):
        t = rays.t_s[i]
        swing = np.array([0.8 * np.sin(2 * np.pi * 0.9 * t + 0.3), 0.5 * np.sin(2 * np.pi * 1.3 * t), 0.0])
        x, y, z = (float(v) for v in swing + 0.6 * (lidar[:, i] - home))
        expected[i] = Scene((), (Sphere("ball", (x, y, z), 0.5),)).cast(rays.subset(np.array([i]))).range_m[0]
    assert 50 < np.isfinite(expected).sum() < n - 50
    np.testing.assert_allclose(hits.range_m, expected, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_random_room_is_closed_and_nearly_square(seed: int) -> None:
    """Fails when a wall's normal points out of the room, or walls lean by more than 2 degrees from square."""
    room = rooms.random_room(np.random.default_rng(seed))
    rays = _everywhere(np.random.default_rng(8), 500)
    assert np.isfinite(room.cast(rays).range_m).all()
    for face, square in zip(room.faces, ("z", "z", "x", "y", "x", "y"), strict=True):
        assert abs(face.unit_normal["xyz".index(square)]) >= np.cos(np.deg2rad(2.0))
        assert (face.unit_normal @ rays.origins_m + face.offset_m > 0.5).all()
