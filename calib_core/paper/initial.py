"""Start values: what follows from the rough scan poses (eq. 13) and the gyroscope.

The paper says where the lidar poses come from and leaves the rest to the reader. Here: the time shift is the one at
which the lidar's and the gyroscope's turning agree in magnitude, which needs no extrinsic; the extrinsic rotation is
the one that makes them agree as vectors; the lever arm starts at zero; the world's vertical is the specific force of
the first scan, when the sensors stand still; positions follow from the scan poses and velocities from their
differences.

A rough pose holds at the mean time of the points that gave it, not at the scan's first point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.geometry import exp, log, nearest_rotation
from calib_core.paper.lidar_factor import CalibrationState
from calib_core.paper.records import ImuStates, TrackedScan
from calib_core.types import FloatArray, IntArray

#: Time shifts tried, either way, and their spacing.
_SEARCH_S, _SEARCH_STEP_S = 0.5, 0.002
#: Scans between the two poses of a relative rotation: more turn for the same noise.
_BASELINE = 3


@dataclass(frozen=True, slots=True)
class RoughPoses:
    """Lidar poses in the map. time_s: (T,) lidar clock.   R: (T, 3, 3), p: (T, 3) [m], map <- lidar."""

    time_s: FloatArray
    R: FloatArray
    p: FloatArray


@dataclass(frozen=True, slots=True)
class GyroAttitude:
    """Attitude by integrating the gyroscope alone. stamps_s: (Q,) IMU clock.   gyro: (Q, 3).   R: (Q, 3, 3) start <-
    imu."""

    stamps_s: FloatArray
    gyro: FloatArray
    R: FloatArray

    @staticmethod
    def integrate(stamps_s: FloatArray, gyro: FloatArray) -> GyroAttitude:
        """The attitude at every stamp, with the mean of two neighbouring readings between them."""
        turns = exp(0.5 * (gyro[1:] + gyro[:-1]) * np.diff(stamps_s)[:, None])
        R = np.empty((stamps_s.shape[0], 3, 3))
        R[0] = np.eye(3)
        for q, turn in enumerate(turns):
            R[q + 1] = R[q] @ turn
        return GyroAttitude(stamps_s, gyro, R)

    def at(self, imu_s: FloatArray) -> FloatArray:
        """Attitude at imu_s (N,). Returns (N, 3, 3)."""
        q = np.clip(np.searchsorted(self.stamps_s, imu_s, side="right") - 1, 0, self.stamps_s.shape[0] - 1)
        return self.R[q] @ exp(self.gyro[q] * (imu_s - self.stamps_s[q])[:, None])


def rough_poses(scans: Sequence[TrackedScan]) -> RoughPoses:
    """The poses of eq. (13) of all tracked scans."""
    return RoughPoses(
        np.array([scan.pose_s for scan in scans]),
        np.array([scan.R_map_lidar for scan in scans]),
        np.array([scan.p_map_lidar for scan in scans]),
    )


def time_shift(poses: RoughPoses, attitude: GyroAttitude) -> float:
    """The time shift [s], t_imu = t_lidar - shift, at which both sensors turn equally fast."""
    span = np.diff(poses.time_s)
    near = span < 3.0 * np.median(span)
    start, end, span = poses.time_s[:-1][near], poses.time_s[1:][near], span[near]
    seen = np.linalg.norm(log(np.swapaxes(poses.R[:-1], 1, 2) @ poses.R[1:])[near], axis=1) / span
    shifts = np.arange(-_SEARCH_S, _SEARCH_S + 0.5 * _SEARCH_STEP_S, _SEARCH_STEP_S)
    turn = np.zeros_like(attitude.gyro)
    mean_rate = 0.5 * (attitude.gyro[1:] + attitude.gyro[:-1])
    turn[1:] = np.cumsum(mean_rate * np.diff(attitude.stamps_s)[:, None], axis=0)

    def turned(lidar_s: FloatArray, shift: float) -> FloatArray:
        return np.stack([np.interp(lidar_s - shift, attitude.stamps_s, turn[:, i]) for i in range(3)], axis=1)

    cost = np.array(
        [np.sum((np.linalg.norm(turned(end, s) - turned(start, s), axis=1) / span - seen) ** 2) for s in shifts]
    )
    best = int(np.argmin(cost))
    if not 0 < best < shifts.size - 1:
        return float(shifts[best])
    before, here, after = cost[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return float(shifts[best] + (0.5 * (before - after) / bend if bend > 0 else 0.0) * _SEARCH_STEP_S)


def extrinsic_rotation(poses: RoughPoses, attitude: GyroAttitude, shift_s: float) -> FloatArray:
    """R_imu_lidar (3, 3) that takes the lidar's turns to the gyroscope's, in the least-squares sense."""
    b = min(_BASELINE, poses.time_s.size - 1)
    of_lidar = log(np.swapaxes(poses.R[:-b], 1, 2) @ poses.R[b:])
    R = attitude.at(poses.time_s - shift_s)
    of_imu = log(np.swapaxes(R[:-b], 1, 2) @ R[b:])
    return nearest_rotation(of_imu.T @ of_lidar)


def upright(specific_force: FloatArray) -> FloatArray:
    """The shortest turn R (3, 3), world <- imu, that puts a specific force at rest on the world's z axis."""
    up = specific_force / np.linalg.norm(specific_force)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3) if up[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return exp(axis / sine * np.arctan2(sine, up[2]))


def initial_states(
    poses: RoughPoses,
    attitude: GyroAttitude,
    knot_s: FloatArray,
    shared: CalibrationState,
    R_world_imu_first: FloatArray,
    time_offset_s: float,
) -> ImuStates:
    """IMU states at knots: the nearest rough pose, carried by the gyroscope.

    knot_s: (M,) [s, lidar clock], the first the map's time.   time_offset_s: t_imu = t_lidar - time_offset_s.
    """
    Rc, pc = shared.R_imu_lidar, shared.p_imu_lidar
    R_first_imu = Rc @ poses.R @ Rc.T
    p_first_imu = (poses.p - poses.R @ (Rc.T @ pc)) @ Rc.T + pc
    nearest = _nearest(poses.time_s, knot_s)
    of_pose, of_knot = attitude.at(poses.time_s - time_offset_s), attitude.at(knot_s - time_offset_s)
    carried = np.swapaxes(of_pose[nearest], 1, 2) @ of_knot
    velocity = np.gradient(p_first_imu, poses.time_s, axis=0)
    v = np.stack([np.interp(knot_s, poses.time_s, velocity[:, i]) for i in range(3)], axis=1)
    p = np.stack([np.interp(knot_s, poses.time_s, p_first_imu[:, i]) for i in range(3)], axis=1)
    R = R_world_imu_first @ R_first_imu[nearest] @ carried
    R[0], p[0] = R_world_imu_first, 0.0
    return ImuStates(R, p @ R_world_imu_first.T, v @ R_world_imu_first.T)


def _nearest(times_s: FloatArray, query_s: FloatArray) -> IntArray:
    right = np.clip(np.searchsorted(times_s, query_s), 1, times_s.size - 1)
    return np.where(query_s - times_s[right - 1] < times_s[right] - query_s, right - 1, right)
