"""A recording, its motions and how they are looked at, for scenes of an answer."""

from __future__ import annotations

import numpy as np

from app.scene.build import Solved
from app.scene.camera import Camera
from app.scene.inspect import Look, Motions
from tests.app.support import world

RECORDING = world.make_recording()
SOLVED = Solved(world.make_trajectory(), world.plane_quality(), [0, 1, 2, 3, 4, 5], world.transform_matrix(), 0.004)
MOTIONS = Motions(SOLVED, SOLVED.trajectory, None)
LOOK = Look(place=5, show="both", against="raw", extent="scan", color_by="plane", wipe=0.5, limit=100_000)


def seen_from_above(aspect=2.0):
    """A camera 10 m above the room, looking down, its right along the room's x: R's columns are right, down, forward."""
    R = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    return Camera(R, np.array([0.0, 0.0, 10.0]), np.pi / 2, aspect)
