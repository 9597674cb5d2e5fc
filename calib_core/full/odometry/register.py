"""One scan against the planes: its pose and its velocities within the sweep by iterated least squares.

For a point x at time tau after its scan's first point,

    x_map = R Exp(omega tau) x + p + v tau,        d = n . x_map + w

with a redescending weight whose scale shrinks, tied to the previous scan by a loose continuity.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_core.full.odometry.kernels import Counting, Motion, register_kernel, room, straighten_kernel
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.settings import TrackSettings
from calib_core.planes.sample import evenly_spread
from calib_core.planes.sample_kernels import take_kernel
from calib_core.types import FloatArray, IntArray, Scan

#: What of a scan's motion a tie's twelve are of: those of its pose, and of its change within the sweep.
TURN, PLACE, RATE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


@dataclass(frozen=True, slots=True)
class ScanMotion:
    """One scan's motion in the map frame: pose of the lidar at the first point's time, and its velocities in the sweep.

    R, p: map <- lidar.   omega_rad_s: (3,) lidar axes.   v_m_s: (3,) map axes.   share: of the sampled points that lie on
    a plane, 0 for a scan that was bridged.   rms_m: of those.   std_rad, std_m: 1 sigma of the pose along
    the least determined direction, from the points alone, the sweep's velocities taken as known.   unseen: (3, 3) map, takes
    from a vector all but what lies along directions in which the points do not tell its place; zeros where they do in all.
    """

    position: int
    R: FloatArray
    p: FloatArray
    omega_rad_s: FloatArray
    v_m_s: FloatArray
    share: float = 1.0
    rms_m: float = 0.0
    std_rad: float = 0.0
    std_m: float = 0.0
    unseen: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


def is_determined(motion: ScanMotion, settings: TrackSettings | None = None) -> bool:
    """Whether the points of a scan tell all six directions of its pose."""
    s = settings or TrackSettings()
    return is_oriented(motion, s) and motion.std_m < s.trusted_m


def is_oriented(motion: ScanMotion, settings: TrackSettings | None = None) -> bool:
    """Whether they tell its turn."""
    return motion.std_rad < (settings or TrackSettings()).trusted_rad


def is_held(motion: ScanMotion, settings: TrackSettings | None = None) -> bool:
    """Whether they tell its turn, and its place in two directions at least."""
    return is_oriented(motion, settings) and round(float(np.trace(motion.unseen))) <= 1


def sample_points(scan: Scan, count: int) -> tuple[FloatArray, FloatArray]:
    """Evenly spread points of a scan and their times after its first point: (K, 3) [m], (K,) [s]. Deterministic."""
    points, n = scan.points, len(scan.points)
    which = evenly_spread(n, count) if n > count else np.arange(n)
    xyz, tau = np.empty((len(which), 3)), np.empty(len(which))
    take_kernel(points["xyz"], points["offset_ns"], which, xyz, tau)
    return xyz, tau


@dataclass(frozen=True, slots=True)
class Registered:
    """A registration and what its points did. x_map_m: (K, 3).   plane: (K,) index, -1 for none within reach."""

    motion: ScanMotion
    x_map_m: FloatArray
    plane: IntArray


def register(
    points_m: FloatArray,
    tau_s: FloatArray,
    planes: PlaneMap,
    start: ScanMotion,
    *,
    tie: FloatArray,
    settings: TrackSettings,
    position: int,
    scales_m: tuple[float, ...] | None = None,
    known_rad: float | None = None,
) -> Registered:
    """One scan registered to planes from a predicted motion.

    points_m: (K, 3) lidar frame.   tau_s: (K,).   tie: (12,) information of the predicted rotation, position, rate,
    velocity. Of many points those of broad planes are thinned, so that a wall seen by a few still counts.
    known_rad: 1 sigma of the predicted rotation where it is a measurement, and counts in the judgement of the pose.
    """
    s, scales = settings, scales_m or settings.scales_m
    at = Motion(start.R.copy(), start.p.copy(), start.omega_rad_s.copy(), start.v_m_s.copy())
    counting = Counting(s.points, s.plane_points, s.sure_points, s.least_points, s.inlier_m)
    seen = room(len(points_m))
    sure = register_kernel(
        points_m, tau_s, planes.surfaces(s.outside_m), np.array(scales), s.fit_std_m**2 * tie, counting, at, seen
    )
    told = 1.0 / np.repeat([s.unknown_std if known_rad is None else known_rad, s.unknown_std], 3) ** 2
    covariance = np.linalg.inv(sure / s.lidar_std_m**2 + np.diag(told))
    rotation = np.linalg.eigvalsh(covariance[TURN, TURN])
    position_, directions = np.linalg.eigh(covariance[PLACE, PLACE])
    untold = directions[:, position_ >= s.trusted_m**2]
    on = seen.inside & (np.abs(seen.d) < s.inlier_m)
    off_m = seen.d[on]
    motion = ScanMotion(
        position, *at,
        share=len(off_m) / len(on) if len(on) else 0.0,
        rms_m=float(np.sqrt(np.mean(off_m**2))) if len(off_m) else np.inf,
        std_rad=float(np.sqrt(rotation[-1])),
        std_m=float(np.sqrt(position_[-1])),
        unseen=untold @ untold.T,
    )  # fmt: skip
    return Registered(motion, seen.x_map, np.where(on, seen.plane, -1))


def straighten(points_m: FloatArray, tau_s: FloatArray, motion: ScanMotion) -> FloatArray:
    """Points of a scan in the map frame, (K, 3)."""
    x_map = np.empty_like(points_m)
    straighten_kernel(points_m, tau_s, Motion(motion.R, motion.p, motion.omega_rad_s, motion.v_m_s), x_map)
    return x_map
