"""The turn about the only axis that a platform turned about, where its accelerations do not tell it.

Turning in place about one axis, the lidar and the IMU each see that axis and nothing across it: along the turn that stays
open any answer is as good by the data, and by what people build that one is likeliest in which gravity stands upright on
floors and lies along walls. In a box that may be four, a quarter of a turn apart, of which two take a wall for the floor: of
those that are as plumb it is the one in which the lidar stands upright, as most lidars do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from calib_core.full.initialise.linear import Steps
from calib_core.full.initialise.settings import LINEAR, UPRIGHT
from calib_core.full.initialise.start import RotationStart, Start
from calib_core.geometry import exp
from calib_core.types import BoolArray, FloatArray


def turns_about(axis: FloatArray, R: FloatArray, count: int) -> list[FloatArray]:
    """The rotation turned about an axis of its own left frame by equal steps of a full turn. axis: (3,), R: (3, 3)."""
    unit = axis / np.linalg.norm(axis)
    return [exp(unit * angle) @ R for angle in np.arange(count) * 2 * np.pi / count]


def upright(trials: Sequence[Start], normals: FloatArray, steps: Callable[[RotationStart], Steps]) -> Start:
    """The trial that fits best; of many that fit alike, differing by a turn about the only axis, one that is as upright as any.

    normals: (P, 3) of the planes, map.   steps: of one rotation; trials of one candidate are equal turns apart.
    """
    best = min(trials, key=lambda t: t.misfit)
    axis = best.rotation.open_axis_imu
    if axis is None:
        return best
    family = [t for t in trials if t.rotation.time_offset_s == best.rotation.time_offset_s]
    angles = np.arange(len(family)) * 2 * np.pi / len(family)
    told = [steps(t.rotation) for t in family]
    alike = _alike(told)
    if alike.sum() < UPRIGHT.fewest_alike:
        return best
    # Gravity goes round the axis with the turn: a constant and one harmonic tell it at any angle.
    gravity = -np.array([each.mean_force_m_s2 for each in told])
    harmonic = np.linalg.lstsq(_circle(angles[alike]), gravity[alike], rcond=None)[0]
    fine = np.arange(0.0, 2 * np.pi, np.radians(UPRIGHT.fine_deg))
    apart = np.abs((fine[:, None] - angles[alike] + np.pi) % (2 * np.pi) - np.pi).min(axis=1)
    within = fine[apart <= np.pi / len(family)]
    seen = _circle(within) @ harmonic
    slopes, leaning = np.array([_slope(g, normals) for g in seen]), _leaning(seen)
    likely = slopes <= slopes.min() + max(UPRIGHT.clutter_share * len(normals), 1.0)
    standing = leaning[likely].min() + np.radians(UPRIGHT.standing_deg)
    likely &= leaning <= standing
    plumbest = float(slopes[likely].min())
    mine = gravity[next(k for k, t in enumerate(family) if t is best)]
    if _slope(mine, normals) < plumbest + UPRIGHT.worth_a_turn and _leaning(mine[None])[0] <= standing:
        return best
    unit = axis / np.linalg.norm(axis)
    angle = within[np.flatnonzero(likely)[int(np.argmin(slopes[likely]))]]
    rotation = replace(best.rotation, R_imu_lidar=exp(unit * angle) @ family[0].rotation.R_imu_lidar)
    return Start(rotation, steps(rotation).start)


def _alike(told: Sequence[Steps]) -> BoolArray:
    """(T,) which turns the steps of the track fit as well as the one that they fit best.

    Nearly as well in all; or stretches of the track are not at one about it, as where it slid by decimetres and the turn bends
    what is left of that: over the stretches the difference is no further from nothing than chance puts it.
    """
    most = max(LINEAR.position_std_m, float(np.median([LINEAR.norm_of_median * np.median(t.off_m) for t in told])))
    squares = np.minimum(np.array([t.off_m for t in told]) / (LINEAR.astray_times * most), 1.0) ** 2
    stretches = np.array([part.sum(axis=1) for part in np.array_split(squares, UPRIGHT.stretches, axis=1)])
    worse = stretches - stretches[:, [int(np.argmin(squares.sum(axis=1)))]]
    chance = worse.std(axis=0, ddof=1) * np.sqrt(UPRIGHT.stretches)
    total = squares.sum(axis=1)
    return np.asarray((worse.sum(axis=0) <= UPRIGHT.beyond_chance * chance) | (total <= UPRIGHT.alike**2 * total.min()))


def _circle(angles: FloatArray) -> FloatArray:
    """(N, 3): 1, cosine and sine."""
    return np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=1)


def _slope(gravity: FloatArray, normals: FloatArray) -> float:
    """How far planes are from level or plumb, whichever is nearer, each at most counting as one. normals: (P, 3), map."""
    cosine = np.abs(normals @ gravity) / np.linalg.norm(gravity)
    off = np.arcsin(np.minimum(np.minimum(cosine, np.sqrt(np.maximum(1.0 - cosine**2, 0.0))), 1.0))
    return float(np.sum(off**2 / (off**2 + np.radians(UPRIGHT.plumb_deg) ** 2)))


def _leaning(gravity: FloatArray) -> FloatArray:
    """(N,) [rad] how far the lidar's z axis, which is the map's, is from upright. gravity: (N, 3), map, down."""
    return np.asarray(np.arccos(np.clip(-gravity[:, 2] / np.linalg.norm(gravity, axis=1), -1.0, 1.0)))
