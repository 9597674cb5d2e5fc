"""Lidar factors, eq. (7)-(10), with analytic Jacobians, for all points at once.

The function whose zero says "the point lies on its plane", for a point x seen z seconds after its scan's first:

    x_imu   = Rc x + pc                                          (7)
    x_world = R (DR x_imu + Dp) + p + z v + 1/2 z^2 g            (8) with (4), (6)
    x_map   = Rc' (R0' x_world - pc)                             (9), p0 = 0
    d       = n . x_map + w                                      (10)

DR, Dp carry their first-order changes with biases and time shift, eq. (12). Rotations are perturbed on the right.
With u = R0 Rc n (the normal in the world), y = DR x_imu + Dp, a = (R DR)' u and q = x_map:

    d_D_phi    y x (R' u)            d_D_p   u          d_D_v   z u
    d_D_phi0   (Rc n) x (R0' x_world)                   of the first attitude, through (9) only
    d_D_phic   x x (Rc' a) + n x q                      d_D_pc  a - Rc n
    d_D_bg     (x_imu x a)' Jr DR_D_bg + (R' u)' Dp_D_bg,  and likewise for the accelerometer's bias and the time shift

symbol  code             shape       frame
x       points_lidar     (N, 3)      lidar, at the point's own time
n, w    normals_map, offsets_m       map = lidar at the first scan's first point
z       elapsed_s        (N,)        since the scan's first point
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_core.geometry import right_jacobian
from calib_core.paper.preintegration import Preintegrated
from calib_core.types import FloatArray


@dataclass(frozen=True, slots=True)
class LidarMeasurements:
    """Points with the planes they were associated to. preintegrated: to each point's time, leading shape (N,)."""

    points_lidar: FloatArray
    normals_map: FloatArray
    offsets_m: FloatArray
    elapsed_s: FloatArray
    preintegrated: Preintegrated


@dataclass(frozen=True, slots=True)
class CalibrationState:
    """What both sensors share. R_imu_lidar (3, 3), p_imu_lidar (3,) [m], changes of biases and time shift from the
    prior."""

    R_imu_lidar: FloatArray
    p_imu_lidar: FloatArray
    gyro_bias_delta: FloatArray
    accel_bias_delta: FloatArray
    time_delta_s: float


@dataclass(frozen=True, slots=True)
class ScanStates:
    """IMU states at the first point of each row's scan. R (N, 3, 3) world <- imu, p [m], v [m/s] (N, 3)."""

    R: FloatArray
    p: FloatArray
    v: FloatArray


@dataclass(frozen=True, slots=True)
class LidarFactors:
    """Distances dist_m (N,) and Jacobians (N, k): phi, p, v of the scan; phi0 of the first scan; the shared unknowns.

    dist_D_point, dist_D_DR, dist_D_Dp: (N, 3), for the propagation of noise (III-A).
    """

    dist_m: FloatArray
    dist_D_phi: FloatArray
    dist_D_p: FloatArray
    dist_D_v: FloatArray
    dist_D_phi0: FloatArray
    dist_D_phic: FloatArray
    dist_D_pc: FloatArray
    dist_D_bg: FloatArray
    dist_D_ba: FloatArray
    dist_D_t: FloatArray
    dist_D_point: FloatArray
    dist_D_DR: FloatArray
    dist_D_Dp: FloatArray


def points_in_map(
    measurements: LidarMeasurements,
    calibration: CalibrationState,
    states: ScanStates,
    R_world_imu_first: FloatArray,
    gravity_world: FloatArray,
) -> FloatArray:
    """Each point reprojected into the first lidar frame, eq. (7)-(9). Returns (N, 3) [m], map frame."""
    c = calibration
    DR, _, Dp, _ = measurements.preintegrated.corrected(c.gyro_bias_delta, c.accel_bias_delta, c.time_delta_s)
    x_imu = measurements.points_lidar @ c.R_imu_lidar.T + c.p_imu_lidar
    x_world = _to_world(_rotate(DR, x_imu) + Dp, measurements.elapsed_s, states, gravity_world)
    return (x_world @ R_world_imu_first - c.p_imu_lidar) @ c.R_imu_lidar


def point_to_plane(points_map: FloatArray, normals_map: FloatArray, offsets_m: FloatArray) -> FloatArray:
    """Signed distance of each point to its plane, eq. (10).

    points_map: (N, 3) [m].   normals_map: (N, 3) unit.   offsets_m: (N,).   Returns (N,) [m], positive on the
    normal's side.
    """
    dist_m: FloatArray = np.einsum("ni,ni->n", points_map, normals_map) + offsets_m
    return dist_m


def lidar_distances(
    measurements: LidarMeasurements,
    calibration: CalibrationState,
    states: ScanStates,
    R_world_imu_first: FloatArray,
    gravity_world: FloatArray,
) -> FloatArray:
    """Distances alone, (N,) [m]. R_world_imu_first: (3, 3).   gravity_world: (3,) [m/s^2], pointing down."""
    in_map = points_in_map(measurements, calibration, states, R_world_imu_first, gravity_world)
    return point_to_plane(in_map, measurements.normals_map, measurements.offsets_m)


def lidar_factors(
    measurements: LidarMeasurements,
    calibration: CalibrationState,
    states: ScanStates,
    R_world_imu_first: FloatArray,
    gravity_world: FloatArray,
) -> LidarFactors:
    """Distances and Jacobians of all points; arguments as for `lidar_distances`."""
    c, pre, n = calibration, measurements.preintegrated, measurements.normals_map
    z = measurements.elapsed_s[:, None]
    DR, _, Dp, rotvec = pre.corrected(c.gyro_bias_delta, c.accel_bias_delta, c.time_delta_s)
    x_imu = measurements.points_lidar @ c.R_imu_lidar.T + c.p_imu_lidar
    y = _rotate(DR, x_imu) + Dp
    x_first = _to_world(y, measurements.elapsed_s, states, gravity_world) @ R_world_imu_first
    q = (x_first - c.p_imu_lidar) @ c.R_imu_lidar

    n_imu = n @ c.R_imu_lidar.T
    u = n_imu @ R_world_imu_first.T
    u_scan = _rotate_back(states.R, u)
    a = _rotate_back(DR, u_scan)
    turned = _rotate_back(right_jacobian(rotvec), np.cross(x_imu, a))
    return LidarFactors(
        dist_m=point_to_plane(q, n, measurements.offsets_m),
        dist_D_phi=np.cross(y, u_scan),
        dist_D_p=u,
        dist_D_v=z * u,
        dist_D_phi0=np.cross(n_imu, x_first),
        dist_D_phic=np.cross(measurements.points_lidar, a @ c.R_imu_lidar) + np.cross(n, q),
        dist_D_pc=a - n_imu,
        dist_D_bg=_rotate_back(pre.DR_D_bg, turned) + _rotate_back(pre.Dp_D_bg, u_scan),
        dist_D_ba=_rotate_back(pre.Dp_D_ba, u_scan),
        dist_D_t=np.einsum("ni,ni->n", pre.DR_D_t, turned) + np.einsum("ni,ni->n", pre.Dp_D_t, u_scan),
        dist_D_point=a @ c.R_imu_lidar,
        dist_D_DR=np.cross(x_imu, a),
        dist_D_Dp=u_scan,
    )


def _to_world(y: FloatArray, elapsed_s: FloatArray, states: ScanStates, gravity_world: FloatArray) -> FloatArray:
    z = elapsed_s[:, None]
    return _rotate(states.R, y) + states.p + z * states.v + 0.5 * z**2 * gravity_world


def _rotate(R: FloatArray, vectors: FloatArray) -> FloatArray:
    rotated: FloatArray = np.einsum("nij,nj->ni", R, vectors)
    return rotated


def _rotate_back(R: FloatArray, vectors: FloatArray) -> FloatArray:
    rotated: FloatArray = np.einsum("nji,nj->ni", R, vectors)
    return rotated
