"""What a rectangle on the screen takes in: the pyramid between four planes through the camera."""

from __future__ import annotations

import numpy as np

from app.scene.wipe import Camera
from calib_core.types import FloatArray

#: A rectangle narrower than this part of the canvas is a click that slipped.
LEAST_SCREEN = 0.01

Corner = tuple[float, float]


def frustum_sides(camera: Camera, low: Corner, high: Corner) -> FloatArray | None:
    """(4, 4) half-spaces (nx, ny, nz, w), scene frame, that keep what is seen in the rectangle; None for a slipped click.

    low, high: corners of the rectangle, 0..1 from the top left of the canvas.
    """
    if high[0] - low[0] < LEAST_SCREEN or high[1] - low[1] < LEAST_SCREEN:
        return None
    half = np.tan(camera.fov_rad / 2)
    around = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    rays = np.array([((2 * u - 1) * half * camera.aspect, (2 * v - 1) * half, 1.0) for u, v in around])
    rays = rays @ camera.R_scene_camera.T
    normals = np.cross(rays, np.roll(rays, -1, axis=0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals *= np.sign(normals @ rays.mean(axis=0))[:, None]
    sides: FloatArray = np.column_stack([normals, -normals @ camera.p_scene_camera])
    return sides
