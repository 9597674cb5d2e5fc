"""Lidar-only motion: each scan registered to the planes, its own sweep straightened at constant velocity.

The start of everything that follows (the paper's eq. 13, without its motionless-sweep assumption): no IMU, no guess.
For a point x at time tau after its scan's first point,

    x_map = R Exp(omega tau) x + p + v tau,        d = n . x_map + w

and R, p, omega, v of one scan are found by iterated least squares with a redescending weight whose scale shrinks,
tied to the previous scan by a loose continuity. Scans are followed outwards from a reference scan, forward and
backward, until the planes are lost on either side.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib_core.factors.kernels import register_kernel
from calib_core.geometry import exp, log
from calib_core.planes.segment import determinacy
from calib_core.types import FloatArray, Plane, Scan


@dataclass(frozen=True, slots=True)
class ScanMotion:
    """One scan's motion in the map frame: pose of the lidar at the first point's time, and its velocities in the sweep.

    R, p: map <- lidar.   omega_rad_s: (3,) lidar axes.   v_m_s: (3,) map axes.   share: of the sampled points that lie on
    a plane.   rms_m: of those.   determinacy: smallest eigenvalue of the mean n n^T over them.
    """

    position: int
    R: FloatArray
    p: FloatArray
    omega_rad_s: FloatArray
    v_m_s: FloatArray
    share: float
    rms_m: float
    determinacy: float


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """points: sampled from each scan.   scales_m: of the weight, iteration by iteration.   Tie: 1 sigma to the previous scan."""

    points: int = 1500
    scales_m: tuple[float, ...] = (0.4, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.05)
    inlier_m: float = 0.1
    tie_rotation_rad: float = 0.06
    tie_position_m: float = 0.05
    tie_rate_rad_s: float = 1.5
    tie_velocity_m_s: float = 0.6
    lidar_std_m: float = 0.03
    lost_share: float = 0.5
    lost_determinacy: float = 0.02
    jump_rotation_rad: float = 0.3
    jump_position_m: float = 0.35


def sample_points(scan: Scan, count: int) -> tuple[FloatArray, FloatArray]:
    """Evenly spread points of a scan and their times after its first point: (K, 3) [m], (K,) [s]. Deterministic."""
    n = len(scan.points)
    if n > count:
        # A golden-ratio stride visits rings and azimuths evenly whatever the interleaving of the packets.
        pick = np.unique((np.arange(count) * 0.6180339887498949 % 1.0 * n).astype(np.int64))
        points = scan.points[pick]
    else:
        points = scan.points
    return points["xyz"].astype(np.float64), points["offset_ns"] * 1e-9


def register(
    points_m: FloatArray,
    tau_s: FloatArray,
    normals: FloatArray,
    offsets_m: FloatArray,
    start: ScanMotion,
    *,
    tie: FloatArray,
    settings: TrackSettings,
    position: int,
) -> ScanMotion:
    """One scan registered to planes from a predicted motion.

    points_m: (K, 3) lidar frame.   tau_s: (K,).   normals: (P, 3), offsets_m: (P,) map.   tie: (12,) information of the
    predicted rotation, position, rate, velocity.
    """
    R, p, omega, v = start.R, start.p, start.omega_rad_s, start.v_m_s
    d = np.empty(len(points_m))
    plane = np.empty(len(points_m), dtype=np.int64)
    for scale in settings.scales_m:
        upper, gradient = np.zeros((12, 12)), np.zeros(12)
        register_kernel(points_m, tau_s, normals, offsets_m, R, p, omega, v, scale, upper, gradient, d, plane)
        hessian = (upper + np.triu(upper, 1).T) / settings.lidar_std_m**2 + np.diag(tie)
        deviation = np.concatenate([log(start.R.T @ R), p - start.p, omega - start.omega_rad_s, v - start.v_m_s])
        step = -np.linalg.solve(hessian, gradient / settings.lidar_std_m**2 + tie * deviation)
        R, p, omega, v = R @ exp(step[:3]), p + step[3:6], omega + step[6:9], v + step[9:12]
    inlier = (plane >= 0) & (np.abs(d) < settings.inlier_m)
    return ScanMotion(
        position=position,
        R=R,
        p=p,
        omega_rad_s=omega,
        v_m_s=v,
        share=float(inlier.mean()) if len(d) else 0.0,
        rms_m=float(np.sqrt(np.mean(d[inlier] ** 2))) if inlier.any() else np.inf,
        determinacy=determinacy(normals[plane[inlier]]) if inlier.sum() > 30 else 0.0,
    )


def track(
    scans: Sequence[Scan],
    planes: Sequence[Plane],
    reference: int,
    *,
    settings: TrackSettings | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> list[ScanMotion]:
    """The motion over the longest unbroken run of scans around the reference, in order of time.

    planes: map frame = the lidar frame at the reference scan's first point.
    """
    s = settings or TrackSettings()
    normals = np.array([plane.normal for plane in planes])
    offsets = np.array([plane.offset_m for plane in planes])
    still = ScanMotion(reference, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), 1.0, 0.0, 1.0)
    loose = np.repeat([1e8, 1e8, 1 / 2.0**2, 1 / 2.0**2], 3)
    first = register(
        *sample_points(scans[reference], s.points), normals, offsets, still, tie=loose, settings=s, position=reference
    )
    runs: list[list[ScanMotion]] = []
    total = len(scans)
    done = 1
    for direction in (1, -1):
        run: list[ScanMotion] = []
        previous = first
        position = reference + direction
        while 0 <= position < total:
            predicted, tie = _predict(previous, scans, position, s)
            points, tau = sample_points(scans[position], s.points)
            if len(points) < 60:
                break
            motion = register(points, tau, normals, offsets, predicted, tie=tie, settings=s, position=position)
            if _lost(motion, predicted, first, s):
                break
            run.append(motion)
            previous = motion
            position += direction
            done += 1
            if on_progress is not None:
                on_progress(done / total)
        runs.append(run)
    return [*reversed(runs[1]), first, *runs[0]]


def _lost(motion: ScanMotion, predicted: ScanMotion, first: ScanMotion, s: TrackSettings) -> bool:
    """Whether a registration is not to be trusted: too few points on planes, too few directions, or a leap.

    A box looks the same after a half turn: a registration far from its prediction is more likely that than a motion.
    """
    few = motion.share < s.lost_share * first.share or motion.determinacy < s.lost_determinacy
    turned = float(np.linalg.norm(log(predicted.R.T @ motion.R)))
    moved = float(np.linalg.norm(motion.p - predicted.p))
    return few or turned > s.jump_rotation_rad or moved > s.jump_position_m


def _predict(
    previous: ScanMotion, scans: Sequence[Scan], position: int, s: TrackSettings
) -> tuple[ScanMotion, FloatArray]:
    """Constant velocity to the next scan, with the information of that guess."""
    dt = (scans[position].stamp_ns - scans[previous.position].stamp_ns) * 1e-9
    steps = max(abs(dt) / 0.1, 0.2)
    predicted = ScanMotion(
        position,
        previous.R @ exp(previous.omega_rad_s * dt),
        previous.p + previous.v_m_s * dt,
        previous.omega_rad_s,
        previous.v_m_s,
        previous.share,
        previous.rms_m,
        previous.determinacy,
    )
    # Acceleration makes the pose's error grow with the square of time and the velocity's with time.
    std = np.array(
        [
            s.tie_rotation_rad * steps**2,
            s.tie_position_m * steps**2,
            s.tie_rate_rad_s * steps,
            s.tie_velocity_m_s * steps,
        ]
    )
    return predicted, np.repeat(1.0 / std**2, 3)
