"""Which way is up in the map of an answer: where the accelerometer points on average.

The IMU feels gravity and its own acceleration. Turned into the map, the latter averages to the change of speed over the
whole stretch divided by its length, which over seconds is a small part of gravity:

    up ~ mean of R_map_lidar(t) R_lidar_imu a(t)
"""

from __future__ import annotations

import numpy as np

from calib_core.types import FloatArray, Recording, Trajectory

#: Less of the motion than this says little: a metre a second gained in it tilts the mean by so many over 9.8.
LEAST_S = 3.0


def vertical_of(
    recording: Recording, trajectory: Trajectory, T_imu_lidar: FloatArray, *, time_offset_s: float
) -> FloatArray | None:
    """(3,) unit vector against gravity, map frame; None where the motion is too short to tell.   T_imu_lidar: (4, 4)."""
    times_s = trajectory.times_s[trajectory.valid]
    imu_s = (recording.imu.stamps_ns - trajectory.epoch_ns) * 1e-9 + time_offset_s
    if len(times_s) < 2 or times_s[-1] - times_s[0] < LEAST_S:
        return None
    within = (imu_s > times_s[0]) & (imu_s < times_s[-1])
    if not within.any():
        return None
    knots = np.searchsorted(trajectory.times_s, imu_s[within]).clip(0, len(trajectory.times_s) - 1)
    accel_lidar = recording.imu.accel_m_s2[within] @ T_imu_lidar[:3, :3]
    felt = np.einsum("nij,nj->i", trajectory.R_map_lidar[knots], accel_lidar)
    length = float(np.linalg.norm(felt))
    if not np.isfinite(length) or length < 1e-6:
        return None
    up: FloatArray = felt / length
    return up
