"""What a step of the solve believes of the motion, small enough to be told: a few instants of a dozen sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.events import IterationEvent, PlaneResidual, SweepMotion
from calib_core.full.joint.motion import Motion
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.residuals import plane_residuals
from calib_core.full.joint.settings import WATCHING
from calib_core.full.joint.state import CALIBRATION, ROTATION, TIME_OFFSET, TRANSLATION, Estimate
from calib_core.full.run import Clocks, Run
from calib_core.geometry import euler_xyz_deg, transform_matrix
from calib_core.solver.arrow import ArrowSolution
from calib_core.solver.information import covariance_of
from calib_core.types import FloatArray, Scan


def sweep_motions(
    scans: Sequence[Scan],
    clocks: Clocks,
    motion: Motion,
    *,
    time_offset_s: float,
    R_imu_lidar: FloatArray,
    p_imu_lidar: FloatArray,
) -> tuple[SweepMotion, ...]:
    """The lidar through sweeps spread over the recording, as far as the motion reaches yet; frame of the solve."""
    from scipy.spatial.transform import Rotation

    places = np.unique(np.linspace(0, len(scans) - 1, WATCHING.sweeps).astype(np.int64))
    told = []
    for place in places.tolist():
        if clocks.scan_points[place] == 0:
            continue
        # A flash is of one instant, through which nothing can be interpolated.
        scan, end_s = scans[place], max(float(clocks.sweep_s[place]), WATCHING.shortest_s)
        offset_s = np.linspace(0.0, end_s, WATCHING.instants)
        when_s = (scan.stamp_ns - clocks.lidar_epoch_ns) * 1e-9 + offset_s - time_offset_s
        poses = motion.lidar_at(when_s, R_imu_lidar, p_imu_lidar)
        if not poses.usable.all():
            continue
        told.append(
            SweepMotion(
                stamp_ns=scan.stamp_ns,
                offset_s=np.round(offset_s, 6).tolist(),
                quaternion_xyzw=np.round(Rotation.from_matrix(poses.R).as_quat(), 6).tolist(),
                position_m=np.round(poses.p, 5).tolist(),
            )
        )
    return tuple(told)


def iteration_event(
    run: Run,
    problem: JointProblem,
    estimate: Estimate,
    cost: float,
    solution: ArrowSolution,
    number: tuple[int, int],
    names: Sequence[str],
) -> IterationEvent:
    """One accepted step, for whoever watches. number: of the iteration, of its round.   names: of the planes."""
    std = np.sqrt(np.diag(covariance_of(solution.information, slice(0, CALIBRATION))))
    std[ROTATION] = np.degrees(std[ROTATION])
    # What is held is so by an information that nobody measured, which would look like the best of all answers.
    told = [None if i in problem.frozen else float(value) for i, value in enumerate(std)]
    return IterationEvent(
        iteration=number[0],
        round=number[1],
        cost=cost,
        matrix=transform_matrix(estimate.R_imu_lidar, estimate.p_imu_lidar).tolist(),
        translation_m=estimate.p_imu_lidar.tolist(),
        euler_xyz_deg=euler_xyz_deg(estimate.R_imu_lidar),
        time_offset_s=run.clocks.offset_ns(estimate.time_offset_s) * 1e-9,
        rotation_std_deg=told[ROTATION],
        translation_std_m=told[TRANSLATION],
        time_offset_std_s=told[TIME_OFFSET],
        planes=[
            PlaneResidual(name=name, rms_m=rms, points=points, normal=np.round(normal, 7).tolist(), offset_m=float(w))
            for name, normal, w, (rms, points) in zip(
                names, estimate.normals, estimate.offsets_m, plane_residuals(problem, estimate), strict=True
            )
        ],
        sweeps=sweep_motions(
            run.recording.scans,
            run.clocks,
            problem.motion(estimate),
            time_offset_s=estimate.time_offset_s,
            R_imu_lidar=estimate.R_imu_lidar,
            p_imu_lidar=estimate.p_imu_lidar,
        ),
        gravity_m_s2=np.round(estimate.gravity, 5).tolist(),
    )
