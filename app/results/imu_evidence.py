"""The IMU's readings foretold by the solved motion: turning from its rotations, specific force from its places.

    rate = Log(R_k' R_k+1) / h        force = R_k' (p_k+1 - 2 p_k + p_k-1) / h^2 - R_k' g

A constant bias is taken out of both differences; gravity g and the accelerometer's bias are what fits the force best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.results.imu_pose import imu_pose
from app.schemas.evidence import ImuComparison
from calib_core.types import BoolArray, FloatArray, Recording, Trajectory

#: So much of the recording is drawn: the liveliest stretch, short enough that single swings can be told apart.
SHOWN_S = 6.0
#: Of an accelerometer's bias before, and of one comparison: together they weigh one against the other.
BIAS_STD_M_S2, BIAS_HOLD_M_S2 = 0.1, 0.3


@dataclass(frozen=True, slots=True)
class ImuMotion:
    """The IMU's motion in the map frame. t_ns is t_s after epoch_ns, lidar clock."""

    epoch_ns: int
    t_s: FloatArray
    R_map_imu: FloatArray
    p_map_imu: FloatArray
    valid: BoolArray


def imu_motion(trajectory: Trajectory, T_imu_lidar: FloatArray) -> ImuMotion:
    """The IMU's part of a lidar's motion."""
    R_map_imu, p_map_imu = imu_pose(trajectory.R_map_lidar, trajectory.p_map_lidar, T_imu_lidar)
    return ImuMotion(trajectory.epoch_ns, trajectory.times_s, R_map_imu, p_map_imu, trajectory.valid)


def compare_imu(
    recording: Recording, motion: ImuMotion, time_offset_ns: int
) -> tuple[ImuComparison | None, FloatArray]:
    """The comparison, and which way is up in the map frame (3,). None for a motion too short to differentiate."""
    t_s = motion.t_s
    if len(t_s) < 10:
        return None, np.array([0.0, 0.0, 1.0])
    imu = recording.imu
    stamps_s = (imu.stamps_ns + (time_offset_ns - motion.epoch_ns)).astype(np.float64) * 1e-9
    rate_s, rate = _rates(motion)
    force_s, acceleration, R = _accelerations(motion)
    step_s = float(np.median(np.diff(t_s)))
    gyro = _smooth_at(stamps_s, imu.gyro_rad_s, rate_s, step_s)
    # A second difference weighs two steps as a triangle, whose second moment is that of a box of sqrt(2) steps.
    accel = _smooth_at(stamps_s, imu.accel_m_s2, force_s, np.sqrt(2.0) * step_s)
    gravity, bias = _gravity_and_bias(R, acceleration - (R @ accel[..., None])[..., 0])
    force = (np.swapaxes(R, 1, 2) @ (acceleration - gravity)[..., None])[..., 0] + bias
    rate = rate + np.median(gyro - rate, axis=0)
    up = -gravity / max(float(np.linalg.norm(gravity)), 1e-9)
    shown = _liveliest(force_s, gyro[1:])
    first_s = (recording.scans[0].stamp_ns - motion.epoch_ns) * 1e-9
    return ImuComparison(
        t_s=np.round(force_s[shown] - first_s, 4).tolist(),
        gyro_rad_s=_columns(gyro[1:][shown]),
        gyro_predicted_rad_s=_columns(rate[1:][shown]),
        accel_m_s2=_columns(accel[shown]),
        accel_predicted_m_s2=_columns(force[shown]),
        gyro_rms_rad_s=float(np.sqrt(np.mean((gyro - rate) ** 2))),
        accel_rms_m_s2=float(np.sqrt(np.mean((accel - force) ** 2))),
    ), up


def _rates(motion: ImuMotion) -> tuple[FloatArray, FloatArray]:
    """(K-1,) middles between knots and (K-1, 3) rates about the IMU's axes [rad/s]."""
    from scipy.spatial.transform import Rotation

    turn = np.swapaxes(motion.R_map_imu[:-1], 1, 2) @ motion.R_map_imu[1:]
    step_s = np.diff(motion.t_s)
    rate = np.asarray(Rotation.from_matrix(turn).as_rotvec(), dtype=np.float64) / step_s[:, None]
    return motion.t_s[:-1] + 0.5 * step_s, rate


def _accelerations(motion: ImuMotion) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(K-2,) knots, (K-2, 3) accelerations in the map frame [m/s2] and the rotations there."""
    velocity = np.diff(motion.p_map_imu, axis=0) / np.diff(motion.t_s)[:, None]
    between_s = 0.5 * (motion.t_s[2:] - motion.t_s[:-2])
    return motion.t_s[1:-1], np.diff(velocity, axis=0) / between_s[:, None], motion.R_map_imu[1:-1]


def _gravity_and_bias(R_map_imu: FloatArray, left: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Both (3,) [m/s2] from left = g - R b, (N, 3): least squares, the bias held near zero where nothing turns."""
    turn = R_map_imu.mean(axis=0)
    n = float(len(left))
    held = (BIAS_HOLD_M_S2 / BIAS_STD_M_S2) ** 2
    information = np.block([[n * np.eye(3), -n * turn], [-n * turn.T, (n + held) * np.eye(3)]])
    vector = np.concatenate([left.sum(axis=0), -(np.swapaxes(R_map_imu, 1, 2) @ left[..., None])[..., 0].sum(axis=0)])
    solution = np.asarray(np.linalg.solve(information, vector), dtype=np.float64)
    return solution[:3], solution[3:]


def _smooth_at(stamps_s: FloatArray, values: FloatArray, at_s: FloatArray, over_s: float) -> FloatArray:
    """(N, 3): means over a time around instants of readings taken as straight between stamps: from their integral."""
    steps_s = np.diff(stamps_s)[:, None]
    slopes = np.diff(values, axis=0) / np.maximum(steps_s, 1e-9)
    integral = np.vstack([np.zeros((1, 3)), np.cumsum(0.5 * steps_s * (values[1:] + values[:-1]), axis=0)])

    def until(edge_s: FloatArray) -> FloatArray:
        k = np.clip(np.searchsorted(stamps_s, edge_s, side="right") - 1, 0, len(stamps_s) - 2)
        after_s = (edge_s - stamps_s[k])[:, None]
        return integral[k] + after_s * (values[k] + 0.5 * after_s * slopes[k])

    low_s, high_s = (np.clip(at_s + side * over_s / 2, stamps_s[0], stamps_s[-1]) for side in (-1, 1))
    return (until(high_s) - until(low_s)) / np.maximum(high_s - low_s, 1e-9)[:, None]


def _liveliest(t_s: FloatArray, gyro: FloatArray) -> slice:
    """The stretch of SHOWN_S that turns most."""
    turned = np.concatenate([[0.0], np.cumsum(np.sum(gyro**2, axis=1))])
    ends = np.searchsorted(t_s, t_s + SHOWN_S)
    start = int(np.argmax(turned[ends] - turned[: len(t_s)]))
    return slice(start, int(ends[start]))


def _columns(values: FloatArray) -> list[list[float]]:
    return [np.round(column, 5).tolist() for column in values.T]
