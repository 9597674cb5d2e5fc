"""Where a browser looks from, and the rays through its canvas.

A place of the canvas is (u, v), shares of it from its upper left corner; in the camera's frame x is right, y down, z forward. The
ray through it is

    ((2 u - 1) tan(fov / 2) aspect, (2 v - 1) tan(fov / 2), 1)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.types import FloatArray

#: A place of the canvas.
Place = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a browser looks from. R_scene_camera: (3, 3).   p_scene_camera: (3,).

    fov_rad: vertical opening.   aspect: width over height.
    """

    R_scene_camera: FloatArray
    p_scene_camera: FloatArray
    fov_rad: float
    aspect: float

    def rays(self, places: Sequence[Place]) -> FloatArray:
        """(N, 3) directions in the scene's frame through places of the canvas, of length 1 along z of the camera."""
        half = float(np.tan(self.fov_rad / 2))
        ahead = np.array([((2 * u - 1) * half * self.aspect, (2 * v - 1) * half, 1.0) for u, v in places])
        rays: FloatArray = ahead @ self.R_scene_camera.T
        return rays
