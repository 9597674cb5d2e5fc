"""One scan against the planes: its pose and its velocities within the sweep by iterated least squares.

For a point x at time tau after its scan's first point,

    x_map = R Exp(omega tau) x + p + v tau,        d = n . x_map + w

with a redescending weight whose scale shrinks, tied to the previous scan by a loose continuity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_core.full.odometry.kernels import descend_kernel, register_kernel, straighten_kernel
from calib_core.full.odometry.plane_map import PlaneMap
from calib_core.full.odometry.settings import MAP, TrackSettings
from calib_core.types import FloatArray, IntArray, Scan

#: (sqrt(5) - 1) / 2: its multiples modulo one are spread as evenly as any sequence's.
_GOLDEN = 0.6180339887498949
#: What of a scan's motion a tie's twelve are of: those of its pose, and of its change within the sweep.
TURN, PLACE, RATE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


@dataclass(frozen=True, slots=True)
class ScanMotion:
    """One scan's motion in the map frame: pose of the lidar at the first point's time, and its velocities in the sweep.

    R, p: map <- lidar.   omega_rad_s: (3,) lidar axes.   v_m_s: (3,) map axes.   share: of the sampled points that lie on
    a plane, 0 for a scan that was bridged.   rms_m: of those.   std_rad, std_m: 1 sigma of the pose along
    the least determined direction, from the points alone, the sweep's velocities taken as known.
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


def evenly_spread(n: int, count: int) -> IntArray:
    """About `count` of n places in order: a golden-ratio stride visits rings and azimuths alike, however packets interleave."""
    taken = np.zeros(n, np.bool_)
    taken[(np.arange(count) * _GOLDEN % 1.0 * n).astype(np.int64)] = True
    return np.flatnonzero(taken)


def sample_points(scan: Scan, count: int) -> tuple[FloatArray, FloatArray]:
    """Evenly spread points of a scan and their times after its first point: (K, 3) [m], (K,) [s]. Deterministic."""
    points = scan.points[evenly_spread(len(scan.points), count)] if len(scan.points) > count else scan.points
    return points["xyz"].astype(np.float64), points["offset_ns"] * 1e-9


@dataclass(frozen=True, slots=True)
class Registered:
    """A registration and what its points did. plane: (K,) index, -1 for none within reach.   blind: (3,) map, unit: the
    direction of position that fewest points tell.
    """

    motion: ScanMotion
    points_m: FloatArray
    tau_s: FloatArray
    plane: IntArray
    blind: FloatArray


class _Look:
    """What one look of the points at the planes gives: distances, planes, and normal equations where asked for."""

    def __init__(
        self,
        points_m: FloatArray,
        tau_s: FloatArray,
        planes: PlaneMap,
        at: ScanMotion,
        scale_m: float,
        outside_m: float,
        worth: FloatArray | None,
    ) -> None:
        n = len(points_m)
        upper, self.gradient = (
            (np.zeros((12, 12)), np.zeros(12)) if worth is not None else (np.zeros((0, 0)), np.zeros(0))
        )
        self.d, self.plane, self.inside = np.empty(n), np.empty(n, np.int64), np.empty(n, np.bool_)
        register_kernel(
            points_m, tau_s, planes.normals, planes.offsets_m, planes.axes, planes.reach,
            np.ones(0) if worth is None else worth, MAP.cell_m, outside_m,
            at.R, at.p, at.omega_rad_s, at.v_m_s, scale_m, upper, self.gradient, self.d, self.plane, self.inside,
        )  # fmt: skip
        self.hessian = upper + np.triu(upper, 1).T

    def on(self, within_m: float) -> IntArray:
        """The plane each point lies on, -1 for none: (N,)."""
        return np.where(self.inside & (np.abs(self.d) < within_m), self.plane, -1)

    def worth(self, n_planes: int, most: float, least: int, within_m: float) -> FloatArray:
        """Factors that let no plane count for more than so many points: its own error stays however many it has. (P,)

        Fewer than `least` points on a plane may be anything that happens to be there: they do not count at all.
        """
        on = self.on(within_m)
        count = np.bincount(on[on >= 0], minlength=n_planes)
        return np.where(count < least, 0.0, 1.0 / (1.0 + count / most))


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
    scales = scales_m or settings.scales_m
    variance = settings.lidar_std_m**2
    n_planes, outside = len(planes.normals), settings.outside_m
    look = _Look(points_m, tau_s, planes, start, scales[0], outside, None)
    few = _balanced(np.where(np.abs(look.d) < scales[0], look.plane, -1), settings.points)
    some_m, some_s = points_m[few], tau_s[few]
    at = replace(
        start, R=start.R.copy(), p=start.p.copy(), omega_rad_s=start.omega_rad_s.copy(), v_m_s=start.v_m_s.copy()
    )
    descend_kernel(
        some_m, some_s, planes.normals, planes.offsets_m, planes.axes, planes.reach, MAP.cell_m, outside, np.array(scales),
        settings.fit_std_m**2 * tie, settings.plane_points, settings.least_points, at.R, at.p, at.omega_rad_s, at.v_m_s,
    )  # fmt: skip
    look = _Look(some_m, some_s, planes, at, scales[-1], outside, None)
    worth = look.worth(n_planes, settings.sure_points, 2 * settings.least_points, settings.inlier_m)
    sure = _Look(some_m, some_s, planes, at, scales[-1], outside, worth).hessian[:6, :6]
    unknown = settings.unknown_std
    told = 1.0 / np.repeat([unknown if known_rad is None else known_rad, unknown], 3) ** 2
    covariance = np.linalg.inv(sure / variance + np.diag(told))
    rotation = np.linalg.eigvalsh(covariance[TURN, TURN])
    position_, directions = np.linalg.eigh(covariance[PLACE, PLACE])
    look = _Look(points_m, tau_s, planes, at, scales[-1], outside, None)
    plane = look.on(settings.inlier_m)
    on = plane >= 0
    motion = replace(
        at,
        position=position,
        share=float(on.mean()) if len(on) else 0.0,
        rms_m=float(np.sqrt(np.mean(look.d[on] ** 2))) if on.any() else np.inf,
        std_rad=float(np.sqrt(rotation[-1])),
        std_m=float(np.sqrt(position_[-1])),
    )
    return Registered(motion, points_m, tau_s, plane, directions[:, -1])


def _balanced(group: IntArray, count: int) -> IntArray:
    """About `count` indices with the groups as equal as they can be, spread evenly over each. group: (K,), -1 and up."""
    if len(group) <= count:
        return np.arange(len(group))
    order = np.argsort(group, kind="stable")
    sizes = np.bincount(group + 1)
    sizes = sizes[sizes > 0]
    most, left = count, count
    for rank, size in enumerate(np.sort(sizes)):
        most = left // (len(sizes) - rank)
        if size > most:
            break
        left -= size
    taken = np.minimum(sizes, most)
    starts = np.cumsum(sizes) - sizes
    picks = [at + np.arange(n) * size // max(n, 1) for at, n, size in zip(starts, taken, sizes, strict=True)]
    return np.sort(order[np.concatenate(picks)])


def straighten(points_m: FloatArray, tau_s: FloatArray, motion: ScanMotion) -> FloatArray:
    """Points of a scan in the map frame, (K, 3)."""
    x_map = np.empty_like(points_m)
    straighten_kernel(points_m, tau_s, motion.R, motion.p, motion.omega_rad_s, motion.v_m_s, x_map)
    return x_map
