"""Another extrinsic than the answer's, on purpose or from before, and what it does to the walls.

The motion was solved as the lidar's. It is the IMU that really moved along its own path, so with another extrinsic the
lidar's path follows from the IMU's:

    T_map_imu(t)    = T_map_lidar(t) T_imu_lidar^-1
    T'_map_lidar(t) = C T_map_imu(t - dt) T'_imu_lidar            a later clock looks at an earlier IMU
    C                 keeps the first valid pose where it was, so that the map stays the map

A nudge is such an extrinsic: T'_imu_lidar = [R_c Exp(r), p_c + dp], the contract's perturbation.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.results.imu_pose import imu_pose
from app.results.plane_table import PlaneTable
from app.results.thickness import GATE_M
from app.results.thinning import spread, thinned_scan
from app.scene.build import Solved
from app.schemas.view import Nudge, OldExtrinsic, WallBlur
from calib_core import api
from calib_core.types import FloatArray, Recording, Trajectory

#: Scans and points that the cost of a wrong extrinsic is measured on: enough for two digits, quick enough for a slider.
BLUR_SCANS = 20
BLUR_POINTS = 1500


def nudged(trajectory: Trajectory, T_imu_lidar: FloatArray, nudge: Nudge) -> Trajectory:
    """The lidar's motion if the answer were off by the nudge.   T_imu_lidar: (4, 4)."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(np.radians([nudge.rx_deg, nudge.ry_deg, nudge.rz_deg])).as_matrix()
    T_wrong = np.eye(4)
    T_wrong[:3, :3] = T_imu_lidar[:3, :3] @ turn
    T_wrong[:3, 3] = T_imu_lidar[:3, 3] + np.array([nudge.tx_m, nudge.ty_m, nudge.tz_m])
    return with_extrinsic(trajectory, T_imu_lidar, T_wrong, later_s=nudge.dt_s)


def with_old(solved: Solved, old: OldExtrinsic) -> Trajectory:
    """The lidar's motion if the old extrinsic were true; without a time offset of its own it borrows the answer's."""
    from scipy.spatial.transform import Rotation

    T_old = np.eye(4)
    T_old[:3, :3] = Rotation.from_quat(old.quaternion_xyzw).as_matrix()
    T_old[:3, 3] = old.translation_m
    later_s = 0.0 if old.time_offset_s is None else old.time_offset_s - solved.time_offset_s
    return with_extrinsic(solved.trajectory, solved.T_imu_lidar, T_old, later_s=later_s)


def with_extrinsic(
    trajectory: Trajectory, T_imu_lidar: FloatArray, T_other: FloatArray, *, later_s: float
) -> Trajectory:
    """The lidar's motion with `T_other` in place of `T_imu_lidar`, both (4, 4), and the IMU's clock so much later."""
    R_map_imu, p_map_imu = imu_pose(trajectory.R_map_lidar, trajectory.p_map_lidar, T_imu_lidar)
    R_new = R_map_imu @ T_other[:3, :3]
    p_new = R_map_imu @ T_other[:3, 3] + p_map_imu
    first = int(np.argmax(trajectory.valid))
    C = trajectory.R_map_lidar[first] @ R_new[first].T
    return replace(
        trajectory,
        times_s=trajectory.times_s + later_s,
        R_map_lidar=C @ R_new,
        p_map_lidar=(p_new - p_new[first]) @ C.T + trajectory.p_map_lidar[first],
    )


def wall_blur(recording: Recording, solved: Solved, wrong: Trajectory) -> WallBlur:
    """Thickness of the walls as it was measured once for all screens, and with another motion.

    What the other motion costs is seen on a few points of a few scans. Their own thickness differs from that of all points by
    a few tenths of a millimetre, which is no cost: what they gain is added to the thickness as measured, in mean squares.
    """
    table = PlaneTable.of(solved.planes)
    right_m: list[FloatArray] = []
    wrong_m: list[FloatArray] = []
    for place in spread(len(recording.scans), BLUR_SCANS):
        if not api.covers(solved.trajectory, recording.scans[place]):
            continue
        scan = thinned_scan(recording.scans[place], BLUR_POINTS)
        owner, dist_m = table.nearest(api.map_points(scan, solved.trajectory), gate_m=GATE_M)
        chosen = owner >= 0
        right_m.append(dist_m[chosen].astype(np.float64))
        wrong_m.append(table.distances_m(api.map_points(scan, wrong)[chosen], owner[chosen]))
    solved_m2, nudged_m2 = _mean_square(right_m), _mean_square(wrong_m)
    measured_m2 = solved_m2 if solved.walls is None else solved.walls.after_rms_m**2
    return WallBlur(
        solved_rms_m=math.sqrt(measured_m2), nudged_rms_m=math.sqrt(max(0.0, measured_m2 + nudged_m2 - solved_m2))
    )


def _mean_square(parts: list[FloatArray]) -> float:
    joined = np.concatenate(parts) if parts else np.zeros(0)
    return float(np.mean(joined**2)) if len(joined) else 0.0
