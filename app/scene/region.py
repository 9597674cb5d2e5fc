"""What a rectangle on the screen takes in: the pyramid between four planes through the camera."""

from __future__ import annotations

import numpy as np

from app.scene.camera import Camera, Place
from calib_core.types import FloatArray

#: A rectangle narrower than this part of the canvas is a click that slipped.
LEAST_SCREEN = 0.01


def frustum_sides(camera: Camera, low: Place, high: Place) -> FloatArray | None:
    """(4, 4) half-spaces (nx, ny, nz, w), scene frame, that keep what is seen in the rectangle; None for a slipped click.

    low, high: upper left and lower right corner of the rectangle.
    """
    if high[0] - low[0] < LEAST_SCREEN or high[1] - low[1] < LEAST_SCREEN:
        return None
    rays = camera.rays([low, (high[0], low[1]), high, (low[0], high[1])])
    normals = np.cross(rays, np.roll(rays, -1, axis=0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign(normals @ rays.mean(axis=0))[:, None]
    sides: FloatArray = np.column_stack([normals, -normals @ camera.p_scene_camera])
    return sides
