"""Rooms as they are: walls off flat, a door ajar, skirting along the foot of the walls, a window.

What is added to a wall sits around the point of it that is nearest to the lidar's first place, or its outline's middle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib_core.simulate.bodies import Body, Box
from calib_core.simulate.motion import Vector
from calib_core.simulate.scene import Face, Scene
from calib_core.simulate.uneven import Bend, Pane
from calib_core.types import FloatArray

#: Walls bend over a few metres.
_BEND_LENGTHS_M = (3.0, 8.0)
_DOOR_M, _SKIRTING_M, _WINDOW_HEIGHT_M = (0.9, 0.04, 2.0), (6.0, 0.08), 2.0
#: Beside the nearest point, so that a wall keeps its best part.
_DOOR_BESIDE_M, _WINDOW_BESIDE_M = 0.3, 0.7
#: Height of the lidar above the ground where a scene has none.
_NO_GROUND_M = 1.0


@dataclass(frozen=True, slots=True)
class Wall:
    """A face that stands. foot_m: (3,) on it at the ground.   along, normal, up: (3,) each, its own axes."""

    number: int
    foot_m: FloatArray
    along: FloatArray
    normal: FloatArray
    up: FloatArray
    length_m: float

    @property
    def R_world_wall(self) -> FloatArray:
        """(3, 3): x along, y off the wall, z up."""
        return np.stack([self.along, self.normal, self.up], axis=1)


def walls_of(scene: Scene, home_m: FloatArray) -> list[Wall]:
    """The faces that stand. home_m: (3,) the lidar's first place."""
    return [_wall(scene, number, home_m) for number, face in enumerate(scene.faces) if _stands(face)]


def _one_near(scene: Scene, home_m: FloatArray, rng: np.random.Generator) -> Wall:
    """One of the two nearest: what is far away hardly matters."""
    near = sorted(walls_of(scene, home_m), key=lambda wall: float(np.linalg.norm(wall.foot_m - home_m)))[:2]
    return near[int(rng.integers(len(near)))]


def _stands(face: Face) -> bool:
    return abs(float(face.unit_normal[2])) < 0.3


def _wall(scene: Scene, number: int, home_m: FloatArray) -> Wall:
    face = scene.faces[number]
    normal = face.unit_normal
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    up /= np.linalg.norm(up)
    along = np.cross(normal, up)
    middle = home_m - (normal @ home_m + face.offset_m) * normal
    length = _SKIRTING_M[0]
    if face.outline_m:
        corners = np.asarray(face.outline_m)
        middle, length = corners.mean(axis=0), float(np.ptp(corners @ along))
    foot = middle + (_ground_m(scene, middle, home_m) - middle[2]) / up[2] * up
    return Wall(number, foot, along, normal, up, length)


def _ground_m(scene: Scene, at_m: FloatArray, home_m: FloatArray) -> float:
    grounds = [face for face in scene.faces if face.unit_normal[2] > 0.7]
    if not grounds:
        return float(home_m[2]) - _NO_GROUND_M
    normal = grounds[0].unit_normal
    return float(-(grounds[0].offset_m + normal[:2] @ at_m[:2]) / normal[2])


def bent(scene: Scene, height_m: float, rng: np.random.Generator) -> Scene:
    """Every face off flat: two waves across it, which together reach height_m, in or out."""
    faces = []
    for face in scene.faces:
        helper = np.eye(3)[np.argmin(np.abs(face.unit_normal))]
        along = np.cross(face.unit_normal, helper)
        along /= np.linalg.norm(along)
        up = np.cross(face.unit_normal, along)
        waves = [
            (0.5 * height_m, float(rng.uniform(*_BEND_LENGTHS_M)), float(rng.uniform(0.0, 2.0 * np.pi))) for _ in "xy"
        ]
        faces.append(replace(face, bend=Bend(_vector(along), _vector(up), *waves)))
    return replace(scene, faces=tuple(faces))


def with_door(scene: Scene, home_m: FloatArray, angle_rad: float, rng: np.random.Generator) -> Scene:
    """A leaf hinged on one of the walls, open towards the room by the angle."""
    wall = _one_near(scene, home_m, rng)
    R = wall.R_world_wall @ Rotation.from_rotvec([0.0, 0.0, angle_rad]).as_matrix()
    width, _, height = _DOOR_M
    hinge = wall.foot_m + _DOOR_BESIDE_M * wall.along
    return _with(scene, _box("door", hinge + R @ [width / 2.0, 0.0, height / 2.0], _DOOR_M, R))


def with_skirting(scene: Scene, home_m: FloatArray, thickness_m: float) -> Scene:
    """A board along the foot of every wall."""
    height = _SKIRTING_M[1]
    boards = [
        _box(
            "skirting",
            wall.foot_m + height / 2.0 * wall.up,
            (wall.length_m, 2.0 * thickness_m, height),
            wall.R_world_wall,
        )
        for wall in walls_of(scene, home_m)
    ]
    return _with(scene, *boards)


def with_window(scene: Scene, home_m: FloatArray, width_m: float, rng: np.random.Generator) -> Scene:
    """A glass door in one of the walls."""
    wall = _one_near(scene, home_m, rng)
    center = wall.foot_m + 1.1 * wall.up - _WINDOW_BESIDE_M * wall.along
    half = (width_m / 2.0, _WINDOW_HEIGHT_M / 2.0)
    pane = Pane(wall.number, _vector(center), _vector(wall.along), _vector(wall.up), half)
    return replace(scene, panes=(*scene.panes, pane))


def _box(name: str, center_m: FloatArray, size_m: Vector, R: FloatArray) -> Box:
    turn = np.asarray(Rotation.from_matrix(R).as_rotvec(degrees=True))
    return Box(name, _vector(center_m), size_m, _vector(turn), 0.6)


def _with(scene: Scene, *bodies: Body) -> Scene:
    return replace(scene, bodies=(*scene.bodies, *bodies))


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
