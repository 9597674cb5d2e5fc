"""A rotation and a pose in the forms that people and files want."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray


def transform_matrix(R: FloatArray, p: FloatArray) -> FloatArray:
    """The (4, 4) homogeneous matrix of a rotation and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def euler_xyz_deg(R: FloatArray) -> list[float]:
    """Roll, pitch, yaw of R = Rz(yaw) Ry(pitch) Rx(roll) [deg]; roll 0 where pitch is at its pole."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        roll, yaw = 0.0, np.arctan2(-R[0, 1], R[1, 1])
    else:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    return [float(np.degrees(a)) for a in (roll, pitch, yaw)]


def quaternion_xyzw(R: FloatArray) -> list[float]:
    """The unit quaternion of a rotation, w >= 0."""
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(R).as_quat(canonical=True)
    return [float(v) for v in q]
