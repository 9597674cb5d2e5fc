"""The wipe: an upright line across the canvas, one cloud left of it, another right of it, as in a photo editor.

viser draws one scene for all, so the cut is made here: with the pose of the camera that moved last, each point's place
on the canvas decides whether it is kept, in the camera's frame (camera.py):

    u = 1/2 + x / (2 z tan(fov / 2) aspect)          0 at the canvas's left edge, 1 at its right
"""

from __future__ import annotations

import numpy as np

from app.scene.camera import Camera
from calib_core.types import BoolArray, Float32Array


def left_of(points_m: Float32Array, camera: Camera, share: float) -> BoolArray:
    """Which points (N, 3) are drawn left of the line at `share` of the canvas's width; (N,)."""
    seen = (points_m - camera.p_scene_camera.astype(np.float32)) @ camera.R_scene_camera.astype(np.float32)
    half = np.tan(camera.fov_rad / 2) * camera.aspect
    # Multiplied out, so that points beside or behind the camera divide by nothing.
    left: BoolArray = seen[:, 0] < (2.0 * share - 1.0) * half * seen[:, 2]
    return left
