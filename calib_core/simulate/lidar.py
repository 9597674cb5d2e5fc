"""Sweeps of a lidar that moves: every point cast at its own time from its own pose.

The motion is evaluated exactly at each column's instant. Within a column (at most some 50 microseconds) the pose
follows from the column's own exact derivatives,

    p(t + h) = p + h v + h^2/2 a,      R(t + h) = R Exp(h w + h^2/2 b),

whose remainder h^3/6 times the third derivative is below 1e-11 m and rad for any motion a hand can make.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_core.simulate.bodies import Rays
from calib_core.simulate.faults.lidar import IDEAL_LIDAR, LidarDeviations
from calib_core.simulate.motion import Kinematics, seconds
from calib_core.simulate.patterns import Firings
from calib_core.simulate.scene import Hits, Scene
from calib_core.simulate.sensors import Lidar
from calib_core.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Outliers:
    """Returns that are plainly wrong: a fraction of the points gets a range drawn uniformly from `range_m`."""

    fraction: float
    range_m: tuple[float, float] = (0.5, 10.0)


@dataclass(frozen=True, slots=True)
class Sweep:
    """One sweep, before any driver rounds it.

    time_ns: (C, K) int64 after the simulation's zero.   xyz_m: (C, K, 3), lidar frame at the point's own time, zero
    where `valid` is False.   surface: (C, K) what was hit, -1 where nothing or an outlier.   ring: (K,).
    lost: (C,) columns whose packet never arrived.   intensity: (C, K), 0..255.
    """

    index: int
    time_ns: IntArray
    xyz_m: FloatArray
    intensity: FloatArray
    ring: NDArray[np.uint16]
    valid: BoolArray
    surface: NDArray[np.int16]
    lost: BoolArray


def firings_rays(firings: Firings, columns: Kinematics, home_m: FloatArray) -> Rays:
    """World rays of a sweep, flattened (column, channel).

    columns: kinematics of the lidar at the columns' instants.   home_m: (3,) where the lidar was at first.
    """
    h = seconds(firings.channel_ns)[None, :]
    d, origin = firings.directions, firings.origin_m
    if firings.channel_ns.any():
        angle = [
            columns.omega_rad_s[:, i, None] * h + columns.alpha_rad_s2[:, i, None] * (0.5 * h * h) for i in range(3)
        ]
        d = _turn_slightly(angle, d)
        origin = None if origin is None else _turn_slightly(angle, origin)
    directions = _rotate(columns.R_world, d)
    position = np.empty(directions.shape)
    for i in range(3):
        np.multiply(columns.v_m_s[:, i, None], h, out=position[i])
        position[i] += columns.a_m_s2[:, i, None] * (0.5 * h * h) + columns.p_m[:, i, None]
    start = position if origin is None else position + _rotate(columns.R_world, origin)
    t_s = (seconds(firings.column_ns)[:, None] + h).reshape(-1)
    return Rays(start.reshape(3, -1), directions.reshape(3, -1), t_s, position.reshape(3, -1), home_m)


def _rotate(R: FloatArray, vectors: FloatArray) -> FloatArray:
    """R (C, 3, 3) applied to vectors (3, C, K), column by column."""
    out = np.empty(vectors.shape)
    for i in range(3):
        np.multiply(R[:, i, 0, None], vectors[0], out=out[i])
        out[i] += R[:, i, 1, None] * vectors[1]
        out[i] += R[:, i, 2, None] * vectors[2]
    return out


def _turn_slightly(angle: list[FloatArray], d: FloatArray) -> FloatArray:
    """Exp(angle) d to second order: d + angle x (d + angle x d / 2), for angles below 1e-3 rad. angle: 3 of (C, K)."""
    middle = _cross(angle, d)
    middle *= 0.5
    middle += d
    turned = _cross(angle, middle)
    turned += d
    return turned


def _cross(a: list[FloatArray], d: FloatArray) -> FloatArray:
    out = np.empty(d.shape)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        np.multiply(a[j], d[k], out=out[i])
        out[i] -= a[k] * d[j]
    return out


def measure(
    lidar: Lidar,
    scene: Scene,
    firings: Firings,
    rays: Rays,
    index: int,
    rng: np.random.Generator,
    outliers: Outliers | None = None,
    deviations: LidarDeviations = IDEAL_LIDAR,
) -> Sweep:
    """What the lidar reports for these rays: range noise along the ray, lost and wrong returns.

    firings: as the driver publishes them; the rays are those really fired.   deviations: of the
    ranges. The range noise is drawn first, so that two scenarios that differ only
    in lost or wrong returns share it.
    """
    shape = firings.directions.shape[1:]
    n = rays.t_s.shape[0]
    noise = rng.standard_normal(n)
    hits = scene.cast(rays)
    reflectivity = scene.reflectivity[hits.surface]
    seen = _answers(lidar, hits, reflectivity)
    true_m = np.where(seen, hits.range_m, 0.0).reshape(shape)
    of = hits.surface.reshape(shape).astype(np.int64)
    range_m = deviations.published_ranges(true_m, hits.cos_incidence.reshape(shape), of).reshape(-1)
    range_m = range_m + lidar.range_std_m * noise
    surface = hits.surface
    if lidar.miss_probability:
        seen &= rng.random(n) >= lidar.miss_probability
    if outliers is not None:
        wrong = seen & (rng.random(n) < outliers.fraction)
        range_m = np.where(wrong, rng.uniform(*outliers.range_m, n), range_m)
        surface = np.where(wrong, -1, surface).astype(np.int16)
    valid = (seen & (range_m >= lidar.range_min_m) & (range_m <= lidar.range_max_m)).reshape(shape)
    if lidar.field_of_view_deg < 360.0:
        azimuth = np.arctan2(firings.directions[1], firings.directions[0])
        valid &= np.abs(azimuth) <= np.deg2rad(lidar.field_of_view_deg) / 2.0
    lost = np.zeros(shape[0], dtype=np.bool_)
    if lidar.lost_columns_probability:
        lost = np.asarray(rng.random(shape[0]) < lidar.lost_columns_probability)
    valid &= ~lost[:, None]
    xyz = firings.directions * np.where(valid, range_m.reshape(shape), 0.0)
    if firings.origin_m is not None:
        xyz += np.where(valid, firings.origin_m, 0.0)
    return Sweep(
        index,
        firings.column_ns[:, None] + firings.channel_ns[None, :],
        np.moveaxis(xyz, 0, -1),
        np.rint(255.0 * reflectivity * np.where(seen, hits.cos_incidence, 0.0)).reshape(shape),
        lidar.pattern.ring,
        valid,
        surface.reshape(shape),
        lost,
    )


def noise_free(lidar: Lidar) -> Lidar:
    """The same lidar with exact ranges."""
    return replace(lidar, range_std_m=0.0)


def _answers(lidar: Lidar, hits: Hits, reflectivity: FloatArray) -> BoolArray:
    reach = lidar.range_at_tenth_m * np.sqrt(10.0 * reflectivity * hits.cos_incidence)
    answers: BoolArray = (hits.surface >= 0) & (hits.range_m <= reach)
    return answers
