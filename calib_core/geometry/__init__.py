"""Rotations and rigid transforms; knows NumPy only."""

from calib_core.geometry.axes import plane_axes
from calib_core.geometry.forms import euler_xyz_deg, quaternion_xyzw, roll_pitch_yaw_rad, transform_matrix
from calib_core.geometry.so3 import (
    cross,
    exp,
    hat,
    log,
    mean_rotation,
    nearest_rotation,
    right_jacobian,
    right_jacobian_inverse,
)

__all__ = [
    "cross",
    "euler_xyz_deg",
    "exp",
    "hat",
    "log",
    "mean_rotation",
    "nearest_rotation",
    "plane_axes",
    "quaternion_xyzw",
    "right_jacobian",
    "right_jacobian_inverse",
    "roll_pitch_yaw_rad",
    "transform_matrix",
]
