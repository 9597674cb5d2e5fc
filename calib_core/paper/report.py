"""The solve's outcome as records: progress events, trajectory."""

from __future__ import annotations

import numpy as np

from calib_core.events import IterationEvent, PlaneResidual
from calib_core.geometry import euler_xyz_deg
from calib_core.paper.preintegration import ScanPreintegration
from calib_core.paper.problem import PaperState, covariance_of_calibration
from calib_core.paper.records import FrontEnd, PlaneFitQuality
from calib_core.paper.timeline import Timeline
from calib_core.solver.arrow import solve_arrow
from calib_core.solver.system import ArrowSystem
from calib_core.types import FloatArray, IntArray, Trajectory

#: Poses of the reported trajectory per scan.
_POSES_PER_SCAN = 10


def plane_qualities(front: FrontEnd, plane_of_point: IntArray, dist_m: FloatArray) -> tuple[PlaneFitQuality, ...]:
    """Each plane's residual. plane_of_point, dist_m: (N,)."""
    qualities = []
    for i, plane in enumerate(front.planes):
        mine = dist_m[plane_of_point == i]
        rms = float(np.sqrt(np.mean(mine**2))) if mine.size else 0.0
        qualities.append(PlaneFitQuality(plane, int(mine.size), rms))
    return tuple(qualities)


def iteration_event(
    state: PaperState,
    system: ArrowSystem,
    number: tuple[int, int],
    time_offset_s: float,
    qualities: tuple[PlaneFitQuality, ...],
) -> IterationEvent:
    """One accepted step, for whoever watches. number: of the iteration, of its round."""
    # Damped a little: early systems may be singular, and these figures are for the eye.
    std = np.sqrt(np.diag(covariance_of_calibration(solve_arrow(system, damping=1e-9))))
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = state.shared.R_imu_lidar, state.shared.p_imu_lidar
    return IterationEvent(
        iteration=number[0],
        round=number[1],
        cost=system.cost,
        matrix=matrix.tolist(),
        translation_m=state.shared.p_imu_lidar.tolist(),
        euler_xyz_deg=euler_xyz_deg(state.shared.R_imu_lidar),
        time_offset_s=time_offset_s,
        rotation_std_deg=np.degrees(std[:3]).tolist(),
        translation_std_m=std[3:6].tolist(),
        time_offset_std_s=float(std[6]),
        planes=[PlaneResidual(name=q.plane.name, rms_m=q.rms_m, points=q.n_points) for q in qualities],
    )


def trajectory(
    state: PaperState,
    preintegration: ScanPreintegration,
    timeline: Timeline,
    tracked: frozenset[int],
    gravity_world: FloatArray,
    epoch_ns: int,
) -> Trajectory:
    """The lidar's motion in the map frame, some poses a scan; valid where the scan was tracked."""
    n_knots = timeline.start_s.shape[0]
    knot = np.repeat(np.arange(n_knots), _POSES_PER_SCAN)
    elapsed = (timeline.duration_s[:, None] * np.arange(_POSES_PER_SCAN) / _POSES_PER_SCAN).ravel()
    # The last knot's span has an end of its own.
    knot, elapsed = np.append(knot, n_knots - 1), np.append(elapsed, timeline.duration_s[-1])
    c, knots = state.shared, state.knots
    moved = preintegration.at(knot, elapsed).corrected(c.gyro_bias_delta, c.accel_bias_delta, c.time_delta_s)
    DR, Dp = moved[0], moved[2]
    z = elapsed[:, None]
    R_world_imu = knots.R[knot] @ DR
    travelled = np.einsum("nij,nj->ni", knots.R[knot], Dp)
    p_world_imu = knots.p[knot] + z * knots.v[knot] + 0.5 * z**2 * gravity_world + travelled
    p_world_lidar = p_world_imu + R_world_imu @ c.p_imu_lidar
    R_map_world = c.R_imu_lidar.T @ knots.R[0].T
    R_map_lidar = R_map_world @ R_world_imu @ c.R_imu_lidar
    p_map_lidar = p_world_lidar @ R_map_world.T - c.p_imu_lidar @ c.R_imu_lidar
    valid = np.array([int(position) in tracked for position in timeline.position])[knot]
    return Trajectory(epoch_ns, timeline.start_s[knot] + elapsed, R_map_lidar, p_map_lidar, valid)
