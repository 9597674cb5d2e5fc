"""A rotation and a pose in the forms that people and files want."""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray

#: Cosine of the pitch below which rounding alone would tell roll from yaw.
_AT_THE_POLE = 1e-9


def transform_matrix(R: FloatArray, p: FloatArray) -> FloatArray:
    """The (4, 4) homogeneous matrix of a rotation and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def roll_pitch_yaw_rad(R: FloatArray) -> tuple[float, float, float]:
    """The angles with R = Rz(yaw) Ry(pitch) Rx(roll).   R: (3, 3).

    Looking straight up or down, roll and yaw turn about one and the same axis: all of that turn is called roll, and yaw is 0,
    as ROS has it.
    """
    level = np.hypot(R[0, 0], R[1, 0])
    pitch = np.arctan2(-R[2, 0], level)
    if level < _AT_THE_POLE:
        return float(np.arctan2(-R[1, 2], R[1, 1])), float(pitch), 0.0
    return float(np.arctan2(R[2, 1], R[2, 2])), float(pitch), float(np.arctan2(R[1, 0], R[0, 0]))


def euler_xyz_deg(R: FloatArray) -> list[float]:
    """The same as degrees."""
    return [float(np.degrees(angle)) for angle in roll_pitch_yaw_rad(R)]


def quaternion_xyzw(R: FloatArray) -> list[float]:
    """The unit quaternion of a rotation, w >= 0."""
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(R).as_quat(canonical=True)
    return [float(v) for v in q]
