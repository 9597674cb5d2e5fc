"""A scan's points with the motion of its sweep taken out, from a solved trajectory."""

from __future__ import annotations

import numpy as np

from calib_core.geometry import exp, log
from calib_core.types import Float32Array, FloatArray, Scan, Trajectory


def lidar_poses(trajectory: Trajectory, stamps_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lidar poses in the map frame at instants: R (N, 3, 3), p (N, 3). Constant twist between knots, the ends held.

    stamps_s: (N,) lidar clock after the trajectory's epoch.
    """
    t = trajectory.times_s
    k = np.clip(np.searchsorted(t, stamps_s, side="right") - 1, 0, len(t) - 2)
    f = np.clip((stamps_s - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0)[:, None]
    # A sweep's thousand instants lie between a dozen knots.
    spans, of_span = np.unique(k, return_inverse=True)
    turn = log(np.swapaxes(trajectory.R_map_lidar[spans], 1, 2) @ trajectory.R_map_lidar[spans + 1])[of_span]
    R = trajectory.R_map_lidar[k] @ exp(f * turn)
    return R, (1 - f) * trajectory.p_map_lidar[k] + f * trajectory.p_map_lidar[k + 1]


def move_to_map(
    trajectory: Trajectory, xyz_m: FloatArray, stamps_s: FloatArray, *, quantum_s: float = 2e-5
) -> FloatArray:
    """Points (N, 3), each at its own instant (N,), in the map frame. Instants within a quantum share a pose."""
    ticks, inverse = np.unique(np.rint(stamps_s / quantum_s).astype(np.int64), return_inverse=True)
    R, p = lidar_poses(trajectory, np.asarray(ticks * quantum_s, dtype=np.float64))
    return np.einsum("nij,nj->ni", R[inverse], xyz_m) + p[inverse]


def map_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the map frame, each moved by the pose at its own time."""
    start_s = trajectory.begin_s(scan)
    stamps = start_s + scan.points["offset_ns"] * 1e-9
    return move_to_map(trajectory, scan.points["xyz"].astype(np.float64), stamps).astype(np.float32)


def deskew_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the lidar frame at its first point's time."""
    start_s = trajectory.begin_s(scan)
    stamps = start_s + scan.points["offset_ns"] * 1e-9
    in_map = move_to_map(trajectory, scan.points["xyz"].astype(np.float64), stamps)
    R, p = lidar_poses(trajectory, np.array([start_s]))
    return ((in_map - p[0]) @ R[0]).astype(np.float32)


def raw_map_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the map frame as if the sweep had been motionless: what is seen without unsweep."""
    start_s = trajectory.begin_s(scan)
    R, p = lidar_poses(trajectory, np.array([start_s]))
    return (scan.points["xyz"].astype(np.float64) @ R[0].T + p[0]).astype(np.float32)
