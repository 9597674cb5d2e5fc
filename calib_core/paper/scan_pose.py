"""The rough pose of one scan, eq. (13): the sweep taken as motionless, its points put on the map's planes."""

from __future__ import annotations

import numpy as np

from calib_core.geometry import exp
from calib_core.types import FloatArray


def rough_pose(
    points_lidar: FloatArray, normals_map: FloatArray, offsets_m: FloatArray, R: FloatArray, p: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """R_map_lidar (3, 3) and p_map_lidar (3,) [m] that minimise sum (n . (R x + p) + w)^2, from a start (R, p).

    points_lidar: (N, 3) [m].   normals_map: (N, 3) unit.   offsets_m: (N,).
    """
    for _ in range(10):
        d = np.einsum("ni,ni->n", normals_map, points_lidar @ R.T + p) + offsets_m
        jacobian = np.hstack([np.cross(points_lidar, normals_map @ R), normals_map])
        # A direction that the planes do not determine must not throw the pose away: a weak tie to the last iterate.
        normal_matrix = jacobian.T @ jacobian + 1e-6 * d.size * np.eye(6)
        step = -np.linalg.solve(normal_matrix, jacobian.T @ d)
        R, p = R @ exp(step[:3]), p + step[3:]
        if np.abs(step).max() < 1e-7:
            break
    return R, p
