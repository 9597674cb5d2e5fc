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


def map_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the map frame, each moved by the pose at its own time."""
    return _moved(scan, trajectory, trajectory.R_map_lidar, trajectory.p_map_lidar)


def deskew_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the lidar frame at its first point's time."""
    R, p = lidar_poses(trajectory, np.array([trajectory.begin_s(scan)]))
    return _moved(scan, trajectory, R[0].T @ trajectory.R_map_lidar, (trajectory.p_map_lidar - p[0]) @ R[0])


def _moved(scan: Scan, trajectory: Trajectory, R: FloatArray, p: FloatArray) -> Float32Array:
    """(N, 3) [m]: each point by the pose at its own time. R: (K, 3, 3), p: (K, 3) at the trajectory's instants, of any frame."""
    # The compiler is loaded for who moves points, not for who knows what a trajectory is.
    from calib_core.geometry.move_kernels import move_points_kernel

    moved = np.empty((len(scan.points), 3), np.float32)
    if not len(moved):
        return moved
    stamps_s = trajectory.begin_s(scan) + scan.points["offset_ns"] * 1e-9
    times_s = trajectory.times_s
    first = min(max(int(np.searchsorted(times_s, stamps_s.min(), side="right")) - 1, 0), len(times_s) - 2)
    end = min(max(int(np.searchsorted(times_s, stamps_s.max(), side="right")), first + 1), len(times_s) - 1) + 1
    some = slice(first, end)
    turn_rad = log(np.swapaxes(R[some][:-1], 1, 2) @ R[some][1:])
    xyz_m = scan.points["xyz"].astype(np.float64)
    move_points_kernel(times_s[some], R[some], p[some], turn_rad, xyz_m, stamps_s, moved)
    return moved


def raw_map_points(scan: Scan, trajectory: Trajectory) -> Float32Array:
    """(N, 3) [m]: the scan's points in the map frame as if the sweep had been motionless: what is seen without unsweep."""
    start_s = trajectory.begin_s(scan)
    R, p = lidar_poses(trajectory, np.array([start_s]))
    return (scan.points["xyz"].astype(np.float64) @ R[0].T + p[0]).astype(np.float32)
