"""The scenes of the scenarios, as data, and rooms drawn at random for tests. World frame: z up, metres."""

from __future__ import annotations

import numpy as np

from calib_core.simulate.motion import Vector
from calib_core.simulate.scene import Body, Box, Face, Scene


def closed_room(
    size_m: Vector,
    lean_deg: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 6,
    bodies: tuple[Body, ...] = (),
) -> Scene:
    """A room with one corner at the origin, reaching to `size_m`; each wall leans by two angles of `lean_deg`.

    Faces in the order floor, ceiling, wall x=0, wall y=0, far wall x, far wall y.
    """
    x, y, z = size_m
    plain: tuple[tuple[str, int, float, float], ...] = (
        ("floor", 2, 1.0, 0.0),
        ("ceiling", 2, -1.0, z),
        ("wall west", 0, 1.0, 0.0),
        ("wall south", 1, 1.0, 0.0),
        ("wall east", 0, -1.0, x),
        ("wall north", 1, -1.0, y),
    )
    middle = np.array([x / 2.0, y / 2.0, z / 2.0])
    faces = []
    for (name, axis, sign, at), lean in zip(plain, lean_deg, strict=True):
        normal, point = np.zeros(3), middle.copy()
        normal[axis], point[axis] = sign, at
        normal[(axis + 1) % 3], normal[(axis + 2) % 3] = np.tan(np.deg2rad(lean))
        reflectivity = 0.3 if name == "floor" else 0.6
        faces.append(Face(name, _vector(normal), _vector(point), reflectivity=reflectivity))
    return Scene(tuple(faces), bodies)


def random_room(rng: np.random.Generator, n_bodies: int = 4) -> Scene:
    """A closed room of 4-8 x 4-7 x 2.4-3.2 m with walls within 2 degrees of orthogonal and boxes on its floor.

    The corner at the origin and 2.2 m around it stay free: that is where the rig moves.
    """
    size = (float(rng.uniform(4.0, 8.0)), float(rng.uniform(4.0, 7.0)), float(rng.uniform(2.4, 3.2)))
    lean = tuple((float(a), float(b)) for a, b in rng.uniform(-1.4, 1.4, (6, 2)))
    bodies = []
    for number in range(n_bodies):
        box = rng.uniform((0.3, 0.3, 0.4), (0.8, 0.8, 1.2))
        x, y = rng.uniform(2.8, size[0] - 0.6), rng.uniform(2.8, size[1] - 0.6)
        turn = float(rng.uniform(0.0, 90.0))
        bodies.append(Box(f"box {number}", (float(x), float(y), float(box[2] / 2.0)), _vector(box), (0.0, 0.0, turn)))
    return closed_room(size, lean, tuple(bodies))


def _vector(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))


PAPER_ROOM = closed_room(
    (6.0, 5.0, 2.8),
    lean_deg=((0.3, -0.4), (-0.5, 0.2), (1.1, -0.7), (-0.9, 0.6), (0.8, 1.2), (-1.3, -0.5)),
)
