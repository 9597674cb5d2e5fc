"""Rotations and rigid transforms; knows NumPy only."""

from calib_core.geometry.axes import plane_axes
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
    "exp",
    "hat",
    "log",
    "mean_rotation",
    "nearest_rotation",
    "plane_axes",
    "right_jacobian",
    "right_jacobian_inverse",
]
