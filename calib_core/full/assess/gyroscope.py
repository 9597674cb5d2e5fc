"""The rotation into the gyroscope's own axes: the lidar sees those turn, and knows them better than the accelerometer's.

The IMU's frame is the accelerometer's (intrinsics.py), so that its rotation is as uncertain as the accelerometer's axes are
against the gyroscope's. Software that turns by the gyroscope alone may take this one. The gyroscope reads M w with

    M = (I + S + N) Exp(r),      mean axes: the rotation in the polar decomposition of M

where N = symmetric + [a]x turns by r + a to first order, so that of R_imu_lidar = R Exp(phi), phi in the lidar's axes,

    phi_gyroscope = phi + R^T (r + a)
"""

from __future__ import annotations

import numpy as np
import scipy

from calib_core.full.joint.estimation import Solved
from calib_core.full.joint.state import ROTATION
from calib_core.full.prepare.nuisance import Nuisance
from calib_core.geometry import quaternion_xyzw
from calib_core.result import GyroscopeAxes
from calib_core.types import FloatArray

#: (3, 3) of N's yx, zx, zy: by how much they turn the mean axes.
_HALF = 0.5 * np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])

#: Nothing is known of a rotation beyond a radian.
_UNKNOWN_RAD = 1.0


def gyroscope_axes(solved: Solved, stated: FloatArray) -> GyroscopeAxes | None:
    """Of a solve that estimated how the two are turned; None where it did not, or knows no rotation.

    stated: (7, 7) SI, covariance of the answer. What parts of the recording disagree about beyond noise counts here as it does
    there.
    """
    sensors = solved.nuisance.sensors
    if not {"gyroscope_rotation", "gyroscope_axes"} & sensors.places.keys():
        return None
    turned, plain = gyroscope_covariance(solved, sensors)
    values, vectors = np.linalg.eigh(stated[ROTATION, ROTATION] - plain)
    turned = turned + vectors @ (np.maximum(values, 0.0)[:, None] * vectors.T)
    if np.sqrt(np.diag(turned).max()) > _UNKNOWN_RAD:
        return None
    matrix = solved.estimate.sensors.imu().gyro
    R = scipy.linalg.polar(matrix)[0] @ solved.estimate.R_imu_lidar
    return GyroscopeAxes(
        quaternion_xyzw=quaternion_xyzw(R), rotation_std_deg=np.degrees(np.sqrt(np.diag(turned))).tolist()
    )


def gyroscope_covariance(solved: Solved, sensors: Nuisance) -> tuple[FloatArray, FloatArray]:
    """(3, 3) of the rotation into the gyroscope's axes and of that into the accelerometer's, about the lidar's, of noise and
    priors alone [rad2]."""
    assert solved.minimum.solution is not None
    every = solved.minimum.solution.covariance.matrix
    start, R = solved.problem.layout(solved.estimate).nuisance().start, solved.estimate.R_imu_lidar
    turn = np.zeros((3, len(every)))
    turn[:, ROTATION] = np.eye(3)
    for block, share in (("gyroscope_rotation", np.eye(3)), ("gyroscope_axes", _HALF)):
        if (place := sensors.places.get(block)) is not None:
            turn[:, start + place.start : start + place.stop] = R.T @ share
    return turn @ every @ turn.T, every[ROTATION, ROTATION]
