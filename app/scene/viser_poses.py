"""Poses as viser has them, quaternions with the scalar first, and as we have them. Nothing else converts."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from app.scene.camera import Camera
from calib_core.types import FloatArray


def quat_wxyz(rotation: FloatArray) -> tuple[float, float, float, float]:
    """The quaternion of a rotation matrix (3, 3) in viser's order, scalar first."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = (float(part) for part in Rotation.from_matrix(rotation).as_quat())
    return w, x, y, z


def rotation_matrix(wxyz: NDArray[np.float64]) -> FloatArray:
    """The rotation (3, 3) of a quaternion in viser's order."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = wxyz
    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix(), dtype=np.float64)


def camera_of(camera: viser.CameraHandle) -> Camera:
    """Where a browser looks from, as viser tells it."""
    return Camera(
        R_scene_camera=rotation_matrix(camera.wxyz),
        p_scene_camera=np.array(camera.position, dtype=np.float64),
        fov_rad=float(camera.fov),
        aspect=float(camera.aspect),
    )
