"""The scenes of the scenarios, as data, and rooms drawn at random for tests. World frame: z up, metres."""

from __future__ import annotations

import numpy as np

from calib_core.simulate import furniture
from calib_core.simulate.bodies import Body, Box, Cylinder
from calib_core.simulate.motion import Vector
from calib_core.simulate.scene import Face, Scene


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

#: The paper's room lived in: things along the far walls, and whoever holds the rig standing behind it.
_FURNITURE = furniture.standing(
    (
        furniture.table(4.6, 2.2, 12.0),
        furniture.chair(3.9, 3.1, 40.0),
        furniture.chair(5.4, 1.3, -120.0),
        furniture.cabinet(3.2, 5.1),
        furniture.cabinet(6.3, 4.2, 90.0),
        furniture.lamp(0.5, 4.8),
        furniture.plant(5.9, 0.6),
    )
)
FURNISHED_ROOM = closed_room(
    (6.6, 5.4, 2.7),
    lean_deg=((0.2, -0.3), (-0.4, 0.3), (0.9, 0.6), (-0.5, -1.1), (1.2, -0.8), (-0.6, 0.9)),
    bodies=(*_FURNITURE, *furniture.person(1.86, 1.80, carried=0.7)),
)

#: The same room for a lidar that looks one way: a plant and a bin stand in its view, nobody does.
ROOM_AHEAD = Scene(
    FURNISHED_ROOM.faces,
    (*_FURNITURE, *furniture.plant(0.45, 1.7), Cylinder("bin", (1.6, 0.35, 0.2), 0.15, 0.4, 0.6)),
)

WALKED_ROOM = Scene(PAPER_ROOM.faces, furniture.person(1.25, 1.25, walk=furniture.circling(0.88, 12.0)))


def wall(name: str, normal: Vector, corner_m: Vector, along_m: Vector, up_m: Vector, reflectivity: float = 0.5) -> Face:
    """A parallelogram with a corner and two edges."""
    corner, along, up = np.asarray(corner_m), np.asarray(along_m), np.asarray(up_m)
    outline = tuple(_vector(corner + a * along + u * up) for a, u in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return Face(name, normal, corner_m, outline, reflectivity)


def _upright(name: str, start_m: tuple[float, float], end_m: tuple[float, float], height_m: float) -> Face:
    """A vertical wall from one point of the ground plan to another; seen from the left of that walk."""
    dx, dy = end_m[0] - start_m[0], end_m[1] - start_m[1]
    return wall(name, (-dy, dx, 0.0), (*start_m, 0.0), (dx, dy, 0.0), (0.0, 0.0, height_m))


#: Three panels that stand free in the open: whoever turns away sees none of them, only things further off.
FREE_CORNER = Scene(
    faces=(
        wall("floor", (0.004, -0.006, 1.0), (0.0, 0.0, 0.0), (1.5, 0.0, -0.006), (0.0, 1.5, 0.009), 0.4),
        wall("panel west", (1.0, 0.012, 0.0), (0.0, 0.0, 0.0), (-0.0312, 2.6, 0.0), (0.0, 0.0, 2.4), 0.6),
        wall("panel south", (-0.009, 1.0, 0.0), (0.0, 0.0, 0.0), (2.6, 0.0234, 0.0), (0.0, 0.0, 2.4), 0.6),
    ),
    bodies=furniture.standing(
        (
            furniture.plant(4.5, 2.2, 1.6),
            furniture.lamp(3.6, 4.4),
            furniture.chair(5.2, 4.1),
            furniture.plant(2.1, 5.6, 1.3),
            furniture.tree(8.5, 6.0, 5.0),
            furniture.tree(6.0, 10.0, 6.0),
        )
    ),
)

#: The outer corner of a building on a sloping terrace, with open country below.
BUILDING_CORNER = Scene(
    faces=(
        wall("ground", (0.014, 0.021, 1.0), (-9.0, -11.5, 0.3675), (17.5, 0.0, -0.245), (0.0, 19.5, -0.4095), 0.15),
        wall("facade east", (1.0, 0.0, 0.0), (0.0, -11.0, -0.6), (0.0, 11.0, 0.0), (0.0, 0.0, 9.0), 0.45),
        wall("facade north", (0.02, 1.0, 0.0), (-9.0, 0.18, -0.6), (9.0, -0.18, 0.0), (0.0, 0.0, 9.0), 0.45),
    ),
    bodies=furniture.standing(
        (
            furniture.tree(9.0, 3.5),
            furniture.tree(-4.0, 9.5, 7.5),
            furniture.car(6.5, -6.0, 85.0),
            furniture.person(4.05, 3.65, carried=0.7),
            (Cylinder("lamp post", (4.0, 7.0, 2.5), 0.07, 5.0, 0.4),),
        )
    ),
)

#: Under a roof: no two faces at right angles but the floor and its knee walls.
ATTIC = Scene(
    faces=(
        Face("floor", (0.0, 0.004, 1.0), (0.0, 0.0, 0.0), reflectivity=0.4),
        Face("roof west", (0.788, 0.02, -0.616), (0.0, 2.5, 0.75)),
        Face("roof east", (-0.643, -0.03, -0.766), (5.0, 2.5, 0.95)),
        Face("gable south", (0.17, 0.985, 0.0), (2.5, 0.0, 1.0)),
        Face("gable north", (-0.259, -0.966, -0.02), (2.5, 5.6, 1.0)),
        Face("knee wall west", (1.0, 0.03, 0.0), (0.0, 2.5, 0.3)),
        Face("knee wall east", (-1.0, 0.05, 0.0), (5.0, 2.5, 0.3)),
    ),
    bodies=furniture.standing(
        (
            (Cylinder("chimney", (3.3, 3.9, 1.4), 0.3, 2.8, 0.5),),
            (Box("trunk", (3.9, 1.2, 0.3), (1.0, 0.5, 0.6), (0.0, 0.0, 30.0)),),
            furniture.lamp(1.0, 4.7),
        )
    ),
)

#: An open parking deck, 40 x 36 m, walled all round.
CAR_PARK = Scene(
    faces=(
        Face("deck", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), reflectivity=0.2),
        _upright("wall south", (-20.0, -18.2), (20.0, -17.9), 3.2),
        _upright("wall east", (20.0, -17.9), (19.8, 18.0), 3.2),
        _upright("wall north", (19.8, 18.0), (-20.1, 18.3), 3.2),
        _upright("wall west", (-20.1, 18.3), (-20.0, -18.2), 3.2),
    ),
    bodies=furniture.standing(
        (
            furniture.car(-14.0, -15.0, 90.0),
            furniture.car(-8.5, -15.2, 90.0),
            furniture.car(13.0, 15.0, 88.0),
            furniture.car(17.0, -4.0, 2.0),
            furniture.pillar(0.0, 11.0, 3.2),
            furniture.pillar(0.0, -11.0, 3.2),
            furniture.pillar(-14.5, 9.0, 3.2),
            furniture.person(12.0, 9.5, walk=furniture.circling(2.0, 14.0)),
        )
    ),
)
