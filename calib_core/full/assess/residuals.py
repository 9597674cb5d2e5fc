"""Numbers of an estimate in the form that people and the result document want."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_core.events import IterationEvent, PlaneResidual
from calib_core.full.joint.problem import JointProblem
from calib_core.full.joint.state import Estimate
from calib_core.full.progress import sweep_motions
from calib_core.full.run import Context
from calib_core.solver.arrow import ArrowSolution
from calib_core.types import FloatArray


def transform_matrix(R: FloatArray, p: FloatArray) -> FloatArray:
    """The (4, 4) homogeneous matrix of a rotation and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T


def euler_xyz_deg(R: FloatArray) -> list[float]:
    """Roll, pitch, yaw of R = Rz(yaw) Ry(pitch) Rx(roll) [deg]; roll 0 where pitch is at its pole."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) < 1e-9:
        roll, yaw = 0.0, np.arctan2(-R[0, 1], R[1, 1])
    else:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    return [float(np.degrees(a)) for a in (roll, pitch, yaw)]


def quaternion_xyzw(R: FloatArray) -> list[float]:
    """The unit quaternion of a rotation, w >= 0."""
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(R).as_quat(canonical=True)
    return [float(v) for v in q]


def plane_residuals(problem: JointProblem, estimate: Estimate) -> list[tuple[float, int]]:
    """Per plane: root mean square of the range-noise-weighted distances in metres, and points."""
    bins = problem.bins
    a, _ = problem.planes_seen(estimate)
    chi2 = np.einsum("bi,bij,bj->b", a, bins.scatter, a, optimize=True)
    weight = bins.scatter[:, 3, 3]
    out = []
    for j in range(len(estimate.normals)):
        mine = bins.plane == j
        total = float(weight[mine].sum())
        out.append(
            (float(np.sqrt(max(chi2[mine].sum(), 0.0) / total)) if total > 0 else 0.0, int(bins.count[mine].sum()))
        )
    return out


def plane_chi2(problem: JointProblem, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """Per plane: mean squared distance in standard deviations (1 for pure noise), and points. (P,), (P,)."""
    bins = problem.bins
    a, _ = problem.planes_seen(estimate)
    chi2 = np.einsum("bi,bij,bj->b", a, bins.scatter, a, optimize=True)
    planes = len(estimate.normals)
    points = np.bincount(bins.plane, bins.count, planes).astype(np.float64)
    return np.bincount(bins.plane, chi2, planes) / np.maximum(points, 1), points


def iteration_event(
    ctx: Context,
    problem: JointProblem,
    estimate: Estimate,
    cost: float,
    solution: ArrowSolution,
    round_number: int,
    names: Sequence[str],
) -> IterationEvent:
    """One accepted step, for whoever watches. names: of the planes."""
    cov = np.linalg.pinv(solution.information, hermitian=True)[:7, :7]
    std = np.sqrt(np.maximum(np.diag(cov), 0.0))
    return IterationEvent(
        iteration=ctx.iterations,
        round=round_number,
        cost=cost,
        matrix=transform_matrix(estimate.R_imu_lidar, estimate.p_imu_lidar).tolist(),
        translation_m=estimate.p_imu_lidar.tolist(),
        euler_xyz_deg=euler_xyz_deg(estimate.R_imu_lidar),
        time_offset_s=ctx.clocks.offset_ns(estimate.time_offset_s) * 1e-9,
        rotation_std_deg=np.degrees(std[:3]).tolist(),
        translation_std_m=std[3:6].tolist(),
        time_offset_std_s=float(std[6]),
        planes=[
            PlaneResidual(name=name, rms_m=rms, points=points, normal=np.round(normal, 7).tolist(), offset_m=float(w))
            for name, normal, w, (rms, points) in zip(
                names, estimate.normals, estimate.offsets_m, plane_residuals(problem, estimate), strict=True
            )
        ],
        sweeps=sweep_motions(
            ctx.recording.scans,
            ctx.clocks.lidar_epoch_ns,
            problem.motion(estimate),
            time_offset_s=estimate.time_offset_s,
            R_imu_lidar=estimate.R_imu_lidar,
            p_imu_lidar=estimate.p_imu_lidar,
        ),
    )


def moved_in_gate(problem: JointProblem, before: Estimate, after: Estimate) -> float:
    """How far a solve has moved points across the gates they passed: 95th percentile over the bins.

    Of the change of a bin's mean distance, in standard deviations of a single point.
    """
    scatter = problem.bins.scatter
    if len(scatter) == 0:
        return 0.0
    weight = np.maximum(scatter[:, 3, 3], 1e-30)
    moved = (
        np.einsum("bi,bi->b", scatter[:, 3, :], problem.planes_seen(after)[0] - problem.planes_seen(before)[0]) / weight
    )
    point_std = np.sqrt(problem.bins.count / weight)
    return float(np.percentile(np.abs(moved) / point_std, 95.0))


def misfit(problem: JointProblem, estimate: Estimate) -> float:
    """Mean square, in standard deviations, of the bins' mean distances: about 1 or less where the model explains the data.

    A bin averages hundreds of points, so that what its mean has left is not range noise but motion, timing or geometry.
    """
    bins = problem.bins
    a, _ = problem.planes_seen(estimate)
    mean = np.einsum("bi,bi->b", bins.scatter[:, 3, :], a)
    return float(np.mean(mean**2 / np.maximum(bins.scatter[:, 3, 3], 1e-30))) if len(a) else 0.0


def plane_misfit(problem: JointProblem, estimate: Estimate) -> FloatArray:
    """The misfit plane by plane, (P,)."""
    bins = problem.bins
    a, _ = problem.planes_seen(estimate)
    mean = np.einsum("bi,bi->b", bins.scatter[:, 3, :], a)
    square = mean**2 / np.maximum(bins.scatter[:, 3, 3], 1e-30)
    planes = len(estimate.normals)
    return np.bincount(bins.plane, square, planes) / np.maximum(np.bincount(bins.plane, minlength=planes), 1)


def away_m(problem: JointProblem, estimate: Estimate) -> float:
    """Root mean square of the bins' mean distances in metres, each bin by its points."""
    bins = problem.bins
    a, _ = problem.planes_seen(estimate)
    mean = np.einsum("bi,bi->b", bins.scatter[:, 3, :], a) / np.maximum(bins.scatter[:, 3, 3], 1e-30)
    return float(np.sqrt(np.average(mean**2, weights=bins.count))) if len(a) else 0.0
