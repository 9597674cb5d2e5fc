"""Places that a rig is carried through, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bench.worlds.shapes import Shape, box, cylinder, rectangle
from calib_core.types import FloatArray

Rng = np.random.Generator


@dataclass
class Place:
    """start_m: (3,) where the rig begins.   free_m: it is not carried further away, to any side.   shapes: what there is."""

    start_m: FloatArray
    free_m: float = 1.0
    shapes: list[Shape] = field(default_factory=list)


def room(rng: Rng, boxes: int = 4) -> Place:
    """A room that stands askew, with boxes and posts that leave the middle free."""
    w, d, h = rng.uniform(4.2, 9), rng.uniform(4.2, 9), rng.uniform(2.4, 3.5)
    place = Place(np.array([0.0, 0.0, 1.3]), shapes=box((0, 0, h / 2), (w, d, h), rng.uniform(0, 1)))
    for _ in range(boxes):
        size = rng.uniform([0.3, 0.3, 0.3], [1.5, 1.2, 2.0])
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(0.35, 1.1)
        x, y = away * w / 2 * np.cos(angle), away * d / 2 * np.sin(angle)
        if np.hypot(x, y) > 1.15 + np.hypot(*size[:2]) / 2 or size[2] < 0.4:
            place.shapes += box((x, y, size[2] / 2), size.tolist(), rng.uniform(0, 3))
    for _ in range(boxes // 4):
        angle = rng.uniform(0, 2 * np.pi)
        place.shapes.append(cylinder(1.6 * np.cos(angle), 1.6 * np.sin(angle), rng.uniform(0.05, 0.3), 1.2))
    return place


def office(rng: Rng) -> Place:
    """A room full of boxes: more clutter than wall."""
    return room(rng, boxes=22)


def attic(rng: Rng) -> Place:
    """A room under a slanting roof."""
    place = room(rng)
    slope = rng.uniform(0.3, 0.7)
    place.shapes.append(rectangle((0, 0, 2.4), (8, 0, 8 * slope), (0, 8, 0)))
    return place


def l_shape(rng: Rng) -> Place:
    """Two corridors that meet, one wall of each out of sight of the other."""
    h = rng.uniform(2.4, 3.2)
    shapes: list[Shape] = [rectangle((0, 0, z), (8, 0, 0), (0, 8, 0)) for z in (0, h)]
    corners = np.array([(-2, -2), (6, -2), (6, 2), (2, 2), (2, 7), (-2, 7)], float)
    for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        middle, half = (one + other) / 2, (other - one) / 2
        shapes.append(rectangle((*middle, h / 2), (*half, 0), (0, 0, h / 2)))
    for _ in range(5):
        size = rng.uniform(0.3, 0.8, 2)
        shapes += box((rng.uniform(2, 5.5), rng.uniform(-1.7, 1.5), 0.4), (*size, 0.8), rng.uniform(0, 3))
    return Place(np.array([0.0, 0.0, 1.3]), shapes=shapes)


def corridor(rng: Rng) -> Place:
    """Door after door."""
    w, length = rng.uniform(1.8, 3), rng.uniform(12, 40)
    shapes = box((0, 0, 1.3), (length, w, 2.6))
    for x in np.arange(-length / 2 + 2, length / 2, 3.1):
        shapes += box((x, w / 2 - 0.1, 1.0), (1.0, 0.25, 2.0))
    return Place(np.array([0.0, 0.0, 1.2]), 0.6, shapes)


def street(rng: Rng) -> Place:
    """Facades that nearly line up, poles, parked cars, no ceiling."""
    shapes: list[Shape] = [rectangle((0, 0, 0), (80, 0, 0), (0, 80, 0))]
    for side in (-1.0, 1.0):
        x = -50.0
        while x < 50.0:
            length = rng.uniform(8, 20)
            y = side * (rng.uniform(7, 12) + 5)
            shapes += box((x + length / 2, y, rng.uniform(4, 8)), (length, 10, 16), rng.uniform(-0.03, 0.03))
            x += length + rng.uniform(0, 4)
    for _ in range(10):
        y = rng.uniform(4, 6) * rng.choice([-1, 1])
        shapes.append(cylinder(rng.uniform(-40, 40), y, rng.uniform(0.08, 0.3), 5.0))
    for _ in range(8):
        shapes += box((rng.uniform(-40, 40), rng.uniform(3.5, 5) * rng.choice([-1, 1]), 0.75), (4.3, 1.8, 1.5))
    return Place(np.array([0.0, 0.0, 1.7]), 2.5, shapes)


def hall(rng: Rng) -> Place:
    """A gable roof on columns, machines on the floor."""
    w, d, h = rng.uniform(15, 35), rng.uniform(12, 25), rng.uniform(5, 9)
    shapes: list[Shape] = [rectangle((0, 0, 0), (w, 0, 0), (0, d, 0))]
    shapes += [rectangle((x, 0, h / 2), (0, d / 2, 0), (0, 0, h / 2)) for x in (w / 2, -w / 2)]
    shapes += [rectangle((0, y, h / 2), (w / 2, 0, 0), (0, 0, h / 2)) for y in (d / 2, -d / 2)]
    slope = rng.uniform(0.15, 0.4)
    shapes += [
        rectangle((0, side * d / 4, h + d / 4 * slope), (w / 2, 0, 0), (0, d / 4, -side * d / 4 * slope))
        for side in (-1, 1)
    ]
    for x in np.arange(-w / 2 + 3, w / 2, 5):
        for y in (-d / 4, d / 4):
            shapes += box((x, y, h / 2), (0.4, 0.4, h))
    for _ in range(8):
        x, y, size = rng.uniform(-w / 3, w / 3), rng.uniform(-d / 3, d / 3), rng.uniform(0.8, [3, 2])
        if np.hypot(x, y) > 2.4 + np.hypot(*size) / 2:
            shapes += box((x, y, 0.8), (*size, 1.6), rng.uniform(0, 3))
    return Place(np.array([0.0, 0.0, 1.5]), 2.2, shapes)


def stairs(rng: Rng) -> Place:
    """Ten steps up in a high room."""
    shapes = box((0, 0, 3 - 0.01), (5, 6, 6))
    for step in range(10):
        height = 0.17 * (step + 1)
        shapes += box((1.6, -2.6 + 0.28 * step, height / 2), (1.4, 0.28, height))
    for _ in range(4):
        size = rng.uniform(0.3, 0.9, 2)
        shapes += box((rng.uniform(-2, 0), rng.uniform(-2.5, 2.5), 0.5), (*size, 1.0), rng.uniform(0, 3))
    return Place(np.array([-0.4, 0.0, 1.4]), shapes=shapes)


def tent(rng: Rng) -> Place:
    """Five leaning walls, no right angle anywhere."""
    shapes: list[Shape] = [rectangle((0, 0, 0), (9, 0, 0), (0, 9, 0))]
    for k in range(5):
        angle = 2 * np.pi * k / 5 + rng.uniform(-0.2, 0.2)
        normal = np.array([np.cos(angle), np.sin(angle), rng.uniform(0.1, 0.5)])
        u = np.cross(normal, [0, 0, 1])
        u /= np.linalg.norm(u)
        v = np.cross(normal / np.linalg.norm(normal), u)
        shapes.append(rectangle((3.2 * np.cos(angle), 3.2 * np.sin(angle), 1.2), (4 * u).tolist(), (3.5 * v).tolist()))
    return Place(np.array([0.0, 0.0, 1.2]), 1.4, shapes)


PLACES: dict[str, Callable[[Rng], Place]] = {
    "room": room,
    "office": office,
    "attic": attic,
    "l-shape": l_shape,
    "corridor": corridor,
    "street": street,
    "hall": hall,
    "stairs": stairs,
    "tent": tent,
}
